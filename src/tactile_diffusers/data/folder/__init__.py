"""Anyone's folder of recordings, described by `layout.toml`, and `recordings.h5` written out as such a folder."""

from .convert import ConversionReport, convert_folder
from .draft import draft_layout, inspect_folder
from .folder_export import export_folder
from .layout import Layout
from .layout_text import load_layout
from .recording import read_recording

__all__ = [
    "ConversionReport",
    "Layout",
    "convert_folder",
    "draft_layout",
    "export_folder",
    "inspect_folder",
    "load_layout",
    "read_recording",
]
