"""The texture that you prefer, by comparisons of two: `python examples/search.py --help`."""

import sys

from tactile_diffusers.cli.search import main

if __name__ == "__main__":
    sys.exit(main())
