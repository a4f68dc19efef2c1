"""Pipelines with another LCTG: the distilled one that a checkpoint may bring."""

import copy
from pathlib import Path

from ..checkpoints import DISTILLED
from ..pipelines import TactileTexturePipeline


def distilled_folder(checkpoint):
    """The folder of the distilled LCTG that a checkpoint brings, or `None`."""
    folder = Path(checkpoint) / DISTILLED
    return folder if (folder / "config.json").is_file() else None


def with_lctg(pipe, lctg, **parts):
    """A pipeline with another LCTG, without progress bars.

    Args:
        pipe (`TactileTexturePipeline`): shares its other components, but for schedulers, which are copied.
        lctg (`LCTGModel`): whoever calls knows that its latents are those of `pipe`.
        parts: further components that take the place of those of `pipe`.

    Returns:
        `TactileTexturePipeline`
    """
    shared = {
        name: copy.deepcopy(part) if name.endswith("scheduler") else part for name, part in pipe.components.items()
    }
    made = TactileTexturePipeline(**{**shared, "lctg": lctg, **parts})
    made.set_progress_bar_config(disable=True)
    return made
