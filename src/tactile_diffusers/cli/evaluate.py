"""`python examples/evaluate.py`: what a checkpoint does on held-out surfaces, as report.json, tables and pictures."""

import json
import sys
from dataclasses import replace
from pathlib import Path

from ..data.splits import SPLITS
from .program import Parser, program, refuse

_SECTIONS = (
    "reconstruction",
    "generation",
    "control",
    "regression",
    "novel",
    "paper",
    "speed",
    "long_textures",
    "latents",
    "robustness",
)


def parse_arguments(argv=None):
    """Arguments of the command.

    Raises:
        SystemExit: on bad arguments, with exit code 2 and a line that says what is wrong.
    """
    parser = Parser(
        prog=program("evaluate.py"),
        description="Evaluate a checkpoint on held-out surfaces. What is done is kept under OUTPUT/sections: the same "
        "command goes on where it was cut off.",
    )
    parser.add_argument("--checkpoint", metavar="FOLDER", help="default: the bundled checkpoint")
    parser.add_argument(
        "--anchor",
        type=Path,
        nargs="+",
        default=[],
        metavar="FOLDER",
        help="further checkpoints, whose LCTG is measured beside; called by the names of their folders",
    )
    parser.add_argument(
        "--training",
        type=Path,
        nargs="+",
        default=[],
        metavar="FOLDER",
        help="output folders of the phases of the checkpoint's LCTG training, where it does not say itself",
    )
    parser.add_argument("--data", type=Path, required=True, metavar="PREPARED.h5", help="from examples/prepare_data.py")
    parser.add_argument("--output", type=Path, required=True, metavar="FOLDER", help="report.json, report.md, pictures")
    parser.add_argument("--quick", action="store_true", help="few textures, under five minutes on two cores")
    parser.add_argument("--split", choices=SPLITS[1:], default="test", help="held-out surfaces; default: test")
    parser.add_argument("--sections", nargs="+", choices=_SECTIONS, default=list(_SECTIONS), help="default: all")
    parser.add_argument("--steps", type=int, nargs="+", help="LCTG steps of the sweep, in place of the default ones")
    parser.add_argument(
        "--baseline-surfaces", type=int, help="training surfaces for baselines: as many as the checkpoint had"
    )
    parser.add_argument("--per-surface", type=int, help="non-overlapping segments per surface")
    parser.add_argument(
        "--guidance-scale", type=float, nargs="+", default=[], help="besides 1 (off) and the pipeline's default"
    )
    parser.add_argument(
        "--embedding", metavar="MODULE:NAME", help="embedding of the audio distance; default: log-mel, ours"
    )
    parser.add_argument("--vibromaf", action="store_true", help="add vibromaf's metrics to reconstructions")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quiet", action="store_true", help="no progress bars")
    arguments = parser.parse_args(argv)
    if not arguments.data.is_file():
        parser.error(f"argument --data: {arguments.data} is not a file; write one with examples/prepare_data.py")
    if arguments.checkpoint is not None and not Path(arguments.checkpoint).is_dir():
        parser.error(f"argument --checkpoint: {arguments.checkpoint} is not a folder; give a local checkpoint")
    _check_folders(parser, arguments)
    if arguments.per_surface is not None and arguments.per_surface < 1:
        parser.error(f"argument --per-surface: must be at least 1, got {arguments.per_surface}")
    if arguments.baseline_surfaces is not None and arguments.baseline_surfaces < 2:
        parser.error(f"argument --baseline-surfaces: must be at least 2, got {arguments.baseline_surfaces}")
    if arguments.steps is not None and min(arguments.steps) < 1:
        parser.error(f"argument --steps: must be at least 1, got {arguments.steps}")
    if arguments.seed < 0:
        parser.error(f"argument --seed: must be at least 0, got {arguments.seed}")
    if any(not 0 <= scale < float("inf") for scale in arguments.guidance_scale):
        parser.error(f"argument --guidance-scale: must be 0 or more, got {arguments.guidance_scale}")
    return arguments


def _check_folders(parser, arguments):
    """Refuses anchors and training folders that are not what they should be, or anchors that nothing stands beside."""
    for folder in arguments.anchor:
        if not folder.is_dir():
            parser.error(f"argument --anchor: {folder} is not a folder; give local checkpoints")
    names = [folder.resolve().name for folder in arguments.anchor]
    if len(set(names)) < len(names):
        parser.error(f"argument --anchor: folders must have different names to be told apart, got {names}")
    if names and "reconstruction" not in arguments.sections:
        parser.error("argument --anchor: needs the section reconstruction, which it is measured beside")
    for folder in arguments.training:
        if not (folder / "training.json").is_file():
            parser.error(f"argument --training: {folder} has no training.json; it is written by the training scripts")


def make_context(arguments):
    """The checkpoint and the data, checked against each other, and how much of them is measured."""
    from tactile_diffusers import TactileTexturePipeline

    from ..evaluation.audio_distance import load_embedding
    from ..evaluation.sections import FULL, QUICK, Anchor, Context

    def load(folder):
        pipe = TactileTexturePipeline.from_pretrained(str(folder))
        pipe.set_progress_bar_config(disable=True)
        return pipe

    settings = QUICK if arguments.quick else FULL
    if arguments.steps:
        settings = replace(settings, steps=tuple(sorted(set(arguments.steps))))
    if arguments.per_surface:
        takes = max(settings.takes, arguments.per_surface)
        settings = replace(settings, per_surface=arguments.per_surface, takes=takes)
    embedding = load_embedding(arguments.embedding) if arguments.embedding else None
    return Context(
        load(arguments.checkpoint),
        arguments.data,
        arguments.split,
        settings,
        arguments.seed,
        arguments.output,
        arguments.guidance_scale,
        embedding,
        arguments.vibromaf,
        arguments.quiet,
        {folder.resolve().name: Anchor(load(folder), folder) for folder in arguments.anchor},
        arguments.baseline_surfaces,
    )


def main(argv=None):
    """Runs the command; sections that need DALE are null for a pipeline without one."""
    arguments = parse_arguments(argv)
    from tactile_diffusers import bundled_checkpoint

    from ..evaluation.report import run_sections, seen_in_training
    from ..evaluation.summary import report_markdown
    from ..io.files import write_text
    from ..training.surfaces import warning

    arguments.checkpoint = str(arguments.checkpoint or bundled_checkpoint())
    try:
        context = make_context(arguments)
    except (ValueError, OSError) as error:
        return refuse("evaluate.py", error)
    # before the long work: who did not mean it can stop here
    seen = seen_in_training(context, [arguments.checkpoint, *arguments.training])
    if told := warning(seen, len(set(context.surfaces.tolist()))):
        print(f"{program('evaluate.py')}: warning: {told}", file=sys.stderr)
    report = run_sections(context, arguments.sections, arguments.checkpoint, arguments.training)
    write_text(arguments.output / "report.json", json.dumps(report, indent=1, allow_nan=False) + "\n")
    markdown = report_markdown(report)
    write_text(arguments.output / "report.md", markdown)
    print(markdown)
    return 0
