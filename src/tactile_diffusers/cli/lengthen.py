"""`tactile-diffusers continue`: a recording, longer."""

from .editing import editing_parser, run_edit
from .program import command, positive_number
from .recording_file import OPEN


@command("lengthen.py")
def main(argv=None):
    """Runs the command."""
    parser = editing_parser("lengthen.py", "Continue a recording of lateral force, which itself stays as it is.")
    parser.add_argument("--seconds", type=positive_number, required=True, help="s to append")
    arguments = parser.parse_args(argv)
    options = {"continue_s": arguments.seconds}, OPEN
    run_edit("lengthen.py", "continued", arguments, lambda *given: options)
