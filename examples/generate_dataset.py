"""Generate many textures: `accelerate launch examples/generate_dataset.py --num_textures 1000 --output out`."""

import sys

from tactile_diffusers.cli.generate_dataset import main

if __name__ == "__main__":
    sys.exit(main())
