"""The name of the running command in its messages."""

import sys

#: Of the entry point.
NAME = "tactile-diffusers"


def program(script):
    """`script`, or the command of the entry point if it was called by that (`cli.main` sets it)."""
    return sys.argv[0] if sys.argv[0].startswith(f"{NAME} ") else script
