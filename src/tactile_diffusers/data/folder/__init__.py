"""Anyone's folder of recordings, described by `layout.toml`, and `recordings.h5` written out as such a folder."""

from .conversion_report import ConversionReport
from .convert import convert_folder
from .draft import inspect_folder
from .draft_text import draft_layout
from .folder_export import export_folder
from .layout import Layout, load_layout
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
