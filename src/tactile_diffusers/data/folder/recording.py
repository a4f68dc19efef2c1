"""One recording from a file of almost any kind: the lateral force that the pipeline reconstructs."""

from pathlib import Path

import numpy as np

from ...signal import BAND_HZ, REFERENCE_FORCE
from ...signal.masks import bridge_gaps, interpolated, true_runs
from ..projection import channels
from ..recordings import FORMAT, RecordingsFile
from ..segments import SegmentLimits
from .clocks import on_stamps
from .draft_tables import UNITS, describe_table, split_unit
from .layout import FORCE_UNITS, TIME_UNITS
from .tables import few, kind_of, list_tables, read_table
from .trees import open_tree

#: A recording must last longer than this, s: two periods of the lowest frequency on either side of one more.
SHORTEST_SECONDS = 0.25
#: Gaps up to this, s, are bridged by straight lines, as preparation does.
LONGEST_GAP = SegmentLimits().longest_excursion
#: N, RMS of a texture: a fifth of the normal force, beyond what fingers meet.
LARGEST_RMS = REFERENCE_FORCE / 5


def read_recording(path, column=None, rate=None, newtons_per_unit=None, recording=None):
    """Reads the lateral force (or any signal that stands for it) of one recording.

    A table gives one column, in the unit that its name states ("Fx_mN"; default: N), at the rate that the file or its
    time stamps state. `recordings.h5` gives the force along the sliding direction. Gaps of up to 0.1 s are bridged by
    straight lines; of a recording with longer ones the longest part between them is used.

    Args:
        path (`str` or `Path`): csv, xlsx, npy, npz, mat, hdf5, parquet, wav, or a `recordings.h5`.
        column (`str` or `int`, *optional*): name, or index from 0; default: the only one that can be a force.
        rate (`float`, *optional*): Hz; default: the file's, or that of its time stamps.
        newtons_per_unit (`float`, *optional*): N per unit of the numbers; default: by the name of the column.
        recording (`str`, *optional*): of `recordings.h5` "surface/explorer/trial", of other files the sheet or the
            place inside; default: the first.

    Returns:
        `tuple[np.ndarray, int, list[str]]`: force (samples,) float64 in N with its mean, the rate in Hz, and notes on
        what was chosen, bridged or left out.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: naming the file, what is wrong with it and the remedy.
    """
    path, notes = Path(path), []
    if not path.is_file():
        raise FileNotFoundError(f"There is no file {path}.")
    if kind_of(path) is None:
        raise ValueError(f"{path} is of no kind that can be read: use csv, xlsx, npy, npz, mat, hdf5, parquet or wav.")
    if kind_of(path) == "hdf5" and open_tree(path, "hdf5").attributes.get("format") == FORMAT:
        force, rate = _stored(path, recording, newtons_per_unit, notes)
    else:
        force, rate = _column_of_table(path, column, rate, newtons_per_unit, recording, notes)
    if not (rate >= 2.5 * BAND_HZ[1] and rate % 1 == 0):  # NaN and infinity fail too
        least = 2.5 * BAND_HZ[1]
        raise ValueError(f"The sampling rate of {path} must be a whole number of at least {least:g} Hz, got {rate}.")
    force = _without_gaps(force, rate, path, notes)
    if len(force) < SHORTEST_SECONDS * rate:
        raise ValueError(f"{path} lasts {len(force) / rate:.3g} s; at least {SHORTEST_SECONDS} s are needed.")
    return force, int(rate), notes


def _stored(path, name, newtons_per_unit, notes):
    """Force along the sliding direction, and its rate, from `recordings.h5`."""
    with RecordingsFile(path) as file:
        if name is None:
            name = file.names[0]
            notes.append(f"{path}: {name} is used, the first of {len(file)} recordings")
        if name not in file.names:
            raise ValueError(f"{path} has no recording {name!r}; it has {few(file.names, 5)}.")
        stored = file.read(name)
    if stored.unit != "N" and newtons_per_unit is None:
        raise ValueError(f"{path} holds uncalibrated numbers, not newtons: give `newtons_per_unit`.")
    data = channels(stored, "keep")
    notes += [f"{path}: {data.bridged[0]} samples in short gaps are bridged"] * bool(data.bridged[0])
    return data.lateral * (newtons_per_unit or 1.0), stored.rate


def _column_of_table(path, column, rate, newtons_per_unit, inside, notes):
    table = read_table(path, inside=inside)
    if not table.names and inside is None:
        tables = list_tables(path)
        if len(tables) > 1:
            places = few([str(other.inside) for other in tables], 5)
            raise ValueError(f"{path} holds several tables; give one of {places} (`recording`).")
        table = tables[0] if tables else table
    if not table.names:
        raise ValueError(f"{path} holds no table of numbers.")
    facts = describe_table(table)
    if column is None:
        measured = [each for each in facts.columns if each.measures not in ("time", "counter", "text")]
        kinds = [[each for each in measured if each.measures == kind] for kind in ("lateral", "force")]
        found = next((kind for kind in kinds if len(kind) == 1), measured)
        if len(found) != 1 and len(table.names) > 1:
            names = ", ".join(table.names[:12])
            raise ValueError(f"{path} has several columns; say which one is the force: {names} (`column`).")
        column = found[0].name if found else 0
        if len(table.names) > 1:
            notes.append(f"{path}: column {column!r} is used as the lateral force")
    elif str(column).isdigit() and column not in table.names:
        column = int(column)
    name = table.name(column)
    values = table.numbers(name) * (_newtons(name, path) if newtons_per_unit is None else newtons_per_unit)
    rate = table.rate if rate is None else rate
    return (values, rate) if rate is not None else _on_its_stamps(facts, values, notes)


def _newtons(name, path):
    """N per unit of a column, by the unit in its name; 1 where there is none that is known."""
    unit = split_unit(name)[1]
    if unit in UNITS.values() and (unit not in FORCE_UNITS or unit == "1"):
        raise ValueError(
            f"{path}: column {name!r} is in {'counts' if unit == '1' else unit}, by its name; a force is needed. Give "
            "`newtons_per_unit` if it stands for one."
        )
    return FORCE_UNITS.get(unit, 1.0)


def _on_its_stamps(facts, values, notes):
    """Samples on the clock of the table's own time stamps, and its rate; NaN = dropped samples."""
    table, time = facts.table, facts.measuring("time").get("")
    if time is None or time.measures == "text":
        raise ValueError(
            f"{table.path} does not state its sampling rate, and has no column of time: give `rate`, in Hz."
        )
    if facts.time_unit is None or facts.stamps_coarse:
        fault = "are coarser than the samples" if facts.stamps_coarse else "have no unit in the column's name"
        raise ValueError(f"{table.path}: the time stamps of column {time.name!r} {fault}: give `rate`, in Hz.")
    stamps = table.numbers(time.name) * TIME_UNITS[facts.time_unit]
    try:
        clock = on_stamps(values[:, None], stamps, None, table.where, table.place)
    except ValueError as error:
        raise ValueError(
            f"{table.path}: column {time.name!r} gives no sampling rate: give `rate`, in Hz. {error}"
        ) from None
    notes += [f"{table.path}: {count} samples {kind}, {place}" for kind, (count, place) in clock.counts.items()]
    return clock.values[:, 0], clock.rate


def _without_gaps(force, rate, path, notes):
    """The longest part without a long gap; short gaps are bridged."""
    missing = ~np.isfinite(force)
    if not missing.any():
        return force
    if missing.all():
        raise ValueError(f"{path}: the force holds no number.")
    usable = bridge_gaps(~missing, int(round(LONGEST_GAP * rate)))
    start, stop = max(true_runs(usable).tolist(), key=lambda run: run[1] - run[0])
    bridged = int(missing[start:stop].sum())
    if bridged:
        notes.append(f"{path}: {bridged} samples that are missing or no number are bridged")
    if stop - start < len(force):
        notes.append(
            f"{path}: {start / rate:.3f} to {stop / rate:.3f} s are used, between gaps longer than {LONGEST_GAP} s"
        )
    return interpolated(force[start:stop], missing[start:stop])
