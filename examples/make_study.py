"""A study with people: `python examples/make_study.py make --data prepared.h5 --output study`."""

import sys

from tactile_diffusers.cli.make_study import main

if __name__ == "__main__":
    sys.exit(main())
