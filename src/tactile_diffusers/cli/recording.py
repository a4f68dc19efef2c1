"""One recording from a file of almost any kind, as the pipeline takes it."""

from pathlib import Path

import numpy as np

from ..data.folder.clocks import on_stamps
from ..data.folder.draft_columns import UNITS, describe_table, split_unit
from ..data.folder.layout import FORCE_UNITS, TIME_UNITS
from ..data.folder.tables import kind_of, read_table
from ..export.wav import read_wav, sidecar_path
from ..signal import BAND_HZ, REFERENCE_FORCE, band_pass

#: A recording must last longer than this, s: two periods of the lowest frequency on either side of one more.
SHORTEST_SECONDS = 0.25
#: N, RMS of a texture: a fifth of the normal force, beyond what fingers meet.
LARGEST_RMS = REFERENCE_FORCE / 5


def read_recording(path, column=None, rate=None, newtons_per_unit=None):
    """Lateral force (or any signal that stands for it) from a table, band-passed and without its mean.

    Args:
        path (`str` or `Path`): csv, xlsx, npy, npz, mat, hdf5, parquet or wav; a WAV file of ours, with its sidecar,
            comes back in newtons.
        column (`str` or `int`, *optional*): name, or index from 0; may be left out where there is one.
        rate (`float`, *optional*): Hz; may be left out where the file says so, or has a column of time stamps.
        newtons_per_unit (`float`, *optional*): of the file's numbers, instead of 1 or what a sidecar or the unit in the
            column's name says.

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
    # other kinds may have a JSON file beside them, too, but it is not ours
    if newtons_per_unit is None and kind_of(path) == "wav" and sidecar_path(path).is_file():
        texture, metadata = read_wav(path)
        return _prepared(texture, metadata["sampling_rate"], path)
    table = read_table(path)
    if column is None and len(table.names) > 1:
        raise ValueError(
            f"{path} has several columns; say which one is the force: {', '.join(table.names[:12])} (--column)."
        )
    name = table.name(0 if column is None else _column(table, column))
    values = table.numbers(name) * (_newtons(name, path) if newtons_per_unit is None else newtons_per_unit)
    rate = table.rate if rate is None else rate
    if rate is None:
        values, rate = _on_its_stamps(table, values)
    return _prepared(values, rate, path)


def _newtons(name, path):
    """Newtons per unit of a column, by the unit in its name; 1 where there is none that is known."""
    unit = split_unit(name)[1]
    if unit in UNITS.values() and unit not in FORCE_UNITS:
        raise ValueError(
            f"{path}: column {name!r} is in {unit}, by its name; a force is needed. Give --newtons_per_unit if it "
            "stands for one."
        )
    return FORCE_UNITS.get(unit, 1.0)


def _on_its_stamps(table, values):
    """Samples on the clock of the table's own time stamps, and its rate; NaN = dropped samples."""
    facts = describe_table(table, [], head_only=False)
    time = facts.measuring("time").get("")
    if time is None or time.measures == "text":
        raise ValueError(f"{table.path} does not say its sampling rate, and has no column of time: give --rate, in Hz.")
    if facts.time_unit is None or facts.stamps_coarse:
        fault = "are coarser than the samples" if facts.stamps_coarse else "have no unit in the column's name"
        raise ValueError(f"{table.path}: the time stamps of column {time.name!r} {fault}: give --rate, in Hz.")
    stamps = table.numbers(time.name) * TIME_UNITS[facts.time_unit]
    try:
        clock = on_stamps(values[:, None], stamps, None, table.where, table.place)
    except ValueError as error:
        raise ValueError(
            f"{table.path}: column {time.name!r} gives no sampling rate: give --rate, in Hz. {error}"
        ) from None
    return clock.values[:, 0], clock.rate


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
