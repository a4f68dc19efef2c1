"""A recording changed by ratings: `python examples/edit.py recording.csv --roughness 0.5 --output out`."""

import sys

from tactile_diffusers.cli.edit import main

if __name__ == "__main__":
    sys.exit(main())
