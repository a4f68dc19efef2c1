"""Segments: windows of a recording inside the limits of force and speed (paper section 2.1)."""

from dataclasses import dataclass, fields, replace
from numbers import Real

import numpy as np
from scipy import ndimage

from ..signal import BAND_HZ, SEGMENT_SECONDS, level
from ..signal.checks import check_number
from ..signal.masks import bridge_gaps, true_runs
from .turnarounds import DIP_SECONDS, around

#: Where a recording's time goes: each sample counts under the first reason that applies.
REASONS = (
    "saturated",
    "missing (NaN)",
    "turnaround",
    "filter margin",
    "normal_force outside limits",
    "speed outside limits",
    "run shorter than a segment",
    "used",
)


@dataclass(frozen=True)
class SegmentLimits:
    """Conditions that a segment meets (paper section 2.1); limits are inclusive.

    Attributes:
        normal_force (`tuple[float, float]` or `None`): N; `None` = any.
        speed (`tuple[float, float]` or `None`): mm/s; `None` = any.
        longest_excursion (`float`): s; deviations up to this long are bridged.
        seconds (`float`): length of a segment, s; at least one period of the low edge of the band, 0.05 s.
        overlap (`float`): share of a segment that the next one repeats, 0 to below 1.

    Raises:
        ValueError: naming the argument, if a range is empty or a number out of range.
    """

    normal_force: tuple[float, float] | None = (0.4, 0.6)
    speed: tuple[float, float] | None = (66.0, 99.0)
    longest_excursion: float = 0.1
    seconds: float = SEGMENT_SECONDS
    overlap: float = 0.5

    def __post_init__(self):
        for name in ("normal_force", "speed"):
            limits = getattr(self, name)
            pair = np.ndim(limits) == 1 and len(limits) == 2 and all(isinstance(limit, Real) for limit in limits)
            if limits is None:
                continue
            if not (pair and 0 <= limits[0] < limits[1]):
                raise ValueError(f"`{name}` must be (low, high) with 0 <= low < high, or None, got {limits!r}.")
            object.__setattr__(self, name, tuple(map(float, limits)))
        check_number("longest_excursion", self.longest_excursion, "s", at_least=0)
        check_number("seconds", self.seconds, "s", at_least=1 / BAND_HZ[0])
        if not (isinstance(self.overlap, Real) and 0 <= self.overlap < 1):
            raise ValueError(f"`overlap` must be at least 0 and below 1, got {self.overlap!r}.")
        for name in ("longest_excursion", "seconds", "overlap"):  # plain numbers: they are stored as JSON
            object.__setattr__(self, name, float(getattr(self, name)))

    def samples(self, rate):
        """Samples of a segment at `rate` Hz."""
        return int(round(self.seconds * rate))

    def step(self, rate):
        """Samples between the starts of neighbouring windows at `rate` Hz."""
        return max(1, int(round(self.samples(rate) * (1 - self.overlap))))

    def without_conditions(self):
        """The same windows, any force and speed."""
        return replace(self, normal_force=None, speed=None)


@dataclass
class SegmentTable:
    """Segments, one row each; all columns are (segments,) int64 or float32.

    Attributes:
        recording (`np.ndarray`): number of the recording.
        start (`np.ndarray`): first sample within the recording, at its own rate.
        friction_coefficient (`np.ndarray`): mean lateral / mean normal force before the filter, without 60 ms around
            turnarounds; NaN = unknown.
        level (`np.ndarray`): log RMS of the filtered lateral force.
        level_between_turnarounds (`np.ndarray`): the same without 60 ms around turnarounds.
        speed (`np.ndarray`): mean, mm/s; NaN = unknown.
        turnarounds (`np.ndarray`): how many.
    """

    recording: np.ndarray
    start: np.ndarray
    friction_coefficient: np.ndarray
    level: np.ndarray
    level_between_turnarounds: np.ndarray
    speed: np.ndarray
    turnarounds: np.ndarray

    def __post_init__(self):
        for name, values in self.columns.items():
            whole = name in ("recording", "start", "turnarounds")
            values = np.asarray(values, np.int64 if whole else np.float32)
            if values.ndim != 1 or len(values) != len(self.recording) or np.isinf(values).any():
                raise ValueError("columns of segments differ in length, or hold infinite numbers")
            setattr(self, name, values)

    @property
    def columns(self):
        """Name -> column."""
        return {field.name: getattr(self, field.name) for field in fields(SegmentTable)}

    def rows(self, chosen):
        """Another table of the chosen rows."""
        return SegmentTable(**{name: values[chosen] for name, values in self.columns.items()})


@dataclass
class Windows(SegmentTable):
    """The segments of one recording, and where the rest of its time went.

    Attributes:
        seconds (`dict[str, float]`): where the recording's time went, by reason, all of `REASONS`.
        skipped (`tuple[str, ...]`): limits that could not be applied, because their channel is missing.
        usable (`np.ndarray`): (n,) bool, the samples that a window may hold.
        lost (`dict[str, float]`): seconds within the limits, in runs as long as a window, that are not used, by cause.
    """

    seconds: dict
    skipped: tuple
    usable: np.ndarray
    lost: dict


def select_windows(usable, window, step):
    """Starts (windows,) int64 of windows of `window` samples, `step` apart, and a mask (n,) of the runs they lie in.

    `usable` is (n,) bool, with excursions bridged.
    """
    starts, used = [np.empty(0, dtype=np.int64)], np.zeros(len(usable), dtype=bool)
    for start, stop in true_runs(usable):
        if stop - start >= window:
            starts.append(np.arange(start, stop - window + 1, step))
            used[start:stop] = True
    return np.concatenate(starts), used


def find_windows(data, filtered, valid, rate, limits, number=0):
    """Cuts one recording into windows that meet `limits`.

    Args:
        data (`Channels`): the recording.
        filtered, valid (`np.ndarray`): from `filtered_with_gaps`.
        rate (`int`): Hz.
        limits (`SegmentLimits`): conditions.
        number (`int`): of the recording.

    Returns:
        `Windows`.
    """
    inside, skipped = _inside(data, limits)
    present = [values for values in (data.lateral, data.normal, data.speed) if values is not None]
    missing = np.any([np.isnan(values) for values in present], axis=0)
    in_limits = np.all(list(inside.values()), axis=0) if inside else np.ones(len(filtered), dtype=bool)
    longest = int(round(limits.longest_excursion * rate))
    usable = bridge_gaps(in_limits, longest) & valid & ~missing & ~data.excluded
    window, step = limits.samples(rate), limits.step(rate)
    start, used = select_windows(usable, window, step)
    within = select_windows(bridge_gaps(in_limits | missing, longest), window, step)[1]
    causes = {"saturated samples": data.saturated, "missing samples": missing & ~data.saturated}
    causes["turnarounds close together"] = data.excluded

    reasons = {"saturated": data.saturated, "missing (NaN)": missing, "turnaround": data.excluded}
    reasons["filter margin"] = ~valid
    reasons |= {f"{name} outside limits": ~usable & ~values for name, values in inside.items()}
    reasons |= {"run shorter than a segment": ~used, "used": used}
    return Windows(
        recording=np.full(len(start), number),
        start=start,
        turnarounds=np.diff(np.searchsorted(data.turnarounds, [start, start + window]), axis=0)[0],
        seconds=_seconds_by_reason(reasons, rate),
        skipped=skipped,
        usable=usable,
        lost=_lost(within & ~used, causes, rate),
        **_measure(data, filtered, rate, window, start),
    )


def _inside(data, limits):
    """Masks of the samples inside each limit, by name, and the limits whose channel is missing."""
    inside, skipped = {}, []
    for name, values in (("normal_force", data.normal), ("speed", data.speed)):
        bounds = getattr(limits, name)
        if bounds is not None and values is None:
            skipped.append(name)
        elif bounds is not None:
            inside[name] = (values >= bounds[0]) & (values <= bounds[1])
    return inside, tuple(skipped)


def _seconds_by_reason(masks, rate):
    """Each sample is counted once, under the first reason that applies."""
    seconds, left = dict.fromkeys(REASONS, 0.0), True
    for reason, mask in masks.items():
        seconds[reason] = float(np.count_nonzero(left & mask)) / rate
        left = left & ~mask
    return seconds


def _lost(lost, causes, rate):
    """Seconds of the samples `lost`, (n,) bool, by the nearest of the causes; an end of the recording is one."""
    away = {name: ndimage.distance_transform_edt(~mask)[lost] for name, mask in causes.items() if mask.any()}
    away["ends of recordings"] = np.minimum(place := np.arange(len(lost)), place[::-1])[lost]
    nearest = np.argmin(list(away.values()), axis=0)
    return {name: float(np.count_nonzero(nearest == number)) / rate for number, name in enumerate(away)}


def _measure(data, filtered, rate, window, start):
    """Friction coefficient, levels and speed of windows: a dict of (windows,)."""

    def total(values):
        # sums over [start, start + window); the zero lets the last window end with the recording
        values = np.append(np.asarray(values, dtype=np.float64), 0.0)
        return np.add.reduceat(values, np.stack([start, start + window], axis=-1).ravel())[::2]

    friction = speed = np.full(len(start), np.nan)
    between = ~around(data.turnarounds, DIP_SECONDS, rate, len(filtered))
    if data.normal is not None:
        pressed = total(data.normal * between)  # 0 also where a short window lies within 60 ms of a turnaround
        friction = total(data.lateral * between) / np.where(pressed > 0, pressed, np.nan)
    if data.speed is not None:
        speed = total(data.speed) / window
    squares = np.square(filtered, dtype=np.float64)
    squares_between = total(squares * between) / np.maximum(total(between), 1)
    return {
        "friction_coefficient": friction,
        "level": level(np.sqrt(total(squares) / window)[:, None]),
        "level_between_turnarounds": level(np.sqrt(squares_between)[:, None]),
        "speed": speed,
    }
