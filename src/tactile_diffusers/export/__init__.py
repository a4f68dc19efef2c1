"""Textures as files: one module per format."""

from .figure import write_figure
from .generated import read_generated
from .npz import write_npz
from .wav import read_wav, write_wav

__all__ = ["read_generated", "read_wav", "write_figure", "write_npz", "write_wav"]
