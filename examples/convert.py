"""A texture from one format to another, and what was lost: `python examples/convert.py --help`."""

import sys

from tactile_diffusers.cli.convert import main

if __name__ == "__main__":
    sys.exit(main())
