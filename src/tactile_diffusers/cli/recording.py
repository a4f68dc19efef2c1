"""One recording from a file of almost any kind, as the pipeline takes it."""

from pathlib import Path

import numpy as np

from ..data.folder.tables import kind_of, read_table
from ..export.wav import read_wav, sidecar_path
from ..signal import BAND_HZ, band_pass

#: A recording must last longer than this, s: two periods of the lowest frequency on either side of one more.
SHORTEST_SECONDS = 0.25


def read_recording(path, column=None, rate=None, newtons_per_unit=None):
    """Lateral force (or any signal that stands for it) from a table, band-passed and without its mean.

    Args:
        path (`str` or `Path`): csv, xlsx, npy, npz, mat, hdf5, parquet or wav; a WAV file of ours, with its sidecar,
            comes back in newtons.
        column (`str` or `int`, *optional*): name, or index from 0; may be left out where there is one.
        rate (`float`, *optional*): Hz; may be left out where the file says so.
        newtons_per_unit (`float`, *optional*): of the file's numbers, instead of 1 or what a sidecar says.

    Returns:
        `tuple[np.ndarray, int]`: (samples,) float64 and the sampling rate.

    Raises:
        ValueError: naming the file, what is wrong with it and the remedy.
        FileNotFoundError: if there is no such file.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"There is no file {path}.")
    if kind_of(path) is None:
        raise ValueError(f"{path} is of no kind that can be read: use csv, xlsx, npy, npz, mat, hdf5, parquet or wav.")
    if newtons_per_unit is None and sidecar_path(path).is_file():
        texture, metadata = read_wav(path)
        return _prepared(texture, metadata["sampling_rate"], path)
    table = read_table(path)
    if column is None and len(table.names) > 1:
        raise ValueError(f"{path} has several columns; say which one is the force: {', '.join(table.names[:12])}.")
    values = table.numbers(table.names[0] if column is None else _column(table, column))
    rate = table.rate if rate is None else rate
    if rate is None:
        raise ValueError(f"{path} does not say its sampling rate; give it in Hz.")
    return _prepared(values * (newtons_per_unit or 1.0), rate, path)


def _column(table, column):
    return int(column) if str(column).isdigit() and column not in table.names else column


def _prepared(values, rate, path):
    if not (rate >= 2.5 * BAND_HZ[1] and rate % 1 == 0):  # NaN and infinity fail too
        least = 2.5 * BAND_HZ[1]
        raise ValueError(f"The sampling rate of {path} must be a whole number of at least {least:g} Hz, got {rate}.")
    if odd := np.count_nonzero(~np.isfinite(values)):
        raise ValueError(f"{path} has {odd} samples that are no number; repair them.")
    if len(values) < SHORTEST_SECONDS * rate:
        raise ValueError(f"{path} lasts {len(values) / rate:.3g} s; at least {SHORTEST_SECONDS} s are needed.")
    return band_pass(values - values.mean(), rate), int(rate)
