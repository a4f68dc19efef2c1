"""`tactile-diffusers loop`: a recording whose end leads into its beginning."""

from .editing import editing_parser, run_edit
from .program import command, positive_number
from .recording_file import OPEN


@command("loop.py")
def main(argv=None):
    """Runs the command."""
    parser = editing_parser("loop.py", "Close a recording of lateral force: its end leads into its beginning.")
    parser.add_argument("--seconds", type=positive_number, help="s to append, from the end to the beginning; "
        "default: 0.1 s on either side of the seam are made anew")  # fmt: skip
    arguments = parser.parse_args(argv)
    options = {"loop": True, "continue_s": arguments.seconds}, OPEN
    run_edit("loop.py", "loop", arguments, lambda *given: options)
