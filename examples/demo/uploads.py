"""What visitors upload: bytes of a CSV or WAV file become a texture."""

import math
import tempfile
from pathlib import Path

import numpy as np

from tactile_diffusers.data.folder import read_recording
from tactile_diffusers.data.folder.tables import read_table
from tactile_diffusers.signal import band_pass

#: Seconds of a recording that are used.
LONGEST_SECONDS = 10.0
#: Hz: no more than recorders have.
HIGHEST_RATE = 200_000
#: Columns of a table, and channels of a WAV file: memory is taken for all of them.
MOST_COLUMNS = 64


def read_upload(content, csv_rate, newtons_per_unit=1.0):
    """Reads a recording as a texture: the first seconds of it, through the band-pass.

    The file lies in a temporary folder while it is read, under a name of ours.

    Args:
        content (`bytes`): a WAV file, of several channels the first, or a table in text that `read_recording` takes:
            one column of lateral force, or columns with names or time stamps that say which is which.
        csv_rate (`float`): Hz, for a table of one column.
        newtons_per_unit (`float`): N per unit of the numbers; 1 = as the name of the column states, else N.

    Returns:
        `tuple[np.ndarray, int, list[str]]`: (samples,) float64 in N with zero mean, the sampling rate in Hz, and notes.

    Raises:
        ValueError: for anything that is neither kind of file, or a rate or length out of bounds.
    """
    if not content:
        raise ValueError("The file is empty: choose a CSV or WAV file.")
    if not 0 < newtons_per_unit < math.inf:
        raise ValueError(f"Newtons per unit must be above 0, got {newtons_per_unit}.")
    is_wav = content[:4] == b"RIFF"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / ("upload.wav" if is_wav else "upload.csv")
        path.write_bytes(content)
        try:
            columns = read_table(path, max_rows=100).names
            if len(columns) > MOST_COLUMNS:
                raise ValueError(f"The file has {len(columns)} columns; {MOST_COLUMNS} at most.")
            rate = csv_rate if not is_wav and len(columns) == 1 else None
            scale = None if newtons_per_unit == 1 else newtons_per_unit
            force, rate, notes = read_recording(path, 0 if is_wav else None, rate, scale)
        except ValueError as error:
            raise ValueError(_without_path(error, path)) from error
    if rate > HIGHEST_RATE:
        raise ValueError(f"The sampling rate must be at most {HIGHEST_RATE} Hz, got {rate}.")
    force = force[: int(LONGEST_SECONDS * rate)]
    if np.ptp(force) == 0:
        raise ValueError("The recording is constant: there is no texture in it.")
    return band_pass(force - force.mean(), rate), rate, [_without_path(note, path) for note in notes]


def _without_path(text, path):
    """A message for visitors, who neither know the path nor give options of the command."""
    text = str(text).replace(f"{path}", "The file")
    return text.replace("give --rate, in Hz", "give the sampling rate in a file of one column").replace(
        " (--column)", ""
    )
