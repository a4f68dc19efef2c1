"""A recording through encoder and decoder: `python examples/reconstruct.py recording.csv --rate 10000 --output out`."""

import sys

from tactile_diffusers.cli.reconstruct import main

if __name__ == "__main__":
    sys.exit(main())
