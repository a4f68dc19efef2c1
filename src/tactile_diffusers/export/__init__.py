"""Textures as files: one module per format."""

from .figure import write_figure
from .npz import write_npz
from .wav import read_wav, write_wav

__all__ = ["read_wav", "write_figure", "write_npz", "write_wav"]
