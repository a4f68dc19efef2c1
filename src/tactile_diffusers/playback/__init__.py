"""Textures under a moving finger: position in, force out."""

from .endless import EndlessProfile, EndlessStream
from .finger import FingerPath
from .process import GeneratingProcess, on_time
from .profile import TextureProfile
from .scene import TextureScene
from .stream import TextureStream
from .trajectory import PlayedTrajectory, play_trajectory, read_trajectory

__all__ = ["EndlessProfile", "EndlessStream", "FingerPath", "GeneratingProcess", "TextureProfile", "TextureScene"]
__all__ += ["PlayedTrajectory", "TextureStream", "on_time", "play_trajectory", "read_trajectory"]
