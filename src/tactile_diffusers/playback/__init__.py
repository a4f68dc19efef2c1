"""Textures under a moving finger: position in, force out."""

from .endless import EndlessProfile, EndlessStream
from .finger import FingerPath
from .process import GeneratingProcess, on_time
from .profile import TextureProfile
from .scene import TextureScene
from .stream import TextureStream

__all__ = ["EndlessProfile", "EndlessStream", "FingerPath", "GeneratingProcess", "TextureProfile", "TextureScene"]
__all__ += ["TextureStream", "on_time"]
