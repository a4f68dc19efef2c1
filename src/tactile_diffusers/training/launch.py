"""How a training script starts: its arguments, refusals in one line, seeds, a device and a folder of its own.

Arguments have the names of diffusers' own examples. Defaults are those that the bundled checkpoint was trained with.
Some of diffusers' arguments have no meaning here: `--dataset_name` (recordings are files), `--prediction_type` and
`--snr_gamma` (the loss is on the velocity), `--validation_epochs` (everything is counted in updates),
`--validation_ratings` (every axis is swept), `--gradient_checkpointing` and `--offload_ema` (the models are small) and
`--local_rank` (launchers set the environment). `--cache_dir` and `--hub_token` are environment variables of the Hub's
own package.
"""

import argparse
import logging
import sys
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import torch
from accelerate import Accelerator
from accelerate.utils import DataLoaderConfiguration, ProjectConfiguration, parse_flag_from_env, set_seed
from diffusers.optimization import SchedulerType

from ..checkpoints import bundled_checkpoint
from ..io.argument_types import below_one, count, not_negative, not_negative_int, positive_number, small_seed
from ..io.locks import lock_folder
from ..io.reading import read_json
from .checkpoints import LOGS, step_of

_REFUSALS = (OSError, ValueError)
#: Trackers, and what installs them.
TRACKERS = {"tensorboard": 'pip install "tactile-diffusers[training]"', "wandb": "pip install wandb"}
#: Courses of the learning rate; `piecewise_constant` needs rules that have no argument here.
SCHEDULES = [kind.value for kind in SchedulerType if kind is not SchedulerType.PIECEWISE_CONSTANT]
_RESUME_HELP = (
    "a checkpoint folder, or 'latest'. Only resume trainings of your own: optimiser and random state are pickles, "
    "which may run any code when they are read"
)


def pipeline_source(word):
    """What `TactileTexturePipeline.from_pretrained` takes: a folder, a Hub id, or `bundled`."""
    return bundled_checkpoint() if word == "bundled" else word


def training_parser(description, **defaults):
    """A parser with the arguments that all training scripts share.

    Args:
        description (`str`): the script's docstring.
        defaults: of this script, where they differ.

    Returns:
        `argparse.ArgumentParser`
    """
    plain = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=description, formatter_class=plain, allow_abbrev=False)
    _add_folders(parser.add_argument)
    _add_optimisation(parser.add_argument)
    _add_run(parser.add_argument)
    parser.set_defaults(**defaults)
    return parser


def _add_folders(add):
    add("--train_data_dir", required=True, help="prepared data set (.h5) written by examples/prepare_data.py")
    add("--output_dir", required=True, help="folder of the trained pipeline, checkpoints, logs and figures")
    add("--overwrite_output_dir", action="store_true", help="start again in a folder that already holds a training")
    add("--max_train_samples", type=count, help="use only this many training segments")


def _add_optimisation(add):
    add("--train_batch_size", type=count, default=16)
    add("--num_train_epochs", type=count, default=100)
    add("--max_train_steps", type=count, help="optimiser updates; overrides --num_train_epochs")
    add("--gradient_accumulation_steps", type=count, default=1)
    add("--learning_rate", type=positive_number, default=1e-3)
    add("--lr_scheduler", choices=SCHEDULES, default="cosine")
    add("--lr_warmup_steps", type=not_negative_int, default=200)
    add("--adam_beta1", type=below_one, default=0.9)
    add("--adam_beta2", type=below_one, default=0.99)
    add("--adam_weight_decay", type=not_negative, default=1e-2)
    add("--max_grad_norm", type=positive_number, default=1.0)
    add("--use_ema", action=argparse.BooleanOptionalAction, default=True, help="average the weights (validated, saved)")
    add("--ema_decay", type=below_one, default=0.999)


def _add_run(add):
    add(
        "--seed",
        type=small_seed,
        default=0,
        help="of weights, batches and noise; the same seed gives the same training",
    )
    add("--mixed_precision", choices=["no", "fp16", "bf16"], default="no")
    add("--dataloader_num_workers", type=not_negative_int, default=0)
    add("--checkpointing_steps", type=count, default=500)
    add("--checkpoints_total_limit", type=count, default=2)
    add("--resume_from_checkpoint", help=_RESUME_HELP)
    add("--validation_steps", type=count, default=500)
    add("--validation_samples", type=not_negative_int, default=64, help="held-out segments per validation; 0 = none")
    add("--eval_batch_size", type=count, default=32)
    add("--report_to", choices=[*TRACKERS, "none"], default="tensorboard")
    add("--quiet", action="store_true", help="no progress bar")
    add("--push_to_hub", action="store_true", help="send the finished pipeline and its card to the Hub")
    add("--hub_model_id", metavar="USER/NAME", help="default: the name of --output_dir, in your namespace")


def parse_training_arguments(parser, argv=None):
    """Parses the command line; `args.defaults` holds the defaults, so that `training.json` can list the changes."""
    args = parser.parse_args(argv)
    args.defaults = {name: parser.get_default(name) for name in vars(args)}
    return args


def read_model_config(path, sections):
    """The model config file as a dict of sections, empty if `path` is `None`.

    Raises:
        ValueError: if it has a section that is not among `sections`.
    """
    config = read_json(path, "a model config", "Correct it.") if path else {}
    unknown = set(config) - sections
    if unknown:
        raise ValueError(f"--model_config_name_or_path {path} has unknown sections {sorted(unknown)}.")
    return config


# --- from arguments to an accelerator


@contextmanager
def starting():
    """Marks errors of the block as refusals: nothing was trained yet, and the message says what to do."""
    try:
        yield
    except _REFUSALS as error:
        error.refused_at_start = True
        raise


def run(main):
    """Runs a script's `main`. Errors from outside of `starting` keep their traceback: they may be faults of ours.

    Raises:
        SystemExit: with exit code 2 and one line on stderr, if it refused to start.
    """
    try:
        main()
    except _REFUSALS as error:
        if not getattr(error, "refused_at_start", False):
            raise
        print(f"{Path(sys.argv[0]).name}: error: {' '.join(str(error).split())}", file=sys.stderr)
        raise SystemExit(2) from None


def on_cpu():
    """Whether accelerate computes on the CPU: because `ACCELERATE_USE_CPU` says so, or there is nothing else.

    Without a GPU accelerate 1.15 has to be told, or each of several processes takes itself for the only one.
    """
    return bool(parse_flag_from_env("ACCELERATE_USE_CPU")) or not torch.accelerator.is_available()


def make_accelerator(args):
    """Accelerator, seeds and the tracker for parsed arguments.

    The output folder is locked for this process until `checkpoints.finish`, or until the process ends.

    Raises:
        ValueError: if the output folder holds another training, if another process trains there, if there is no such
            checkpoint to resume from, or if the tracker is not installed, naming the extra.
    """
    output = Path(args.output_dir)
    used = output.is_dir() and any(step_of(p) is not None or p.name == "log.jsonl" for p in output.iterdir())
    if used and not args.overwrite_output_dir and not args.resume_from_checkpoint:
        raise ValueError(
            f"--output_dir {output} already holds a training. Set --resume_from_checkpoint latest to continue it, or "
            "--overwrite_output_dir to start again."
        )
    wanted = args.resume_from_checkpoint
    if wanted and wanted != "latest" and not (Path(wanted).is_dir() and step_of(wanted) is not None):
        raise ValueError(f"--resume_from_checkpoint {wanted} is neither 'latest' nor a folder checkpoint-<step>.")
    if args.report_to != "none" and find_spec(args.report_to) is None:
        raise ValueError(f"--report_to {args.report_to} needs: {TRACKERS[args.report_to]}; or set --report_to none.")
    accelerator = Accelerator(
        cpu=on_cpu(),
        gradient_accumulation_steps=args.gradient_accumulation_steps,
        mixed_precision=args.mixed_precision,
        log_with=None if args.report_to == "none" else args.report_to,
        project_config=ProjectConfiguration(project_dir=args.output_dir, logging_dir=str(output / LOGS)),
        # each process takes its own batches of the endless sampler; nothing is gathered at an epoch's end
        dataloader_config=DataLoaderConfiguration(even_batches=False),
    )
    if accelerator.is_main_process:
        output.mkdir(parents=True, exist_ok=True)
        lock_folder(output, "--output_dir")
    level = logging.INFO if accelerator.is_main_process else logging.ERROR
    logging.basicConfig(format="%(asctime)s %(message)s", level=level)
    set_seed(args.seed)
    return accelerator
