"""Lateral force, normal force and speed of a recording: the projection on the sliding direction (paper section 2.1)."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import signal

from ..signal import band_pass
from ..signal.masks import bridge_gaps, interpolated, mask_of_runs, true_runs
from .force_checks import out_of_range
from .turnarounds import DEFAULT_TURNAROUNDS, find_turnarounds, treat_turnarounds

#: Cutoff (Hz) of the zero-phase low-pass on velocity before its direction is taken.
DIRECTION_BANDWIDTH = 25.0
#: Below this speed (mm/s) the last sliding direction is held.
SLOWEST_DIRECTION = 10.0
#: Mean over standard deviation from which a lateral force says which way friction points; without its mean (a
#: microphone, an accelerometer, a high-passed file) the sign cannot be known and stays.
LEAST_BIAS = 0.5
#: Gaps of up to so much (s) are bridged by straight lines. Motion: one window of the filter that makes velocity of
#: position. Force: a few samples, one period of the upper edge of the band (recipe).
MOTION_GAP, FORCE_GAP = 0.05, 1e-3


@dataclass
class Channels:
    """A recording's channels at the rate of its force.

    Attributes:
        lateral (`np.ndarray`): (n,) N, positive = friction opposes sliding; NaN = missing or saturated.
        normal (`np.ndarray` or `None`): (n,) N.
        speed (`np.ndarray` or `None`): (n,) mm/s.
        turnarounds (`np.ndarray`): (turnarounds,) int64, the sample in the middle of each.
        saturated (`np.ndarray`): (n,) bool, samples excluded because a sensor was at the end of its range.
        excluded (`np.ndarray`): (n,) bool, samples that no segment may hold because of a turnaround.
        flipped (`bool`): whether the recorded sign was turned: the force was the surface's on the finger, or along a
            fixed axis of a sensor.
        bridged (`tuple[int, int]`): samples of force and of motion in short gaps, bridged by straight lines.
    """

    lateral: np.ndarray
    normal: np.ndarray | None
    speed: np.ndarray | None
    turnarounds: np.ndarray
    saturated: np.ndarray
    excluded: np.ndarray
    flipped: bool = False
    bridged: tuple[int, int] = (0, 0)


def channels(recording, turnarounds=DEFAULT_TURNAROUNDS):
    """Lateral force, normal force and speed of a recording.

    Lateral force is the contact force projected on the sliding direction (paper section 2.1), positive where it opposes
    the motion, so that slow loading rises and a slip falls in every recording. Friction dissipates: where the
    projection is negative on average, the file holds the reaction on the finger, and the sign is turned. `lateral`
    force of a fixed sensor under a reciprocating stage changes its sign with the stroke: there velocity decides.

    Args:
        recording (`Recording`): one exploration.
        turnarounds (`str`): "keep" or "mask"; see `treat_turnarounds`.

    Returns:
        `Channels`.

    Raises:
        ValueError: if the recording has 3-D force but no velocity, no usable sample or the same force in all samples,
            or `turnarounds` is unknown.
    """
    samples, rate, name = recording.samples, recording.rate, "lateral" if recording.force is None else "force"
    force, in_force = _bridged(getattr(recording, name), FORCE_GAP * rate)
    velocity, in_motion = _bridged(recording.velocity, MOTION_GAP * (recording.velocity_rate or 0))
    recording = replace(recording, velocity=velocity, **{name: force})
    speed, angle, positions = None, None, np.empty(0, dtype=np.int64)
    if velocity is not None:
        velocity_rate = recording.velocity_rate
        speed = at_rate(np.hypot(velocity[:, 0], velocity[:, 1]), velocity_rate, rate, samples)
        angle = sliding_direction(velocity, velocity_rate)
        positions = np.round(find_turnarounds(angle, velocity_rate) * rate).astype(np.int64)
        positions = positions[positions < samples]
        angle = at_rate(angle, velocity_rate, rate, samples)
    broken = out_of_range(force, rate, recording.unit)
    lateral, normal = _project(recording, angle)
    lateral = np.where(broken, np.nan, lateral)
    if np.isnan(lateral).all():
        raise ValueError(f"{recording.name} has no sample that is neither missing nor saturated. Leave it out.")
    if np.nanmin(force) == np.nanmax(force):
        raise ValueError(f"{recording.name} has the same force in all samples: the sensor was dead. Leave it out.")
    sign = _opposing(lateral, angle, known=recording.force is not None)
    lateral, flipped = sign * lateral, bool(np.any(sign < 0))
    lateral, excluded = treat_turnarounds(lateral, positions, rate, turnarounds)
    return Channels(lateral, normal, speed, positions, broken, excluded, flipped, (in_force, in_motion))


def _bridged(values, longest):
    """Values, (n,) or (n, axes), with straight lines across gaps of up to `longest` samples, and how many they hold."""
    if values is None:
        return None, 0
    axes = np.atleast_2d(values.T)
    missing = np.isnan(axes).any(axis=0)
    short = bridge_gaps(~missing, max(1, round(longest))) & missing
    if short.any():
        axes = np.array([np.where(short, interpolated(axis, missing), axis) for axis in axes])
    return axes.T.reshape(values.shape), int(short.sum())


def _project(recording, angle):
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


def _opposing(lateral, angle, known):
    """Sign that makes lateral force oppose the motion, a number or (n,).

    Args:
        lateral (`np.ndarray`): (n,), NaN = missing.
        angle (`np.ndarray` or `None`): (n,) rad, sliding direction.
        known (`bool`): whether the force is already projected on the sliding direction.
    """

    def bias(values):
        return np.nanmean(values) / max(np.nanstd(values), 1e-12)

    if known:
        return -1.0 if np.nanmean(lateral) < 0 else 1.0
    sign = 1.0
    if angle is not None:  # along which line the stage goes to and fro, and which of the two ways it goes
        line = 0.5 * np.angle(np.nanmean(np.exp(2j * angle)))
        stroke = np.where(np.cos(angle - line) < 0, -1.0, 1.0)
        if abs(bias(stroke * lateral)) > max(LEAST_BIAS, 2 * abs(bias(lateral))):
            sign = stroke
    return -sign if bias(sign * lateral) < -LEAST_BIAS else sign


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


def filtered_with_gaps(lateral, rate, band):
    """Band-passes a whole recording that may hold NaN.

    Gaps are interpolated for the filter. Samples within two periods of the band's low edge of a gap, or of an end of
    the recording, carry filter transients: they are not valid.

    Args:
        lateral (`np.ndarray`): (n,) N.
        rate (`int`): Hz.
        band (`tuple[float, float]`): of `signal.band_pass`, Hz.

    Returns:
        `tuple[np.ndarray, np.ndarray]`: filtered (n,) float32 and valid (n,) bool.
    """
    missing = np.isnan(lateral)
    margin = int(np.ceil(2 * rate / band[0]))
    valid = ~mask_of_runs(true_runs(missing) + [-margin, margin], len(lateral))
    valid[:margin] = valid[max(0, len(valid) - margin) :] = False
    filtered = band_pass(interpolated(lateral, missing), rate, band=band)
    return filtered.astype(np.float32), valid
