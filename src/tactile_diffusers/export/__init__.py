"""Textures as files: `FORMATS`, the table of formats, and a function to write and one to read each."""

from .convert import FORMATS, Format, convert, format_of, read_texture, round_trip
from .device import BandLoss, DeviceLoss, DeviceProfile, what_is_lost
from .figure import write_figure
from .generated import read_generated
from .hjif import read_hjif, write_hjif
from .lossless import read_hdf5, read_npz, write_hdf5, write_npz
from .pcm import PCM, PCMStream
from .png import read_png, write_png
from .previews import read_ahap, read_haptic, write_ahap, write_haptic
from .wav import read_wav, write_wav

__all__ = ["BandLoss", "DeviceLoss", "DeviceProfile", "PCM", "PCMStream", "what_is_lost"]
__all__ += ["convert", "format_of", "read_texture"]
__all__ += ["FORMATS", "Format", "read_generated", "round_trip", "write_figure"]
__all__ += ["read_ahap", "read_haptic", "read_hdf5", "read_hjif", "read_npz", "read_png", "read_wav"]
__all__ += ["write_ahap", "write_haptic", "write_hdf5", "write_hjif", "write_npz", "write_png", "write_wav"]
