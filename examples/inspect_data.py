"""A data card of recordings: `python examples/inspect_data.py --recordings recordings.h5 --output card`."""

import argparse
import sys
from pathlib import Path

from data_card.writing import summary, write_card

from tactile_diffusers.cli.program import Parser, command, existing_file, program

DESCRIPTION = """\
Writes a data card of any recordings.h5: what is in it, what preparation keeps and why it drops the rest, levels,
spectra, friction and ratings of the surfaces, and warnings worth acting on.

  OUTPUT/card.md    tables, warnings and pictures
  OUTPUT/card.json  every number
"""


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = Parser(
        prog=program("inspect_data.py"), description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--recordings", type=existing_file, required=True, metavar="RECORDINGS.h5", help="what to describe")
    prepared = "prepared from these recordings; default: prepared with the default limits into a temporary file"
    add("--prepared", type=existing_file, metavar="PREPARED.h5", help=prepared)
    add("--output", type=Path, required=True, metavar="FOLDER", help="new, or an older card, which is replaced")
    add("--quiet", action="store_true", help="no progress bars")
    return parser.parse_args(argv)


@command("inspect_data.py")
def main(argv=None):
    """Runs the command; prints the head of the card."""
    arguments = parse_arguments(argv)
    if arguments.prepared is None:
        print("No --prepared: preparing with the default limits into a temporary file.")
    card = write_card(arguments.recordings, arguments.output, arguments.prepared, arguments.quiet)
    print(f"{summary(card)}\n\nwrote {arguments.output / 'card.md'}")


if __name__ == "__main__":
    sys.exit(main())
