"""The lag that is left between force and motion, seen from turns: friction follows the sliding direction."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import signal

from ..projection import DIRECTION_BANDWIDTH
from .clocks import bridged

#: Lags between force and motion are looked for up to this much (s), at this rate (Hz), in so much of a recording (s).
LONGEST_LAG = 0.25
LAG_RATE = 500
LAG_SECONDS = 120.0
#: Well below this speed (mm/s) noise decides the direction, and it fades to none (recipe).
REST_SPEED = 3.0
#: Travels (mm) within which the force may follow a new direction (recipe: friction of 0.1-2 N over 0.5-3 N/mm), and
#: the step of distance at which that is computed.
SHEAR_TRAVELS = (0.0, *np.geomspace(0.1, 1.6, 19))
TRAVEL_STEP = 0.05
#: After a longer way (mm; 120 s at 2 m/s), as where tracking jumps, no lag is told: the steps would fill the memory.
LONGEST_WAY = 240_000.0
#: Shears that leave so much (factor) unexplained of what the best one leaves are as good; if their lags differ by more
#: than this (s), as in a recording of steady loops only, the lag cannot be told (recipe).
AS_GOOD, LARGEST_DOUBT = 1.02, 0.015
#: A weaker correlation of force and direction is chance, and no lag is told from it (recipe).
LEAST_CORRELATION = 0.5
#: The sliding direction must vary this much (variance of the unit vector, 0 to 1) for a lag to be seen (recipe).
LEAST_TURNING = 0.1


@dataclass
class Lag:
    """Time of the force behind the motion (`seconds`), travel in which it follows a new direction (`shear`, mm), and
    the correlation of force and direction there; a negative one means that the force on the finger was recorded.
    """

    seconds: float
    shear: float
    correlation: float


def residual_lag(force, force_rate, velocity, velocity_rate):
    """Lag between force and motion, from turns: friction follows the sliding direction.

    A contact shears before it slides: after a turn the force follows the new direction within some travel, first-order
    in distance (Dahl, Aerospace Corp. TOR-0158(3107-18)-1, 1968). Speed varies, so a delay in distance differs from a
    lag in time: the force along the surface, low-passed at 25 Hz, is correlated with the direction of the velocity,
    delayed by each of `SHEAR_TRAVELS` and by up to +-0.25 s; the best pair counts (recipe).

    Args:
        force (`np.ndarray`): (n, 2) along the surface, or (n, 1) with a movement along x; NaN = missing.
        force_rate, velocity_rate (`float`): Hz.
        velocity (`np.ndarray`): (m, 2) or (m, 1) mm/s, starting at the same instant.

    Returns:
        `Lag`, or `None` if the recording hardly turns, the force does not follow, lag and shear cannot be told apart,
        or the way is too long to be one of a finger.
    """
    seconds = min(len(force) / force_rate, len(velocity) / velocity_rate, LAG_SECONDS)
    force, velocity = force[: math.ceil(seconds * force_rate)], velocity[: math.ceil(seconds * velocity_rate)]
    time = np.arange(int(seconds * LAG_RATE)) / LAG_RATE
    velocity = _at_times(velocity, velocity_rate, time)
    speed = np.linalg.norm(velocity, axis=1)
    direction = velocity / np.hypot(speed, REST_SPEED)[:, None]
    if len(time) < 4 * LONGEST_LAG * LAG_RATE or direction.var(axis=0).sum() < LEAST_TURNING:
        return None
    travelled = np.concatenate([[0.0], np.cumsum(speed[1:]) / LAG_RATE])
    if travelled[-1] > LONGEST_WAY:
        return None
    force = _at_times(_slow(force, force_rate), force_rate, time)
    followed = [_slow(_sheared(direction, travelled, shear), LAG_RATE) for shear in SHEAR_TRAVELS]
    lags, correlations = np.array([_peak(force, each) for each in followed]).T
    unexplained = 1 - np.abs(correlations)
    alike = lags[unexplained <= AS_GOOD * unexplained.min()]
    best = int(np.argmin(unexplained))
    weak = abs(correlations[best]) < LEAST_CORRELATION
    if weak or abs(lags[best]) >= LONGEST_LAG or np.ptp(alike) > LARGEST_DOUBT:
        return None
    return Lag(float(lags[best]), float(SHEAR_TRAVELS[best]), float(correlations[best]))


def _slow(values, rate):
    """Low-passed at 25 Hz without a shift: (n, columns)."""
    if not DIRECTION_BANDWIDTH < rate / 2:
        return values
    sections = signal.butter(2, DIRECTION_BANDWIDTH, fs=rate, output="sos")
    return signal.sosfiltfilt(sections, bridged(values), axis=0)


def _at_times(values, rate, time):
    """Read at other times (s) by linear interpolation: (len(time), columns)."""
    own = np.arange(len(values)) / rate
    return np.stack([np.interp(time, own, column) for column in bridged(values).T], axis=-1)


def _sheared(direction, travelled, shear):
    """Direction that follows `direction` (n, axes) first-order within `shear` mm of the distance `travelled` (n,)."""
    if not shear:
        return direction
    grid = np.arange(0, travelled[-1] + TRAVEL_STEP, TRAVEL_STEP)
    keep = np.exp(-TRAVEL_STEP / shear)
    sheared = np.empty_like(direction)
    for axis, values in enumerate(direction.T):
        along = np.interp(grid, travelled, values)
        followed = signal.lfilter([1 - keep], [1, -keep], along, zi=[keep * along[0]])[0]
        sheared[:, axis] = np.interp(travelled, grid, followed)
    return sheared


def _peak(force, direction):
    """Lag in s at which the correlation of two (n, axes) is largest in size, and the correlation there.

    Each lag compares the middle of `direction` with as many samples of `force`, whatever the lag.
    """
    reach = int(LONGEST_LAG * LAG_RATE)
    middle = direction[reach:-reach] - direction[reach:-reach].mean(axis=0)
    samples, correlation, power = len(middle), 0.0, 0.0
    for values, reference in zip((force - force.mean(axis=0)).T, middle.T, strict=True):
        correlation = correlation + signal.correlate(values, reference, mode="valid", method="fft")
        sums = [np.concatenate([[0.0], np.cumsum(part)]) for part in (values, values**2)]
        total, squares = (each[samples:] - each[:-samples] for each in sums)
        power = power + squares - total**2 / samples
    correlation = correlation / np.maximum(np.sqrt(power * np.square(middle).sum()), np.finfo(float).tiny)
    peak = int(np.argmax(np.abs(correlation)))  # negative where the file holds the force on the finger
    if peak in (0, 2 * reach):
        return float(np.sign(peak - reach) * LONGEST_LAG), float(correlation[peak])
    before, here, after = np.abs(correlation[peak - 1 : peak + 2])
    between = 0.5 * (before - after) / (before - 2 * here + after)  # vertex of the parabola through three points
    return float((peak - reach + between) / LAG_RATE), float(correlation[peak])
