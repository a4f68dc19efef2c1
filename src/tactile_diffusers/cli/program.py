"""What commands share: the name of the running one, how options are spelt, and what is refused."""

import argparse
import sys
import tempfile

#: Of the entry point.
NAME = "tactile-diffusers"


def program(script):
    """`script`, or the command of the entry point if it was called by that (`cli.main` sets it)."""
    return sys.argv[0] if sys.argv[0].startswith(f"{NAME} ") else script


class Parser(argparse.ArgumentParser):
    """An option may be written with hyphens or with underscores, whichever of them `--help` shows."""

    def parse_known_args(self, args=None, namespace=None):
        words = sys.argv[1:] if args is None else args
        return super().parse_known_args([self._as_declared(word) for word in words], namespace)

    def _as_declared(self, word):
        name, equals, value = word.partition("=")
        if not name.startswith("--"):
            return word
        others = ("--" + name[2:].replace("-", "_"), "--" + name[2:].replace("_", "-"))
        return next((other for other in (name, *others) if other in self._option_string_actions), name) + equals + value


def refuse(script, error):
    """Says on stderr, in one line, why a command stops.

    Returns:
        `int`: its exit code, 2.
    """
    print(f"{program(script)}: error: {' '.join(str(error).split())}", file=sys.stderr)
    return 2


def check_seed(parser, seed, count=1):
    """Refuses a seed that generators and files do not take, or that counts beyond it.

    Raises:
        SystemExit: with exit code 2 and a line that names the argument and the value.
    """
    if not 0 <= seed <= 2**63 - count:
        parser.error(f"argument --seed: must be at least 0 and below 2**63, got {seed}")


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
