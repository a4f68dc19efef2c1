"""Make or convert recordings and prepare a data set: see --help."""

import sys

from tactile_diffusers.cli.prepare_data import main

if __name__ == "__main__":
    sys.exit(main())
