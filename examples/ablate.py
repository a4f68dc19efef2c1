"""Train and measure the rows of an ablation: `python examples/ablate.py --data prepared.h5 --output runs/ablation`."""

import sys
from pathlib import Path

from tactile_diffusers.cli.ablate import main

if __name__ == "__main__":
    sys.exit(main(Path(__file__).parent))
