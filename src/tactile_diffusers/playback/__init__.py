"""Textures under a moving finger: position in, force out."""

import importlib

from .finger import FingerPath
from .profile import TextureProfile
from .stream import TextureStream
from .trajectory import PlayedTrajectory, play_trajectory, read_trajectory

#: What generates while it plays, and so imports the models, when it is first asked for.
_GENERATING = {
    "EndlessProfile": ".endless",
    "EndlessStream": ".endless",
    "GeneratingProcess": ".process",
    "TextureScene": ".scene",
    "on_time": ".process",
}
__all__ = ["FingerPath", "PlayedTrajectory", "TextureProfile", "TextureStream", "play_trajectory", "read_trajectory"]
__all__ += _GENERATING


def __getattr__(name):
    if name not in _GENERATING:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = globals()[name] = getattr(importlib.import_module(_GENERATING[name], __name__), name)
    return found
