"""Adapt a pipeline to your surfaces: `accelerate launch examples/adapt.py --train_data_dir lab.h5 --output_dir out`."""

import sys

from tactile_diffusers.cli.adapt import main

if __name__ == "__main__":
    sys.exit(main())
