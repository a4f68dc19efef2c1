"""A recording closed to a loop: `python examples/loop.py recording.csv --output out`."""

import sys

from tactile_diffusers.cli.edit import loop as main

if __name__ == "__main__":
    sys.exit(main())
