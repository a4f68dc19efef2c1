"""Measure speed and memory of the pipeline: `python examples/benchmark.py --output report`."""

import sys

from tactile_diffusers.cli.benchmark import main

if __name__ == "__main__":
    sys.exit(main())
