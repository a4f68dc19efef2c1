"""From a recording to segments: lateral force, limits of force and speed, windows (paper section 2.1)."""

from dataclasses import dataclass
from numbers import Real

import numpy as np
from scipy import signal

from ..signal import SEGMENT_SECONDS, band_pass, level
from .checks import over_range, saturated
from .masks import bridge_gaps, interpolated, mask_of_runs, true_runs
from .turnarounds import DEFAULT_TURNAROUNDS, DIP_SECONDS, around, find_turnarounds, treat_turnarounds

#: Cutoff (Hz) of the zero-phase low-pass on velocity before its direction is taken.
DIRECTION_BANDWIDTH = 25.0
#: Below this speed (mm/s) the last sliding direction is held.
SLOWEST_DIRECTION = 10.0
#: Where a recording's time goes: each sample counts under the first that applies.
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
        seconds (`float`): length of a segment, s.
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
        if not (isinstance(self.longest_excursion, Real) and 0 <= self.longest_excursion < np.inf):
            raise ValueError(
                f"`longest_excursion` must be a finite time of 0 s or more, got {self.longest_excursion!r}."
            )
        if not (isinstance(self.seconds, Real) and 0 < self.seconds < np.inf):
            raise ValueError(f"`seconds` must be positive and finite, got {self.seconds!r}.")
        if not (isinstance(self.overlap, Real) and 0 <= self.overlap < 1):
            raise ValueError(f"`overlap` must be at least 0 and below 1, got {self.overlap!r}.")
        for name in ("longest_excursion", "seconds", "overlap"):  # as JSON knows them: they are noted in the file
            object.__setattr__(self, name, float(getattr(self, name)))

    def samples(self, rate):
        """Samples of a segment at `rate` Hz."""
        return int(round(self.seconds * rate))

    def step(self, rate):
        """Samples between the starts of neighbouring windows at `rate` Hz."""
        return max(1, int(round(self.samples(rate) * (1 - self.overlap))))

    def without_conditions(self):
        """The same windows, any force and speed."""
        return SegmentLimits(None, None, self.longest_excursion, self.seconds, self.overlap)


def select_windows(usable, window, step):
    """Starts of the windows of a recording.

    Args:
        usable (`np.ndarray`): (n,) bool, excursions already bridged.
        window, step (`int`): samples.

    Returns:
        `tuple[np.ndarray, np.ndarray]`: window starts (windows,) int64 and the mask (n,) of the runs that hold them.
    """
    starts, used = [np.empty(0, dtype=np.int64)], np.zeros(len(usable), dtype=bool)
    for start, stop in true_runs(usable):
        if stop - start >= window:
            starts.append(np.arange(start, stop - window + 1, step))
            used[start:stop] = True
    return np.concatenate(starts), used


def at_rate(values, rate_in, rate_out, samples):
    """Linear interpolation of a channel that starts at the same instant: (samples,) float64.

    The last value is held for one of its own samples; later, and beside a NaN, the result is NaN.
    """
    time = np.arange(samples) * (rate_in / rate_out)
    return np.where(time < len(values), np.interp(time, np.arange(len(values)), values), np.nan)


def sliding_direction(velocity, rate):
    """Angle of the sliding direction, from low-passed velocity and held through speeds below 10 mm/s.

    Args:
        velocity (`np.ndarray`): (m, 2) mm/s; NaN is treated as standing still.
        rate (`float`): Hz.

    Returns:
        `np.ndarray`: (m,) rad, unwrapped.
    """
    velocity = np.nan_to_num(np.asarray(velocity, dtype=np.float64))
    if DIRECTION_BANDWIDTH < rate / 2:
        sections = signal.butter(2, DIRECTION_BANDWIDTH, fs=rate, output="sos")
        velocity = signal.sosfiltfilt(sections, velocity, axis=0)
    moving = np.hypot(velocity[:, 0], velocity[:, 1]) >= SLOWEST_DIRECTION
    if not moving.any():
        moving[:] = True
    last = np.maximum.accumulate(np.where(moving, np.arange(len(moving)), -1))
    last[last < 0] = np.argmax(moving)
    held = velocity[last]
    return np.unwrap(np.arctan2(held[:, 1], held[:, 0]))


@dataclass
class Channels:
    """A recording's channels at the rate of its force.

    Attributes:
        lateral (`np.ndarray`): (n,) N, positive = friction opposes sliding; NaN = missing or saturated.
        normal (`np.ndarray` or `None`): (n,) N.
        speed (`np.ndarray` or `None`): (n,) mm/s.
        turnarounds (`np.ndarray`): (turnarounds,) int64, the sample in the middle of each.
        saturated (`np.ndarray`): (n,) bool, samples taken out because a sensor was at or beyond the end of its range.
        excluded (`np.ndarray`): (n,) bool, samples that no segment may hold because of a turnaround.
        flipped (`bool`): whether the recorded force was the surface's on the finger.
    """

    lateral: np.ndarray
    normal: np.ndarray | None
    speed: np.ndarray | None
    turnarounds: np.ndarray
    saturated: np.ndarray
    excluded: np.ndarray
    flipped: bool = False


def channels(recording, turnarounds=DEFAULT_TURNAROUNDS):
    """Lateral force, normal force and speed of a recording.

    Lateral force is the contact force projected on the sliding direction (paper section 2.1). Friction dissipates:
    where the projection is negative on average, the file holds the reaction on the finger, and the sign is turned.

    Args:
        recording (`Recording`): one exploration.
        turnarounds (`str`): "keep", "exclude" or "mask"; see `treat_turnarounds`.

    Returns:
        `Channels`.

    Raises:
        ValueError: if the recording has 3-D force but no velocity, no usable sample or the same force in all samples,
            or `turnarounds` is unknown.
    """
    samples, rate = recording.samples, recording.rate
    speed, angle, positions = None, None, np.empty(0, dtype=np.int64)
    if recording.velocity is not None:
        velocity, velocity_rate = recording.velocity, recording.velocity_rate
        speed = at_rate(np.hypot(velocity[:, 0], velocity[:, 1]), velocity_rate, rate, samples)
        angle = sliding_direction(velocity, velocity_rate)
        positions = np.round(find_turnarounds(angle, velocity_rate) * rate).astype(np.int64)
        positions = positions[positions < samples]
        angle = at_rate(angle, velocity_rate, rate, samples)
    force = recording.force if recording.force is not None else recording.lateral
    broken = _out_of_range(force, rate, recording.unit)
    lateral, normal = _projected(recording, angle)
    lateral = np.where(broken, np.nan, lateral)
    if np.isnan(lateral).all():
        raise ValueError(f"{recording.name} has no sample that is neither missing nor saturated. Leave it out.")
    if np.nanmin(force) == np.nanmax(force):
        raise ValueError(f"{recording.name} has the same force in all samples: the sensor was dead. Leave it out.")
    flipped = recording.force is not None and bool(np.nanmean(lateral) < 0)
    lateral = -lateral if flipped else lateral
    lateral, excluded = treat_turnarounds(lateral, positions, rate, turnarounds)
    return Channels(lateral, normal, speed, positions, broken, excluded, flipped)


def _out_of_range(force, rate, unit):
    axes = force.T if force.ndim == 2 else [force]
    broken = np.any([saturated(axis, rate) for axis in axes], axis=0)
    return broken | over_range(force) if unit == "N" else broken


def _projected(recording, angle):
    """Force along the sliding direction, (n,) float64, and normal force in N, (n,) or None."""
    force = recording.force
    if force is None:
        return recording.lateral.astype(np.float64), None
    if angle is None:
        raise ValueError(
            f"{recording.name} has 3-D `force` but no `velocity`: the sliding direction is unknown. "
            "Store `velocity`, or the projected force as `lateral`."
        )
    # counts of different axes need not be alike: a limit in newtons, and a ratio, have no meaning for them
    normal = np.abs(force[:, 2]) if recording.unit == "N" else None
    return force[:, 0] * np.cos(angle) + force[:, 1] * np.sin(angle), normal


def filtered_with_gaps(lateral, rate, band, order, passes):
    """Band-passes a whole recording that may hold NaN.

    Gaps are interpolated for the filter. Samples within two periods of the low edge of a gap or of an end of the
    recording carry filter transients: they are not valid.

    Returns:
        `tuple[np.ndarray, np.ndarray]`: filtered (n,) float32 and valid (n,) bool.
    """
    missing = np.isnan(lateral)
    margin = int(np.ceil(2 * rate / band[0]))
    runs = true_runs(missing)
    valid = ~mask_of_runs(runs + [-margin, margin], len(lateral))
    valid[:margin] = valid[max(0, len(valid) - margin) :] = False
    filtered = band_pass(interpolated(lateral, missing), rate, band=band, order=order, passes=passes)
    return filtered.astype(np.float32), valid


@dataclass
class Windows:
    """Windows of one recording; all arrays are (windows,).

    Attributes:
        start (`np.ndarray`): first sample.
        friction_coefficient (`np.ndarray`): mean lateral / mean normal force before the filter, without 60 ms around
            turnarounds; NaN = unknown.
        level (`np.ndarray`): log RMS of the filtered lateral force.
        level_apart (`np.ndarray`): the same without 60 ms around turnarounds.
        speed (`np.ndarray`): mean, mm/s; NaN = unknown.
        turnarounds (`np.ndarray`): number inside.
        seconds (`dict[str, float]`): where the recording's time went, by reason, all of `REASONS`.
        skipped (`tuple[str, ...]`): limits that could not be applied, because their channel is missing.
        usable (`np.ndarray`): (n,) bool, the samples that a window may hold.
    """

    start: np.ndarray
    friction_coefficient: np.ndarray
    level: np.ndarray
    level_apart: np.ndarray
    speed: np.ndarray
    turnarounds: np.ndarray
    seconds: dict
    skipped: tuple
    usable: np.ndarray


def find_windows(data, filtered, valid, rate, limits):
    """Cuts one recording into windows that meet `limits`.

    Args:
        data (`Channels`): the recording.
        filtered, valid (`np.ndarray`): from `filtered_with_gaps`.
        rate (`int`): Hz.
        limits (`SegmentLimits`): conditions.

    Returns:
        `Windows`.
    """
    inside, skipped = _inside(data, limits)
    given = [values for values in (data.lateral, data.normal, data.speed) if values is not None]
    missing = np.any([np.isnan(values) for values in given], axis=0)
    in_limits = np.all(list(inside.values()), axis=0) if inside else np.ones(len(filtered), dtype=bool)
    usable = bridge_gaps(in_limits, int(round(limits.longest_excursion * rate))) & valid & ~missing & ~data.excluded
    window, step = limits.samples(rate), limits.step(rate)
    start, used = select_windows(usable, window, step)

    reasons = {"saturated": data.saturated, "missing (NaN)": missing, "turnaround": data.excluded}
    reasons |= {"filter margin": ~valid}
    reasons |= {f"{name} outside limits": ~usable & ~values for name, values in inside.items()}
    reasons |= {"run shorter than a segment": ~used, "used": used}
    return Windows(
        start=start,
        turnarounds=np.diff(np.searchsorted(data.turnarounds, [start, start + window]), axis=0)[0],
        seconds=_seconds_by_reason(reasons, rate),
        skipped=skipped,
        usable=usable,
        **_measured(data, filtered, rate, window, start),
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


def _measured(data, filtered, rate, window, start):
    """Friction coefficient, levels and speed of windows: a dict of (windows,)."""

    def total(values):
        # sums over [start, start + window); the zero lets the last window end with the recording
        values = np.append(np.asarray(values, dtype=np.float64), 0.0)
        return np.add.reduceat(values, np.stack([start, start + window], axis=-1).ravel())[::2]

    friction = speed = np.full(len(start), np.nan)
    apart = ~around(data.turnarounds, DIP_SECONDS, rate, len(filtered))
    if data.normal is not None:
        pressed = total(data.normal * apart)  # 0 also where a short window lies within 60 ms of a turnaround
        friction = total(data.lateral * apart) / np.where(pressed > 0, pressed, np.nan)
    if data.speed is not None:
        speed = total(data.speed) / window
    squares = np.square(filtered, dtype=np.float64)
    return {
        "friction_coefficient": friction,
        "level": level(np.sqrt(total(squares) / window)[:, None]),
        "level_apart": level(np.sqrt(total(squares * apart) / np.maximum(total(apart), 1))[:, None]),
        "speed": speed,
    }
