"""Textures under a moving finger, and the drive of the display that makes them felt."""

from .drive import DriveProfile
from .drive_files import read_drive_calibration
from .drive_fit import DriveFit, fit_drive_profile
from .drive_stream import ClippingReport, DriveStream
from .endless import EndlessProfile, EndlessStream
from .finger import FingerPath
from .generating import GeneratingProcess
from .on_time import on_time
from .profile import TextureProfile
from .scene import TextureScene
from .stream import TextureStream

__all__ = [
    "ClippingReport",
    "DriveFit",
    "DriveProfile",
    "DriveStream",
    "EndlessProfile",
    "EndlessStream",
    "FingerPath",
    "GeneratingProcess",
    "TextureProfile",
    "TextureScene",
    "TextureStream",
    "fit_drive_profile",
    "on_time",
    "read_drive_calibration",
]
