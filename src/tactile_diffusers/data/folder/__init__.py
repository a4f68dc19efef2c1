"""Anyone's folder of recordings, described by `layout.toml`."""

from .convert import ConversionReport, convert_folder
from .draft import draft_layout, inspect_folder
from .layout import Layout
from .layout_text import load_layout
from .recording import read_recording

__all__ = [
    "ConversionReport",
    "Layout",
    "convert_folder",
    "draft_layout",
    "inspect_folder",
    "load_layout",
    "read_recording",
]
