"""Generate a texture from ratings: `python examples/generate.py --ratings 1.5 0 -1 --output out`."""

import sys

from tactile_diffusers.cli.generate import main

if __name__ == "__main__":
    sys.exit(main())
