"""What commands share in their messages: the name of the running one, and folders that are refused."""

import sys
import tempfile

#: Of the entry point.
NAME = "tactile-diffusers"


def program(script):
    """`script`, or the command of the entry point if it was called by that (`cli.main` sets it)."""
    return sys.argv[0] if sys.argv[0].startswith(f"{NAME} ") else script


def check_folders(parser, arguments):
    """Refuses a `--checkpoint` that is no folder, and an `--output` that is something else or cannot be written.

    Raises:
        SystemExit: with exit code 2 and a line that names the argument and the path.
    """
    if arguments.checkpoint is not None and not arguments.checkpoint.is_dir():
        parser.error(f"argument --checkpoint: {arguments.checkpoint} is not a folder")
    if arguments.output.exists() and not arguments.output.is_dir():
        parser.error(f"argument --output: {arguments.output} is not a folder")
    existing = next(path for path in (arguments.output, *arguments.output.absolute().parents) if path.is_dir())
    try:
        with tempfile.TemporaryFile(dir=existing):
            pass
    except OSError as error:
        parser.error(f"argument --output: {existing} cannot be written: {error.strerror}")
