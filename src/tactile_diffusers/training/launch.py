"""How a training script starts: it refuses bad input in one line, or has seeds, a device and a folder of its own."""

import logging
import sys
from contextlib import contextmanager
from pathlib import Path

import torch
from accelerate import Accelerator
from accelerate.utils import DataLoaderConfiguration, ProjectConfiguration, parse_flag_from_env, set_seed

from ..io.locks import lock_folder
from .checkpoints import step_of

_REFUSALS = (ImportError, OSError, ValueError)


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
        ValueError: if the output folder holds another training, or another process trains there.
        ImportError: if the tracker is not installed, naming the extra.
    """
    output = Path(args.output_dir)
    _check_output(output, args)
    if args.report_to in ("tensorboard", "all"):
        try:
            import tensorboard  # noqa: F401
        except ImportError as error:
            raise ImportError(
                f'--report_to {args.report_to} needs: pip install "tactile-diffusers[training]"; or set '
                "--report_to none."
            ) from error
    if args.allow_tf32:
        torch.backends.cuda.matmul.allow_tf32 = True
    accelerator = Accelerator(
        cpu=on_cpu(),
        gradient_accumulation_steps=args.gradient_accumulation_steps,
        mixed_precision=args.mixed_precision,
        log_with=None if args.report_to == "none" else args.report_to,
        project_config=ProjectConfiguration(project_dir=args.output_dir, logging_dir=str(output / args.logging_dir)),
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


def _check_output(output, args):
    used = output.is_dir() and any(step_of(p) is not None or p.name == "log.jsonl" for p in output.iterdir())
    if used and not args.overwrite_output_dir and not args.resume_from_checkpoint:
        raise ValueError(
            f"--output_dir {output} already holds a training. Set --resume_from_checkpoint latest to continue it, or "
            "--overwrite_output_dir to start again."
        )
