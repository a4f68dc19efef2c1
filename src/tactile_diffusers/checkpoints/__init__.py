"""The checkpoint that comes with the package."""

from pathlib import Path

#: Names of the surfaces that a published checkpoint was trained on, in place of the trainings' `training.json`.
SURFACES_FILE = "trained_on.json"


def bundled_checkpoint():
    """Folder of the bundled checkpoint, trained on virtual surfaces; see its README.md for how.

    Returns:
        `str`: a path for `TactileTexturePipeline.from_pretrained`.
    """
    return str(Path(__file__).parent / "virtual-surfaces")
