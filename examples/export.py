"""Write textures for devices and other programs: `python examples/export.py --input out --output files`."""

import sys

from tactile_diffusers.cli.export import main

if __name__ == "__main__":
    sys.exit(main())
