"""Shared by the studies of a checkpoint: their arguments, and the held-out data that they are measured on."""

import sys
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

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.result_files import write_results
from report.sections import QUICK, make_context


def run_study(name, description, study, markdown, argv=None):
    """A study as a command: opens checkpoint and data, writes NAME.json and NAME.md, and prints the latter.

    Args:
        name (`str`): of the script and its results.
        description (`str`): for `--help`.
        study (`Callable`): `Context` -> results, a dict.
        markdown (`Callable`): results -> Markdown.
        argv (`list[str]`, *optional*): defaults to the command line.

    Returns:
        `int`: 0
    """
    context = open_study(f"{name}.py", description, argv)
    result = study(context)
    text = markdown(result) + "\n"
    write_results(context.output, name, result, text)
    print(text)
    return 0


def open_study(script, description, argv=None):
    """The `Context` of a study, two segments a surface, from its command line."""
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
