"""`tactile-diffusers loop`: a recording whose end leads into its beginning."""

import math

from ..signal.constants import RATING_AXES
from .editing import editing_parser, run_edit
from .program import command, positive_number


@command("loop.py")
def main(argv=None):
    """Runs the command."""
    parser = editing_parser("loop.py", "Close a recording of lateral force: its end leads into its beginning.")
    parser.add_argument("--seconds", type=positive_number, help="s to append, from the end to the beginning; "
        "default: 0.1 s on either side of the seam are made anew")  # fmt: skip
    arguments = parser.parse_args(argv)
    options = {"loop": True, "continue_s": arguments.seconds}, [math.nan] * len(RATING_AXES)
    run_edit("loop.py", "loop", arguments, lambda *given: options)
