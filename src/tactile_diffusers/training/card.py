"""The end of a training: the model card of a checkpoint (README.md, from `model_card.jinja`), and the Hub.

The training scripts write the card for what they leave behind, `examples/publish.py` for what it stores.
"""

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import torch
from huggingface_hub import EvalResult, ModelCard, ModelCardData

from ..io.files import atomic_path, write_text
from ..io.locks import unlock_folder
from ..io.reading import reading
from ..models import RatingStatistics
from ..pipelines.hub import CARD_FILE, forget_folders, upload_checkpoint
from ..signal.constants import VIRTUAL_SOURCE
from ..version import __version__
from .checkpoints import save_result, writing
from .record import is_complete, phases, read_log, read_losses, read_record
from .validation import plot_losses

TEMPLATE = Path(__file__).parent / "model_card.jinja"
TAGS = ["tactile", "haptics", "texture", "friction", "diffusion"]
#: Licences of data that the Hub knows by name; https://huggingface.co/docs/hub/repositories-licenses
HUB_LICENCES = re.compile(r"apache-2\.0|mit|cc0-1\.0|cc-by(-nc)?(-sa|-nd)?-[234]\.0|odbl|pddl|cdla-permissive-[12]\.0")
#: Attributes of a prepared file that its card does not list.
_NOT_LISTED = {"format", "version", "report", "hold_out", "split_seed", "segment_samples"}
#: Arguments of a training that do not change its result.
_WITHOUT_EFFECT = {
    *("quiet", "resume_from_checkpoint", "overwrite_output_dir", "checkpoints_total_limit"),
    *("push_to_hub", "hub_model_id"),
}


def finish(args, save, pipe, dataset, note="", base=None):
    """Writes the trained models, the curves of their losses and their card; sends them to the Hub if asked.

    For the main process. Others may write to the output folder afterwards.

    Args:
        args (`argparse.Namespace`): of the training script.
        save (`Callable`): of `save_result`.
        pipe, dataset, note, base: of `write_card`.

    Raises:
        OSError: if something cannot be written: what that is, and whether the models are saved.
        huggingface_hub.errors.HfHubHTTPError: if the Hub refuses; the folder is whole by then.
    """
    output, name = Path(args.output_dir), getattr(args, "hub_model_id", None)
    save_result(output, save)
    with writing("loss.png", output, finished=True):
        plot_losses(output)
    runs = [folder for folder, record in phases(output) if is_complete(record)]
    with writing("The model card", output, finished=True):
        write_card(output, pipe, dataset, runs, place=name, note=note, base=base)
    if getattr(args, "push_to_hub", False):
        forget_folders(output)
        upload_checkpoint(output, name or output.resolve().name)
    unlock_folder(output)


def write_card(folder, pipe, dataset, runs, place=None, licence=None, warnings=None, report=None, note="", base=None):
    """Writes the model card of a checkpoint, and copies the loss curves of its trainings beside it.

    Args:
        folder (`str` or `Path`): the checkpoint's; it gets `README.md` and `loss_<n>.png`.
        pipe (`TactileTexturePipeline`): what is in the folder; without DALE, too.
        dataset (`PreparedDataset`): what it was trained on: the training view.
        runs (`Sequence[str` or `Path]`): output folders of its trainings, in order, with `training.json`.
        place (`str`, *optional*): title, and what the usage loads from; defaults to the folder's name.
        licence (`str`, *optional*): of the weights, as the Hub names it; defaults to that of the data.
        warnings (`str`, *optional*): those of the data card, in Markdown.
        report (`str`, *optional*): results of an evaluation, in Markdown, its pictures relative to the folder.
        note (`str`): a sentence on how the trainings were run.
        base (`str`, *optional*): name of the checkpoint that was adapted.

    Raises:
        OSError: if the folder cannot be written to.
        ValueError: if the record of a training is damaged.
    """
    folder = Path(folder)
    name = place or folder.resolve().name
    trainings = [describe_run(Path(run), folder, number) for number, run in enumerate(runs, start=1)]
    licence = licence or str(dataset.attributes.get("licence", "unknown"))
    card = ModelCard.from_template(
        _metadata(licence, name, dataset, trainings, base),
        template_path=str(TEMPLATE),
        version=__version__,
        quote=shlex.quote,
        name=name,
        copy=name.rsplit("/", 1)[-1],  # the folder of a copy, if it is on the Hub
        pipe=pipe,
        half=pipe.dtype == torch.float16,
        models=_models(pipe),
        ranges=_ranges(pipe),
        dataset=dataset,
        data=_data(dataset),
        data_file=Path(dataset.path).name,
        rated=np.isfinite(dataset.ratings.mean).any(),
        friction=np.isfinite(dataset.friction_coefficients).any(),
        simulated=dataset.source == VIRTUAL_SOURCE,
        warnings=warnings,
        trainings=trainings,
        runs=[Path(run).resolve().name for run in runs],
        note=note,
        report=report and report.strip(),
    )
    write_text(folder / CARD_FILE, f"{str(card).strip()}\n")


def _metadata(licence, name, dataset, trainings, base):
    """The YAML block; the last validation stands for the results until somebody evaluates the checkpoint."""
    known = HUB_LICENCES.fullmatch(licence.strip().lower().replace(" ", "-"))
    facts = {"license": known[0]} if known else {"license": "other", "license_name": licence}
    if base is not None:
        facts["base_model"] = base
    scores = trainings[-1]["scores"] if trainings else {}
    source = {"dataset_type": "tactile-recordings", "dataset_name": dataset.source, "dataset_split": "validation"}
    results = [EvalResult("other", metric_type=key, metric_value=value, **source) for key, value in scores.items()]
    return ModelCardData(
        library_name="diffusers", pipeline_tag="other", tags=TAGS, model_name=name, eval_results=results, **facts
    )


def _data(dataset):
    """The rows of the table of the training data: what its source and its preparation stored."""
    rows = {key: _in_words(value) for key, value in dataset.attributes.items() if key not in _NOT_LISTED}
    limits = rows.pop("limits")  # in N, mm/s and s
    return rows | ({"limits (N, mm/s, s)": limits} if dataset.subset == "filtered" else {})


def _in_words(value):
    """A setting of a prepared file in words: limits and bands as low to high."""
    if isinstance(value, dict):
        return ", ".join(f"{key.replace('_', ' ')} {_in_words(entry)}" for key, entry in value.items())
    if isinstance(value, list | tuple):
        return " to ".join(map(_in_words, value))
    return "any" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def _models(pipe):
    """The rows of the table of the models."""
    dale, extractor = pipe.dale, pipe.feature_extractor
    networks = {"LCTG": pipe.lctg, "distilled LCTG": pipe.lctg_distilled, "DALE": dale}
    networks["rating estimator"] = pipe.rating_estimator
    sizes = [f"{name} {part.num_parameters() / 1e6:.3g} million" for name, part in networks.items() if part is not None]
    samplers = {"LCTG": pipe.scheduler} | ({} if dale is None else {"DALE": pipe.dale_scheduler})
    steps = [
        f"{name} {number} of {type(scheduler).__name__}"
        for (name, scheduler), number in zip(samplers.items(), pipe.resolve_steps(), strict=False)
    ]
    return {
        "parameters": ", ".join(sizes),
        "default steps": ", ".join(steps),
        "sampling rates": f"{extractor.sampling_rate} Hz inside, {extractor.delivery_rate} Hz delivered",
        "reference speed": f"{dale.config.reference_speed:.0f} mm/s" if dale and dale.config.reference_speed else "",
    }


def _ranges(pipe):
    """Smallest and largest rating of the training surfaces on each axis, in words; "" without DALE."""
    if pipe.dale is None:
        return ""
    statistics = RatingStatistics.from_config(pipe.dale.config)
    pairs = zip(pipe.dale.config.rating_axes, statistics.range or [], strict=False)
    return ", ".join(f"{axis} {low:.1f} to {high:.1f}" for axis, (low, high) in pairs) or "not recorded"


def describe_run(run, folder, number):
    """What the card says of one training, from `training.json` and `log.jsonl` of its output folder `run`.

    Its loss curve is copied into the card's folder as `loss_<number>.png`.

    Returns:
        `dict`: "name", "command", "segments", "steps", "time", "machine", "versions", "loss", "scores" (of the last
            validation, by name) and "picture"; empty where nothing is known.

    Raises:
        ValueError: if `training.json` is damaged or lacks something.
    """
    with reading(run / "training.json", "the record of a training", "Copy it again from where it was written."):
        record = read_record(run)
        words = [f"accelerate launch {record['script']}", *_options(record["changed"])]
        processes = f", {record['processes']} processes" if record["processes"] > 1 else ""
        facts = {
            "segments": record["segments"],
            "steps": record["steps"],
            "versions": ", ".join(f"{name} {version}" for name, version in record["versions"].items()),
            "machine": record["machine"] + processes,
        }
    losses = read_losses(run)
    seconds = losses[-1].get("seconds") if losses else None
    scores = [{k.split("/")[1]: v for k, v in entry.items() if k.startswith("validation/")} for entry in read_log(run)]
    picture = run / "loss.png"
    if picture.is_file() and run.resolve() != folder.resolve():
        picture = folder / f"loss_{number}.png"
        with atomic_path(picture) as temporary:
            shutil.copyfile(run / "loss.png", temporary)
    return facts | {
        "name": run.resolve().name,
        "command": " \\\n    ".join(words),
        "time": "an unknown time" if seconds is None else f"{seconds / 60:.3g} minutes",
        "loss": f"{losses[-1]['train/loss']:.4f}" if losses else "",
        "scores": next(filter(None, reversed(scores)), {}),
        "picture": picture.name if picture.is_file() else "",
    }


def _options(arguments):
    """Options of a command, without those that have no effect on the result, and without this machine's folders."""
    for name, value in arguments.items():
        # a command without a tracker needs no extra package
        if name in _WITHOUT_EFFECT or (name == "report_to" and value != "none"):
            continue
        if isinstance(value, bool):
            yield f"--{name}" if value else f"--no-{name}"
            continue
        values = value if isinstance(value, list | tuple) else [value]
        yield " ".join([f"--{name}", *(shlex.quote(Path(str(v)).name if "/" in str(v) else str(v)) for v in values)])
