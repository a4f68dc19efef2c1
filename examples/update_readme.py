"""Copy the excerpts of RESULTS.md that README.md quotes: `python examples/update_readme.py`."""

import sys

from tactile_diffusers.cli.update_readme import main

if __name__ == "__main__":
    sys.exit(main())
