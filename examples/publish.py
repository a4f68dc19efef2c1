"""Make a trained pipeline small and documented: `python examples/publish.py --help`."""

import sys

from tactile_diffusers.cli.publish import main

if __name__ == "__main__":
    sys.exit(main())
