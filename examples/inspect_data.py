"""A data card of recordings: `python examples/inspect_data.py --recordings recordings.h5 --output card`."""

import sys

from tactile_diffusers.cli.inspect_data import main

if __name__ == "__main__":
    sys.exit(main())
