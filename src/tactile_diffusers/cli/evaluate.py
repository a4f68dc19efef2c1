"""`python examples/evaluate.py`: figures of a checkpoint on held-out surfaces, as report.json, tables and pictures."""

import json
from dataclasses import replace
from pathlib import Path

from ..data.splits import SPLITS
from .program import (
    Parser,
    add_checkpoint_argument,
    add_output_argument,
    add_seed_argument,
    checkpoint_folder,
    count,
    existing_file,
    existing_folder,
    load_pipeline,
    program,
    refuse,
    warn,
)

_SECTIONS = ("reconstruction", "generation", "second_judge", "control", "regression", "paper", "speed")


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = Parser(
        prog=program("evaluate.py"),
        description="Evaluate a checkpoint on held-out surfaces. Finished sections are kept under OUTPUT/sections: the "
        "same command continues an interrupted run.",
    )
    add = parser.add_argument
    add_checkpoint_argument(parser)
    add("--data", type=existing_file, required=True, metavar="PREPARED.h5", help="from examples/prepare_data.py")
    add_output_argument(parser, "report.json, report.md and pictures")
    add("--quick", action="store_true", help="few textures, three minutes on two cores; default: 20 minutes")
    add("--split", choices=SPLITS[1:], default="test", help="held-out surfaces; default: test")
    add("--sections", nargs="+", choices=_SECTIONS, default=list(_SECTIONS), help="default: all")
    add("--steps", type=count, nargs="+", metavar="N", help="LCTG steps of the sweep; default: 1 to 25, --quick: to 10")
    add("--per_surface", type=count, metavar="N", help="non-overlapping segments per surface; default: 4, --quick: 2")
    add("--guidance_scale", type=float, nargs="+", default=[], metavar="W",
        help="further scales, besides 1 (off) and the pipeline's default; default: none")  # fmt: skip
    add("--anchor", type=existing_folder, nargs="+", default=[], metavar="FOLDER",
        help="further checkpoints whose LCTG is measured too, named after their folders")  # fmt: skip
    add("--training", type=existing_folder, nargs="+", default=[], metavar="FOLDER",
        help="folders of the phases of the checkpoint's LCTG training; default: as it says")  # fmt: skip
    add("--baseline_surfaces", type=count, metavar="N",
        help="training surfaces for the baselines, as many as the checkpoint had; default: all")  # fmt: skip
    add_seed_argument(parser, "seed of every choice and all noise")
    add("--quiet", action="store_true", help="no progress bars")
    arguments = parser.parse_args(argv)
    _check(parser, arguments)
    return arguments


def _check(parser, arguments):
    names = [folder.resolve().name for folder in arguments.anchor]
    if len(set(names)) < len(names):
        parser.error(f"argument --anchor: folders must have different names, got {names}")
    if names and "reconstruction" not in arguments.sections:
        parser.error("argument --anchor: needs the section reconstruction")
    for folder in arguments.training:
        if not (folder / "training.json").is_file():
            parser.error(f"argument --training: {folder} has no training.json; it is written by the training scripts")
    if arguments.baseline_surfaces == 1:
        parser.error("argument --baseline_surfaces: must be at least 2, got 1")
    if any(not 0 <= scale < float("inf") for scale in arguments.guidance_scale):
        parser.error(f"argument --guidance_scale: must be 0 or more, got {arguments.guidance_scale}")


def open_context(arguments, folder):
    """The checkpoint in a folder and the data, checked against each other: a `Context`."""
    from ..evaluation.sections import FULL, QUICK, Anchor, make_context

    settings = QUICK if arguments.quick else FULL
    if arguments.steps:
        settings = replace(settings, steps=tuple(sorted(set(arguments.steps))))
    if arguments.per_surface:
        takes = max(settings.takes, arguments.per_surface)
        settings = replace(settings, per_surface=arguments.per_surface, takes=takes)
    return make_context(
        load_pipeline(folder),
        arguments.data,
        arguments.split,
        settings,
        arguments.seed,
        arguments.output,
        arguments.guidance_scale,
        arguments.quiet,
        {anchor.resolve().name: Anchor(load_pipeline(anchor), anchor) for anchor in arguments.anchor},
        arguments.baseline_surfaces,
    )


def main(argv=None):
    """Runs the command; sections that need DALE are null for a pipeline without one."""
    arguments = parse_arguments(argv)
    from ..evaluation.report import run_sections, seen_in_training
    from ..evaluation.report_tables import report_markdown
    from ..io.files import write_text
    from ..training.record import warning

    try:
        folder = checkpoint_folder(arguments.checkpoint)
        context = open_context(arguments, folder)
    except (ValueError, OSError) as error:
        return refuse("evaluate.py", error)
    # before the long work, so that it can be stopped here
    seen = seen_in_training(context, [folder, *arguments.training])
    if words := warning(seen, len(set(context.data.surfaces.tolist()))):
        warn("evaluate.py", words)
    report = run_sections(context, arguments.sections, folder, arguments.training)
    write_text(Path(arguments.output) / "report.json", json.dumps(report, indent=1, allow_nan=False) + "\n")
    markdown = report_markdown(report)
    write_text(Path(arguments.output) / "report.md", markdown)
    print(markdown)
    return 0
