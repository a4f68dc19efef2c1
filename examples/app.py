"""Ratings to textures in a browser: `python examples/app.py`, then open the address that it prints."""

import sys

from tactile_diffusers.cli.app.serve import main

if __name__ == "__main__":
    sys.exit(main())
