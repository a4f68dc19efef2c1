"""Textures as files: one module per format, and `FORMATS`, the table of them."""

from .ahap import read_ahap, write_ahap
from .figure import write_figure
from .formats import FORMATS, Format
from .generated import read_generated
from .haptic import read_haptic, write_haptic
from .hdf5 import read_hdf5, write_hdf5
from .hjif import read_hjif, write_hjif
from .npz import read_npz, write_npz
from .png import read_png, write_png
from .wav import read_wav, write_wav

__all__ = [
    "FORMATS",
    "Format",
    "read_ahap",
    "read_generated",
    "read_haptic",
    "read_hdf5",
    "read_hjif",
    "read_npz",
    "read_png",
    "read_wav",
    "write_ahap",
    "write_figure",
    "write_haptic",
    "write_hdf5",
    "write_hjif",
    "write_npz",
    "write_png",
    "write_wav",
]
