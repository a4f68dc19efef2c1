"""How a training ends: its result first, then what tells of it."""

from pathlib import Path

from ..io.locks import unlock_folder
from .card import send_to_hub, write_card
from .checkpoints import save_result, writing
from .figures import plot_losses
from .record import is_complete, phases


def finish(args, save, pipe, dataset, teacher=None):
    """Writes what a training results in, the curves of its losses and its card; sends it to the Hub if asked.

    For the main process. Others may write to the output folder afterwards.

    Args:
        args (`argparse.Namespace`): of the training script.
        save (`Callable`): of `save_result`.
        pipe, dataset, teacher: of `write_card`.

    Raises:
        OSError: if something cannot be written: what that is, and whether the result is whole.
        huggingface_hub.errors.HfHubHTTPError: if the Hub refuses.
    """
    output = Path(args.output_dir)
    save_result(output, save)
    with writing("loss.png", output, finished=True):
        plot_losses(output / "log.jsonl", output / "loss.png")
    told = phases(output)[-1:] if teacher is not None else phases(output)
    runs = [folder for folder, record in told if is_complete(record)]
    with writing("The model card", output, finished=True):
        write_card(output, pipe, dataset, runs, place=getattr(args, "hub_model_id", None), teacher=teacher)
    if getattr(args, "push_to_hub", False):
        send_to_hub(args)
    unlock_folder(output)
