"""A recording closed to a loop: `python examples/loop.py recording.csv --output out`."""

import sys

from tactile_diffusers.cli.loop import main

if __name__ == "__main__":
    sys.exit(main())
