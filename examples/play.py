"""The force that a finger meets along a trajectory: `python examples/play.py --help`."""

import sys

from tactile_diffusers.cli.play import main

if __name__ == "__main__":
    sys.exit(main())
