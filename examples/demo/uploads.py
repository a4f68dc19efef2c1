"""What visitors upload becomes a texture, by the package's one reader of recordings."""

import math
from pathlib import Path

import numpy as np

from tactile_diffusers.data.folder import read_recording
from tactile_diffusers.data.folder.tables import KINDS as _KINDS
from tactile_diffusers.data.folder.tables import read_table
from tactile_diffusers.signal import band_pass

KINDS = tuple(_KINDS)
#: Seconds of a recording that are used; Hz, no more than recorders have; columns, or channels of a WAV file, since
#: memory is taken for all of them.
LONGEST_SECONDS, HIGHEST_RATE, MOST_COLUMNS = 10.0, 200_000, 64


def columns_of(path):
    """Names of a file's columns.

    Raises:
        ValueError: for anything that is no table.
    """
    table = _named(path, read_table, Path(path), max_rows=100)
    if len(table.names) > MOST_COLUMNS:
        raise ValueError(f"The file has {len(table.names)} columns; {MOST_COLUMNS} at most.")
    return list(table.names)


def read_upload(path, column=None, rate=None, newtons_per_unit=None):
    """Reads a recording as a texture: the first seconds of it, through the band-pass.

    Args:
        path (`str`): of what `read_recording` takes.
        column (`str`, *optional*): that is the force; default: the reader's choice; of a WAV file the first channel
            that is not constant.
        rate (`float`, *optional*): Hz; default: the file's, or that of its time stamps.
        newtons_per_unit (`float`, *optional*): N per unit of the numbers; default, and 1: as the name of the column
            states, else N.

    Returns:
        `tuple[np.ndarray, int, list[str]]`: (samples,) float64 in N with zero mean, the sampling rate in Hz, and notes.

    Raises:
        ValueError: for anything that is no such file, or a rate or length out of bounds.
    """
    path = Path(path)
    if not path.is_file():
        raise ValueError("The file is no longer here, uploads are deleted after 15 minutes: give it again.")
    if not path.stat().st_size:
        raise ValueError("The file is empty.")
    if newtons_per_unit is None:
        newtons_per_unit = 1
    if not (isinstance(newtons_per_unit, int | float) and 0 < newtons_per_unit < math.inf):
        raise ValueError(f"Newtons per unit must be above 0, got {newtons_per_unit}.")
    names, chosen = columns_of(path), []
    if column is None and path.suffix.lower() == ".wav":
        table = _named(path, read_table, path)
        waves = (table.numbers(name) for name in names)
        column = next((number for number, wave in enumerate(waves) if (wave != wave[:1]).any()), 0)
        if len(names) > 1:
            chosen = [f"channel {column} of {', '.join(names)} is used; Column chooses another"]
    scale = None if newtons_per_unit == 1 else newtons_per_unit
    force, rate, notes = _named(path, read_recording, path, column, rate, scale)
    if rate > HIGHEST_RATE:
        raise ValueError(f"The sampling rate must be at most {HIGHEST_RATE} Hz, got {rate}.")
    notes = [*chosen, *notes]
    if len(force) > LONGEST_SECONDS * rate:
        notes.append(f"the first {LONGEST_SECONDS:g} s of {len(force) / rate:.4g} s are used")
    force = force[: int(LONGEST_SECONDS * rate)]
    if np.ptp(force) == 0:
        raise ValueError("The recording is constant: there is no texture in it.")
    unit = ", full scale is taken for 1 N" if path.suffix.lower() == ".wav" and scale is None else ""
    notes.append(f"the mean of {force.mean():.3g} N is taken away{unit}")
    return band_pass(force - force.mean(), rate), rate, [note.replace(str(path), path.name) for note in notes]


def _named(path, read, *arguments, **options):
    """What a reader returns; its errors name the file and no folder of the server."""
    try:
        return read(*arguments, **options)
    except ValueError as error:
        raise ValueError(str(error).replace(str(path), Path(path).name)) from error
