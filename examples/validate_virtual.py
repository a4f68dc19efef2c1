"""Measure the laws of virtual surfaces: `python examples/validate_virtual.py --output laws`."""

import sys

from tactile_diffusers.cli.validate_virtual import main

if __name__ == "__main__":
    sys.exit(main())
