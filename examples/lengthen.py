"""A recording, longer: `python examples/lengthen.py recording.csv --seconds 2 --output out`."""

import sys

from tactile_diffusers.cli.edit import lengthen as main

if __name__ == "__main__":
    sys.exit(main())
