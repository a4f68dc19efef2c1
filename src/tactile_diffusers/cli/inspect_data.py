"""`python examples/inspect_data.py`: a data card of recordings, in words, numbers and pictures."""

import argparse
import sys
from pathlib import Path

from .program import Parser, program, refuse

DESCRIPTION = """\
Writes a data card of any recordings.h5: what is in it, what preparation keeps and why it drops the rest, levels,
spectra, friction and ratings of the surfaces, and warnings worth acting on.

  OUTPUT/card.md    tables, warnings and pictures
  OUTPUT/card.json  every number
"""


def parse_arguments(argv=None):
    """Arguments of the command.

    Raises:
        SystemExit: on bad arguments, with exit code 2 and a line that says what is wrong.
    """
    parser = Parser(
        prog=program("inspect_data.py"), description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--recordings", type=Path, required=True, metavar="RECORDINGS.h5", help="what to describe")
    parser.add_argument(
        "--prepared",
        type=Path,
        metavar="PREPARED.h5",
        help="prepared from these recordings; without it they are prepared with the default limits, into a file that "
        "is removed again",
    )
    parser.add_argument(
        "--output", type=Path, required=True, metavar="FOLDER", help="new, or an older card, which is replaced"
    )
    parser.add_argument("--quiet", action="store_true", help="no progress bars")
    arguments = parser.parse_args(argv)
    for name in ("recordings", "prepared"):
        path = getattr(arguments, name)
        if path is not None and not path.is_file():
            parser.error(f"argument --{name}: there is no file {path}")
    return arguments


def main(argv=None):
    """Runs the command; prints the head of the card.

    Args:
        argv (`list[str]`, *optional*): defaults to the command line.

    Returns:
        `int`: the exit code, 2 on bad input.
    """
    arguments = parse_arguments(argv)
    from ..data.card import summary, write_card

    if arguments.prepared is None:
        print("No --prepared: preparing with the default limits into a temporary file.")
    try:
        card = write_card(arguments.recordings, arguments.output, arguments.prepared, arguments.quiet)
    except (ValueError, OSError) as error:
        return refuse("inspect_data.py", error)
    print(f"{summary(card)}\n\nwrote {arguments.output / 'card.md'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
