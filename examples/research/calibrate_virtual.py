"""Recomputes the constants of the virtual percepts, after a change of the recipe: `python calibrate_virtual.py`."""

import json
from pathlib import Path

from tactile_diffusers import virtual

if __name__ == "__main__":
    path = Path(virtual.__file__).parent / virtual.CALIBRATION_FILE
    path.write_text(json.dumps(virtual.calibrate(), indent=2) + "\n")
    print(f"wrote {path}")
