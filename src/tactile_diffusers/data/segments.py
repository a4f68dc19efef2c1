"""From a recording to segments: lateral force, limits of force and speed, windows (paper section 2.1)."""

from dataclasses import dataclass

import numpy as np
from scipy import signal

from ..signal import SEGMENT_SECONDS, band_pass, level

#: Cutoff (Hz) of the zero-phase low-pass on velocity before its direction is taken.
DIRECTION_BANDWIDTH = 25.0
#: Below this speed (mm/s) the last sliding direction is held.
SLOWEST_DIRECTION = 10.0


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
            if limits is not None and not 0 <= limits[0] < limits[1]:
                raise ValueError(f"`{name}` must be (low, high) with 0 <= low < high, or None, got {limits}.")
        if not self.longest_excursion >= 0:
            raise ValueError(f"`longest_excursion` must be 0 s or more, got {self.longest_excursion}.")
        if not self.seconds > 0:
            raise ValueError(f"`seconds` must be positive, got {self.seconds}.")
        if not 0 <= self.overlap < 1:
            raise ValueError(f"`overlap` must be at least 0 and below 1, got {self.overlap}.")

    def samples(self, rate):
        """Samples of a segment at `rate` Hz."""
        return int(round(self.seconds * rate))

    def step(self, rate):
        """Samples between the starts of neighbouring windows at `rate` Hz."""
        return max(1, int(round(self.samples(rate) * (1 - self.overlap))))

    def without_conditions(self):
        """The same windows, any force and speed."""
        return SegmentLimits(None, None, self.longest_excursion, self.seconds, self.overlap)


def true_runs(mask):
    """Start and stop (exclusive) of every run of True: (runs, 2) int64."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return edges.reshape(-1, 2)


def bridge_gaps(mask, longest):
    """Sets gaps of at most `longest` samples between two runs of True to True; gaps at the ends stay."""
    mask = np.array(mask, dtype=bool)
    runs = true_runs(mask)
    for stop, start in zip(runs[:-1, 1], runs[1:, 0], strict=True):
        if start - stop <= longest:
            mask[stop:start] = True
    return mask


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


def turnaround_mask(angle, rate):
    """True where the sliding direction turns by more than a right angle within 0.1 s: (m,) bool."""
    half = max(1, int(round(0.05 * rate)))
    padded = np.pad(angle, half, mode="edge")
    return np.abs(padded[2 * half :] - padded[: -2 * half]) > np.pi / 2


@dataclass
class Channels:
    """A recording's channels at the rate of its force.

    Attributes:
        lateral (`np.ndarray`): (n,) N, positive = friction opposes sliding; NaN = missing.
        normal (`np.ndarray` or `None`): (n,) N.
        speed (`np.ndarray` or `None`): (n,) mm/s.
        turnarounds (`np.ndarray`): (n,) bool, True at the first sample of each turnaround.
        flipped (`bool`): whether the recorded force was the surface's on the finger.
    """

    lateral: np.ndarray
    normal: np.ndarray | None
    speed: np.ndarray | None
    turnarounds: np.ndarray
    flipped: bool = False


def channels(recording):
    """Lateral force, normal force and speed of a recording.

    Lateral force is the contact force projected on the sliding direction (paper section 2.1). Friction dissipates:
    where the projection is negative on average, the file holds the reaction on the finger, and the sign is turned.

    Args:
        recording (`Recording`): one exploration.

    Returns:
        `Channels`.

    Raises:
        ValueError: if the recording has 3-D force but no velocity.
    """
    samples, rate = recording.samples, recording.rate
    speed, turnarounds = None, np.zeros(samples, dtype=bool)
    if recording.velocity is not None:
        velocity, velocity_rate = recording.velocity, recording.velocity_rate
        speed = at_rate(np.hypot(velocity[:, 0], velocity[:, 1]), velocity_rate, rate, samples)
        angle = sliding_direction(velocity, velocity_rate)
        first = true_runs(turnaround_mask(angle, velocity_rate))[:, 0] * (rate / velocity_rate)
        turnarounds[first[first < samples].astype(np.int64)] = True
    if recording.force is None:
        return Channels(recording.lateral.astype(np.float64), None, speed, turnarounds)
    if speed is None:
        raise ValueError(
            f"{recording.name} has 3-D `force` but no `velocity`: the sliding direction is unknown. "
            "Store `velocity`, or the projected force as `lateral`."
        )
    angle = at_rate(angle, velocity_rate, rate, samples)
    force = recording.force
    lateral = force[:, 0] * np.cos(angle) + force[:, 1] * np.sin(angle)
    flipped = bool(np.nanmean(lateral) < 0)
    return Channels(-lateral if flipped else lateral, np.abs(force[:, 2]), speed, turnarounds, flipped)


def filtered_with_gaps(lateral, rate, band, order, passes):
    """Band-passes a whole recording that may hold NaN.

    Gaps are interpolated for the filter. Samples within two periods of the low edge of a gap or of an end of the
    recording carry filter transients: they are not valid.

    Returns:
        `tuple[np.ndarray, np.ndarray]`: filtered (n,) float32 and valid (n,) bool.
    """
    missing = np.isnan(lateral)
    valid = np.ones(len(lateral), dtype=bool)
    margin = int(np.ceil(2 * rate / band[0]))
    for start, stop in true_runs(missing):
        valid[max(0, start - margin) : stop + margin] = False
    valid[:margin] = valid[max(0, len(valid) - margin) :] = False
    if missing.any():
        known = np.flatnonzero(~missing)
        lateral = np.interp(np.arange(len(lateral)), known, lateral[known])
    return band_pass(lateral, rate, band=band, order=order, passes=passes).astype(np.float32), valid


@dataclass
class Windows:
    """Windows of one recording; all arrays are (windows,).

    Attributes:
        start (`np.ndarray`): first sample.
        friction_coefficient (`np.ndarray`): mean lateral / mean normal force before the filter; NaN = unknown.
        level (`np.ndarray`): log RMS of the filtered lateral force.
        speed (`np.ndarray`): mean, mm/s; NaN = unknown.
        turnarounds (`np.ndarray`): number inside.
        seconds (`dict[str, float]`): where the recording's time went, by reason.
        skipped (`tuple[str, ...]`): limits that could not be applied, because their channel is missing.
    """

    start: np.ndarray
    friction_coefficient: np.ndarray
    level: np.ndarray
    speed: np.ndarray
    turnarounds: np.ndarray
    seconds: dict
    skipped: tuple


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
    given = [values for values in (data.lateral, data.normal, data.speed) if values is not None]
    missing = np.any([np.isnan(values) for values in given], axis=0)
    inside, skipped = {}, []
    for name, values in (("normal_force", data.normal), ("speed", data.speed)):
        bounds = getattr(limits, name)
        if bounds is not None and values is None:
            skipped.append(name)
        elif bounds is not None:
            inside[name] = (values >= bounds[0]) & (values <= bounds[1])
    in_limits = np.all(list(inside.values()), axis=0) if inside else np.ones(len(filtered), dtype=bool)
    usable = bridge_gaps(in_limits, int(round(limits.longest_excursion * rate))) & valid & ~missing
    window, step = limits.samples(rate), limits.step(rate)
    start, used = select_windows(usable, window, step)

    # each sample is counted once, under the first reason that applies
    reasons = {"missing (NaN)": missing, "filter margin": ~valid}
    reasons |= {f"{name} outside limits": ~usable & ~values for name, values in inside.items()}
    reasons |= {"run shorter than a segment": ~used, "used": used}
    seconds, left = {}, np.ones(len(filtered), dtype=bool)
    for reason, mask in reasons.items():
        seconds[reason] = float(np.sum(left & mask)) / rate
        left &= ~mask
    mean = _window_mean(window, start)
    nothing = np.full(len(start), np.nan)
    squares = mean(np.square(filtered, dtype=np.float64))
    return Windows(
        start=start,
        friction_coefficient=nothing if data.normal is None else mean(data.lateral) / mean(data.normal),
        level=level(np.sqrt(squares)[:, None]),
        speed=nothing if data.speed is None else mean(data.speed),
        turnarounds=np.round(mean(data.turnarounds) * window).astype(np.int64),
        seconds=seconds,
        skipped=tuple(skipped),
    )


def _window_mean(window, start):
    def mean(values):
        # a NaN lies outside every window, but would spread through the cumulative sum
        total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(values), dtype=np.float64)])
        return (total[start + window] - total[start]) / window

    return mean
