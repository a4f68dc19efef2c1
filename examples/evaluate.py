"""Evaluate a checkpoint on held-out surfaces: `python examples/evaluate.py --data prepared.h5 --output report`."""

import sys

from tactile_diffusers.cli.evaluate import main

if __name__ == "__main__":
    sys.exit(main())
