"""Figures of a checkpoint on held-out surfaces, as report.json, tables and pictures.

python examples/evaluate.py --data prepared.h5 --output report
"""

import json
import logging
import sys
from dataclasses import replace
from pathlib import Path

from report.page import report_markdown
from report.running import run_sections, seen_in_training
from report.sections import FULL, QUICK, SECTIONS, make_context

from tactile_diffusers.cli.program import (
    Parser,
    add_checkpoint_argument,
    add_output_argument,
    add_seed_argument,
    checkpoint_folder,
    existing_file,
    load_pipeline,
    refuse,
    warn,
)
from tactile_diffusers.data.splits import SPLITS
from tactile_diffusers.io.argument_types import count
from tactile_diffusers.io.files import write_text
from tactile_diffusers.training.record import warning


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = Parser(
        prog="evaluate.py",
        description="Evaluate a checkpoint on held-out surfaces. Finished sections are kept under OUTPUT/sections: the "
        "same command continues an interrupted run.",
    )
    add = parser.add_argument
    add_checkpoint_argument(parser)
    add("--data", type=existing_file, required=True, metavar="PREPARED.h5", help="from examples/prepare_data.py")
    add_output_argument(parser, "report.json, report.md and pictures")
    add("--quick", action="store_true", help="few textures, three minutes on two cores; default: 20 minutes")
    add("--split", choices=SPLITS[1:], default="test", help="held-out surfaces; default: test")
    add("--sections", nargs="+", choices=SECTIONS, default=list(SECTIONS), help="default: all")
    add("--steps", type=count, nargs="+", metavar="N", help="LCTG steps of the sweep; default: 1 to 25, --quick: to 10")
    add("--per_surface", type=count, metavar="N", help="non-overlapping segments per surface; default: 4, --quick: 2")
    add_seed_argument(parser, "seed of every choice and all noise")
    add("--quiet", action="store_true", help="no progress bars")
    return parser.parse_args(argv)


def open_context(arguments, folder):
    """The checkpoint in a folder and the data, checked against each other: a `Context`."""
    settings = QUICK if arguments.quick else FULL
    if arguments.steps:
        settings = replace(settings, steps=tuple(sorted(set(arguments.steps))))
    if arguments.per_surface:
        takes = max(settings.takes, arguments.per_surface)
        settings = replace(settings, per_surface=arguments.per_surface, takes=takes)
    asked = (arguments.data, arguments.split, settings, arguments.seed, arguments.output, arguments.quiet)
    return make_context(load_pipeline(folder), *asked)


def main(argv=None):
    """Runs the command; sections that need DALE are null for a pipeline without one."""
    arguments = parse_arguments(argv)
    try:
        folder = checkpoint_folder(arguments.checkpoint)
        context = open_context(arguments, folder)
    except (ValueError, OSError) as error:
        return refuse("evaluate.py", error)
    # before the long work, so that it can be stopped here
    if words := warning(seen_in_training(context, folder), len(set(context.data.surfaces.tolist()))):
        warn("evaluate.py", words)
    of_ratings = logging.getLogger("tactile_diffusers.pipelines.inputs")
    level = of_ratings.level
    try:
        of_ratings.setLevel(logging.ERROR)  # ratings far outside are asked for on purpose
        report = run_sections(context, arguments.sections, folder)
    finally:
        of_ratings.setLevel(level)
    write_text(Path(arguments.output) / "report.json", json.dumps(report, indent=1, allow_nan=False) + "\n")
    markdown = report_markdown(report)
    write_text(Path(arguments.output) / "report.md", markdown)
    print(markdown)
    return 0


if __name__ == "__main__":
    sys.exit(main())
