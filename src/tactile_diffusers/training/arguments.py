"""Arguments of the training scripts, with the names of diffusers' own examples.

Defaults are those that the bundled checkpoint was trained with: these networks are a thousand times smaller, and a
training without a seed could not be told again. Left out is what has no meaning here: `--dataset_name` (recordings are
files), `--prediction_type` and `--snr_gamma` (velocity in the angle variable, whose weight is `--phi_exponent`),
`--validation_epochs` (all is counted in updates), `--validation_ratings` (every axis is swept), `--offload_ema` (a few
megabytes), `--local_rank` (launchers set the environment).
"""

import argparse
from pathlib import Path

from ..io.reading import read_json

_RESUME_HELP = (
    "a checkpoint folder, or 'latest'; of your own trainings alone: optimiser and random state are pickles, which may "
    "run any code when they are read"
)


def add_training_arguments(parser):
    """Adds what both scripts share to `parser` and returns it."""
    add = parser.add_argument
    add("--train_data_dir", required=True, help="prepared data set (.h5) written by examples/prepare_data.py")
    add("--output_dir", required=True, help="folder of the trained pipeline, checkpoints, logs and figures")
    add("--overwrite_output_dir", action="store_true", help="start again in a folder that already holds a training")
    add("--cache_dir", help="of what --pretrained_model_name_or_path fetches from the Hub")
    add("--max_train_samples", type=int, help="use only this many training segments")
    add("--seed", type=int, default=0)
    add("--train_batch_size", type=int, default=16)
    add("--eval_batch_size", type=int, default=32)
    add("--num_train_epochs", type=int, default=100)
    add("--max_train_steps", type=int, help="optimiser updates; overrides --num_train_epochs")
    add("--gradient_accumulation_steps", type=int, default=1)
    add("--gradient_checkpointing", action="store_true")
    add("--learning_rate", type=float, default=1e-3)
    add("--scale_lr", action="store_true", help="multiply the learning rate by processes x accumulation x batch size")
    add("--lr_scheduler", default="cosine")
    add("--lr_warmup_steps", type=int, default=200)
    add("--adam_beta1", type=float, default=0.9)
    add("--adam_beta2", type=float, default=0.99)
    add("--adam_weight_decay", type=float, default=1e-2)
    add("--adam_epsilon", type=float, default=1e-8)
    add("--max_grad_norm", type=float, default=1.0)
    add("--use_ema", action=argparse.BooleanOptionalAction, default=True, help="average the weights (validated, saved)")
    add("--ema_decay", "--ema_max_decay", type=float, default=0.999)
    add("--ema_inv_gamma", type=float, default=1.0, help="of the warm-up: decay = 1 - (1 + step / inv_gamma) ** -power")
    add("--ema_power", type=float, default=0.75)
    add("--foreach_ema", action="store_true", help="average all weights in one call: faster on a GPU")
    add("--mixed_precision", choices=["no", "fp16", "bf16"], default="no")
    add("--allow_tf32", action="store_true", help="faster float32 products on Ampere GPUs and later, of 10 bits")
    add("--dataloader_num_workers", type=int, default=0)
    add("--checkpointing_steps", type=int, default=500)
    add("--checkpoints_total_limit", type=int, default=2)
    add("--resume_from_checkpoint", help=_RESUME_HELP)
    add("--validation_steps", type=int, default=500)
    add("--validation_samples", type=int, default=64, help="held-out segments per validation; 0 = none")
    add("--report_to", choices=["tensorboard", "wandb", "all", "none"], default="tensorboard")
    add("--logging_dir", default="logs", help="inside --output_dir")
    add("--tracker_project_name", default="tactile_diffusers")
    add("--quiet", action="store_true", help="no progress bar")
    return parser


def add_hub_arguments(parser):
    """Adds what sends the finished pipeline to the Hub; `examples/publish.py` sends it smaller, with its report."""
    add = parser.add_argument
    add("--push_to_hub", action="store_true", help="send the finished pipeline and its card to the Hub")
    add("--hub_model_id", metavar="USER/NAME", help="default: the name of --output_dir, in your namespace")
    add("--hub_token", help="default: that of `hf auth login`")
    add("--hub_private_repo", action="store_true", help="if the repository is new, make it private")


def parse_training_arguments(parser, argv=None):
    """Parses the command line and refuses impossible values.

    `args.defaults` holds what each argument is if it is not given: `training.json` tells what was changed.

    Args:
        parser (`argparse.ArgumentParser`): with what `add_training_arguments` adds, and the script's own.
        argv (`list[str]`, *optional*): defaults to the command line.

    Raises:
        ValueError: naming the argument, the value and what is allowed.
    """
    args = parser.parse_args(argv)
    check_training_arguments(args)
    args.defaults = {name: parser.get_default(name) for name in vars(args)}
    return args


def check_training_arguments(args):
    """Refuses impossible values before any work starts.

    Raises:
        ValueError: naming the argument, the value and what is allowed.
    """
    at_least_one = (
        "train_batch_size",
        "eval_batch_size",
        "num_train_epochs",
        "gradient_accumulation_steps",
        "checkpointing_steps",
        "validation_steps",
        "max_train_steps",
        "max_train_samples",
        "checkpoints_total_limit",
    )
    for name in at_least_one:
        value = getattr(args, name)
        if value is not None and value < 1:
            raise ValueError(f"--{name} must be at least 1, got {value}.")
    check_not_negative(args, "validation_samples")
    if not args.learning_rate > 0:
        raise ValueError(f"--learning_rate must be positive, got {args.learning_rate}.")
    for name in ("ema_inv_gamma", "ema_power"):
        if not getattr(args, name) > 0:
            raise ValueError(f"--{name} must be positive, got {getattr(args, name)}.")
    if not 0 <= args.ema_decay < 1:
        raise ValueError(f"--ema_decay must lie in [0, 1), got {args.ema_decay}.")


def check_model_folder(name):
    """Refuses a folder that is not there, rather than look for it on the Hub, where names are USER/NAME.

    Not a matter of `check_training_arguments`: who plans several trainings checks those before their folders are there.

    Raises:
        FileNotFoundError: if `name` can only be meant as a folder: it starts as a path, or its parent is a folder.
    """
    if name is None or Path(name).is_dir():
        return
    path = Path(name)
    beside = len(path.parts) == 2 and path.parent.is_dir()  # USER/NAME has a separator, too: a folder USER tells
    if str(name).startswith((".", "~")) or path.is_absolute() or len(path.parts) > 2 or beside:
        raise FileNotFoundError(f"--pretrained_model_name_or_path: there is no folder {name}.")


def check_not_negative(args, *names):
    """Raises a `ValueError` naming the first of `names` whose value in `args` is negative or NaN."""
    for name in names:
        if not getattr(args, name) >= 0:
            raise ValueError(f"--{name} must not be negative, got {getattr(args, name)}.")


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
