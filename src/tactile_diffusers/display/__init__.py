"""From the force that a finger should feel to the drive of a friction-modulation display."""

from .drive_files import read_drive_calibration
from .drive_fit import DriveFit, fit_drive_profile
from .drive_profile import DriveProfile
from .drive_stream import ClippingReport, DriveStream

__all__ = [
    "ClippingReport",
    "DriveFit",
    "DriveProfile",
    "DriveStream",
    "fit_drive_profile",
    "read_drive_calibration",
]
