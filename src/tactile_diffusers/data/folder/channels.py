"""One recording from its files: units, signs, one clock, velocity, and NaN for what no sensor measured."""

from dataclasses import replace

import numpy as np

from ...signal import BAND_HZ, resample
from ...signal.constants import LEAST_RECORDING
from ..force_checks import check_forces, out_of_range
from .clocks import (
    RATE_TOLERANCE,
    SHORTEST_SHARE,
    Timed,
    Unusable,
    bridged,
    on_one_clock,
    on_stamps,
    velocity_from_position,
    whole,
)

#: Median speeds of a finger (mm/s), and normal forces (N, median of the size), outside of these are probably in another
#: unit (recipe).
LIKELY_SPEED, LIKELY_FORCE = (1.0, 1000.0), (0.01, 30.0)
#: No finger that explores a surface moves faster (mm/s, median): the unit is wrong (recipe).
LARGEST_SPEED = 10_000.0


def read_channels(channels, filter, report):
    """Reads one recording: keyword arguments of `RecordingsWriter.add_recording`.

    Args:
        channels (`dict[str, Source]`): the tables that hold "force" or "lateral", and "position" or "velocity".
        filter (`VelocityLayout`): makes velocity from position.
        report (`ConversionReport`): receives notes.

    Raises:
        Unusable: if it is to be left out.
        ValueError: if a unit, an axis or a clock is wrong.
    """
    read = {}
    for source in dict.fromkeys(channels.values()):
        read |= _read_source(source, [channel for channel in channels if channels[channel] is source], report)
    kind = "force" if "force" in read else "lateral"
    files, unit = channels[kind].files, "1" if getattr(channels[kind].files, kind).unit == "1" else "N"
    force, motion = read[kind], read.get("velocity")
    if "position" in read:
        position = read["position"]
        _check_usable(position)
        slope = velocity_from_position(position.values, position.true_rate, filter.window, filter.order)
        motion = replace(position, values=slope)
    if motion is not None:
        before, (force, motion) = (force, motion), on_one_clock(force, motion)
        shorter, longer = sorted((force, motion), key=lambda channel: channel.seconds)
        if shorter.seconds < SHORTEST_SHARE * longer.seconds:
            place = f"{shorter.where} ({shorter.seconds:.3g} s, {longer.where} {longer.seconds:.3g} s)"
            report.note(f"recordings: force and motion {_why_shorter(*before)}", 1, place)
    for channel in (force, motion):
        if channel is not None:
            _check_usable(channel)
            report.note_counts(channel.counts, channel.where)  # of the common clock
    _check_force(force, kind, unit, report)
    if files.resample not in (None, force.rate):
        report.note(f"recordings resampled to {files.resample:g} Hz", 1, f"{force.where} ({force.rate:g} Hz)")
        force = _resampled(force, files.resample, unit)
    arrays = {kind: _shaped(force.values, kind), f"{kind}_rate": force.rate, "unit": unit}
    if motion is not None:
        _check_speed(motion, channels, report)
        velocity = motion.values
        if velocity.shape[1] == 1:
            velocity = np.concatenate([velocity, 0.0 * velocity], axis=1)
        arrays |= {"velocity": velocity, "velocity_rate": motion.rate}
    return arrays


def _why_shorter(force, motion):
    """Why little of force and motion is left in common: `Timed` as they were read."""
    lengths = sorted((force.seconds, motion.seconds))
    if lengths[0] < SHORTEST_SHARE * lengths[1] or None in (force.start, motion.start):
        return "differ in length: is a rate wrong, or a file cut off?"
    apart = force.start + force.offset - motion.start
    return f"have clocks that begin apart: if both began together, set `offset` = {apart:.6g} in the files with motion"


def _read_source(source, channels, report):
    """The channels of one file as {channel: `Timed`}; what they share is noted once."""
    table, files = source.table(), source.files
    try:
        columns = [table.name(column) for channel in channels for column in getattr(files, channel).columns]
    except ValueError as error:
        raise ValueError(f"{error} Files with other columns need a [[files]] of their own, with `where`.") from error
    values = [table.numbers(column) for column in columns]
    stamps = table.numbers(files.time.column) * files.time.scale if files.time else None
    lengths = {len(column) for column in values} | ({len(stamps)} if files.time else set())
    if len(lengths) > 1 or not values[0].size:
        raise ValueError(
            f"{table.where}: columns {columns} have {sorted(lengths)} rows: describe columns of one length, and with "
            "rows, in one [[files]]."
        )
    values = np.stack(values, axis=-1)
    for column, count in table.unreadable.items():
        if count:
            report.note("cells that are no number, NaN", count, f"{table.where}, column {column!r}")
    missing = np.isnan(values).any(axis=1)
    if missing.any():
        place = f"{table.where}, {table.place(int(missing.argmax()))}"
        report.note("samples missing in the files, NaN", missing.sum(), place)
    clock = _on_clock(values, stamps, table, files)
    report.note_counts(clock.counts, clock.where)
    parts, start = {}, 0
    for channel in channels:
        described = getattr(files, channel)
        part = clock.values[:, start : start + len(described.columns)] * described.scale
        start += len(described.columns)
        if channel == "force":
            if described.y is None:
                part = np.insert(part, 1, 0.0, axis=1)
            part = part * [1, 1, described.normal_sign]
        parts[channel] = replace(clock, values=part, counts={})
    return parts


def _on_clock(values, stamps, table, files):
    if stamps is not None:
        return replace(on_stamps(values, stamps, files.rate, table.where, table.place), offset=files.offset)
    # a declared rate is meant as it is written; one from a file's header may carry rounding
    rate = files.rate or (whole(table.rate) if table.rate else None)
    if rate is None:
        raise ValueError(f"{table.where} does not tell its rate: give `rate` or `time` in the layout.")
    if table.rate is not None and abs(table.rate / rate - 1) > RATE_TOLERANCE:
        raise ValueError(
            f"{table.where}: `rate` = {rate:g} Hz, but the file says {table.rate:g} Hz. Correct one of them."
        )
    return Timed(values, None, float(rate), float(rate), table.where, offset=files.offset)


def _check_usable(channel):
    if channel.seconds < LEAST_RECORDING:
        lasts = f"{channel.seconds:.3g} s in common, the filter needs {LEAST_RECORDING} s"
        raise Unusable(f"{channel.where}: {lasts}")
    if np.isnan(channel.values).any(axis=1).all():
        raise Unusable(f"{channel.where}: holds only NaN")


def _shaped(values, kind):
    """(n, 3) of `force`, (n,) of `lateral`."""
    return values if kind == "force" else values[:, 0]


def _check_force(force, kind, unit, report):
    """Refuses a force that no finger can have made, and notes what is only suspicious."""
    if force.rate != int(force.rate) or force.rate <= 2 * BAND_HZ[0]:
        raise ValueError(
            f"{force.where}: the rate of the force is {force.rate:.6g} Hz; it must be a whole number, and above "
            f"{2 * BAND_HZ[0]:g} Hz. Correct `rate` or the unit of `time`, or resample the force."
        )
    values = _shaped(force.values, kind)
    if (np.fmin.reduce(force.values) == np.fmax.reduce(force.values)).all():
        raise Unusable(f"{force.where}: the force never changes: nothing was connected")
    if kind == "force" and np.nanmean(values[:, 2]) < 0:
        report.note("recordings: z is negative on average: is `normal_sign` right?", 1, force.where)
    if kind == "force" and unit == "N":
        median = float(np.nanmedian(np.abs(values[:, 2])))
        if not LIKELY_FORCE[0] <= median <= LIKELY_FORCE[1]:
            what = f"recordings with a median normal force outside {LIKELY_FORCE} N: is the unit right?"
            report.note(what, 1, f"{force.where} ({median:.2g} N)")
    for note in check_forces(values, force.where, unit):  # "what (numbers)"
        what, _, detail = note.partition(" (")
        report.note(f"recordings: {what}", 1, f"{force.where} ({detail}")


def _resampled(channel, rate, unit):
    """At another rate; what lies beside a sample that is missing or out of the sensor's range is missing, too."""
    broken = out_of_range(channel.values, channel.rate, unit)
    known = np.where(broken[:, None], np.nan, channel.values)
    filled = bridged(known)
    mean = filled.mean(axis=0)  # the filter takes what is beyond the ends for zero
    values = resample((filled - mean).T, channel.rate, rate).T + mean
    gaps = np.isnan(known).any(axis=1)
    beside = np.interp(np.arange(len(values)) * (channel.rate / rate), np.arange(len(gaps)), gaps) > 0
    true_rate = channel.true_rate * rate / channel.rate
    return replace(channel, values=np.where(beside[:, None], np.nan, values), rate=rate, true_rate=true_rate)


def _check_speed(motion, channels, report):
    """Refuses speeds that no finger has, and notes unlikely ones."""
    speed = float(np.nanmedian(np.linalg.norm(motion.values, axis=1)))
    if speed > LARGEST_SPEED:
        name = "velocity" if "velocity" in channels else "position"
        unit = getattr(channels[name].files, name).unit
        raise ValueError(
            f"{motion.where}: with `unit` = {unit!r} of `{name}` the median speed is "
            f"{speed:,.0f} mm/s: is that unit right, and that of `time`? At most {LARGEST_SPEED:,.0f} mm/s are taken."
        )
    if not LIKELY_SPEED[0] <= speed <= LIKELY_SPEED[1]:
        report.note(f"recordings with a median speed outside {LIKELY_SPEED} mm/s: is the unit right?", 1, motion.where)
