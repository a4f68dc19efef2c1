"""Shared by the studies of a checkpoint: their arguments, and the held-out data that they are measured on."""

from pathlib import Path

from tactile_diffusers.cli.program import (
    Parser,
    add_checkpoint_argument,
    add_output_argument,
    add_seed_argument,
    existing_file,
    load_pipeline,
)
from tactile_diffusers.data.splits import SPLITS
from tactile_diffusers.evaluation.sections import QUICK, make_context


def open_study(script, description, argv=None):
    """Parses the arguments of a study and opens its checkpoint and data.

    Args:
        script (`str`): name of the script.
        description (`str`): for `--help`.
        argv (`list[str]`, *optional*): defaults to the command line.

    Returns:
        `Context`: with two segments per surface.
    """
    parser = Parser(prog=script, description=description)
    add_checkpoint_argument(parser)
    parser.add_argument(
        "--data", type=existing_file, required=True, metavar="PREPARED.h5", help="from examples/prepare_data.py"
    )
    add_output_argument(parser, "results as JSON and Markdown")
    parser.add_argument("--split", choices=SPLITS[1:], default="test", help="held-out surfaces; default: test")
    add_seed_argument(parser)
    parser.add_argument("--quiet", action="store_true", help="no progress bars; default: show them")
    arguments = parser.parse_args(argv)
    pipe = load_pipeline(arguments.checkpoint)
    output = Path(arguments.output)
    output.mkdir(parents=True, exist_ok=True)
    return make_context(pipe, arguments.data, arguments.split, QUICK, arguments.seed, output, quiet=arguments.quiet)
