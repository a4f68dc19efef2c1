"""Reports of several checkpoints side by side: `python examples/compare.py --report ours=report paper=report_paper`."""

import sys

from tactile_diffusers.cli.compare import main

if __name__ == "__main__":
    sys.exit(main())
