"""Textures under a moving finger: position in, force out."""

from ..lazy import importing
from .finger import FingerPath
from .profile import TextureProfile
from .stream import TextureStream
from .trajectory import PlayedTrajectory, play_trajectory, read_trajectory

#: What generates while it plays, and so imports the models, when it is first asked for.
_GENERATING = {
    ".endless": ("EndlessProfile", "EndlessStream"),
    ".process": ("GeneratingProcess", "on_time"),
    ".scene": ("TextureScene",),
}
__all__ = ["FingerPath", "PlayedTrajectory", "TextureProfile", "TextureStream", "play_trajectory", "read_trajectory"]
__all__ += [name for names in _GENERATING.values() for name in names]
__getattr__ = importing(__name__, _GENERATING)
