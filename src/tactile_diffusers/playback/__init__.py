"""Textures under a moving finger: position in, force out."""

from .endless import EndlessProfile, EndlessStream
from .finger import FingerPath
from .on_time import on_time
from .process import GeneratingProcess
from .profile import TextureProfile
from .scene import TextureScene
from .stream import TextureStream

__all__ = [
    "EndlessProfile",
    "EndlessStream",
    "FingerPath",
    "GeneratingProcess",
    "TextureProfile",
    "TextureScene",
    "TextureStream",
    "on_time",
]
