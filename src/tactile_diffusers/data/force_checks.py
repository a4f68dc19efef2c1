"""Checks of contact forces: a wrong unit, swapped axes, a sensor at the end of its range; and of ratings."""

import numpy as np

from ..signal import REFERENCE_FORCE
from ..signal.constants import LARGEST_FORCE_N
from ..signal.masks import mask_of_runs, true_runs
from ..signal.rating_scales import RATING_SCALE

#: No finger explores with a larger mean normal force (N); the paper's is 0.4-0.6 N (recipe).
LARGEST_MEAN_NORMAL_N = 15.0
#: A larger share of samples above `LARGEST_FORCE_N` is a wrong unit, a smaller one is glitches (recipe).
GLITCH_SHARE = 0.01
#: What newtons are mistaken for, and how many N one of it is.
OTHER_UNITS = {"mN": 1e-3, "gram-force": 9.80665e-3}
#: A sensor that stays at the extreme value of a channel for this long (s) is saturated (recipe).
SATURATION_SECONDS = 0.005
#: So many samples, evenly spread, show the sign and mean of a channel.
_GLANCE = 20_000


def check_forces(force, where, unit="N"):
    """Refuses forces that cannot be newtons of a fingertip, or whose normal axis cannot be z.

    Args:
        force (`np.ndarray`): (n, 3) [x, y along the surface, z normal], or (n,) lateral force alone; NaN = missing.
        where (`str`): file and place, for messages.
        unit (`str`): "N"; with "1" (uncalibrated) only the axes are checked.

    Returns:
        `list[str]`: notes on what is only suspicious; what differs between recordings is in brackets.

    Raises:
        ValueError: if every sample is NaN, more than 1 % of them are above 100 N, the mean normal force is above 15 N,
            or another axis is clearly the normal one.
    """
    glance = _known(force[:: max(1, len(force) // _GLANCE)])
    if not len(glance):
        glance = _known(force)
    if not len(glance):
        raise ValueError(f"{where}: holds only NaN. Leave this recording out.")
    notes = _check_unit(force, glance, where) if unit == "N" else []
    return notes + (_check_axes(glance, where) if force.ndim == 2 else [])


def _known(force):
    missing = np.isnan(force)
    return force[~(missing.any(axis=-1) if force.ndim == 2 else missing)]


def _check_unit(force, glance, where):
    mean = abs(float(glance[:, 2].mean())) if force.ndim == 2 else float(np.abs(glance).mean())
    largest = max(float(np.fmax.reduce(force, axis=None)), -float(np.fmin.reduce(force, axis=None)))
    above = over_range(force) if largest > LARGEST_FORCE_N else np.zeros(1, dtype=bool)
    place = int(np.argmax(above))
    if above.mean() > GLITCH_SHARE:
        problem = f"reaches {largest:.4g} N, no fingertip {LARGEST_FORCE_N:.0f} N (first at sample {place})"
        raise ValueError(f"{where}: {problem}. {_likely_unit(mean)}")
    if force.ndim == 2 and mean > LARGEST_MEAN_NORMAL_N:
        problem = f"the normal force is {mean:.4g} N on average, a finger explores with less than"
        raise ValueError(f"{where}: {problem} {LARGEST_MEAN_NORMAL_N:.0f} N. {_likely_unit(mean)}")
    if above.any():
        return [f"samples above {LARGEST_FORCE_N:.0f} N excluded ({int(above.sum())}, first at sample {place})"]
    return []


def _likely_unit(normal):
    unit = min(OTHER_UNITS, key=lambda name: abs(np.log(max(normal, 1e-9) * OTHER_UNITS[name] / REFERENCE_FORCE)))
    newtons = OTHER_UNITS[unit]
    remedy = f"divide by {1 / newtons:.0f}" if unit == "mN" else f"multiply by {newtons:.5f}"
    return f"The values are probably in {unit}: {remedy}, which gives {normal * newtons:.3g} N."


def _check_axes(force, where):
    mean = np.abs(force.mean(axis=0))
    steady = [_keeps_sign(values) for values in force.T]
    rivals = [axis for axis in (0, 1) if mean[axis] > mean[2]]
    facts = "(mean force x {:.3g}, y {:.3g}, z {:.3g})".format(*force.mean(axis=0))
    if normal := [axis for axis in rivals if steady[axis] and not steady[2]]:
        name = "xy"[max(normal, key=lambda axis: mean[axis])]
        raise ValueError(
            f"{where}: z changes sign while {name} does not, and is larger {facts}: {name} looks like the normal "
            "force. Store x and y along the surface and z normal to it."
        )
    if rivals:
        return [f"z is not the largest force on average: swapped axes, or friction above 1 {facts}"]
    return [] if steady[2] else [f"the normal force z changes sign {facts}"]


def _keeps_sign(values):
    """Whether the 5th and 95th percentile have one sign; noise about zero, a tenth of the other end, is forgiven."""
    low, high = np.percentile(values, [5, 95])
    return bool(max(-low, high) > 0 and min(-low, high) <= 0.1 * max(-low, high))


def over_range(force):
    """Samples above 100 N in any channel of (n, 3) or (n,) forces in N: (n,) bool. NaN is not above."""
    above = np.abs(force) > LARGEST_FORCE_N
    return above.any(axis=-1) if force.ndim == 2 else above


def saturated(values, rate):
    """Runs of at least 5 ms, and three samples, at the largest or smallest value of a channel.

    A constant channel is not saturated, nor is one that dwells at least as often at values in between (coarsely
    quantised, or held), and an exact 0 is a force that was clamped or never measured, not a rail. `values` is one
    channel, (n,), NaN = missing, at `rate` Hz; the result is (n,) bool.
    """
    mask = np.zeros(len(values), dtype=bool)
    low, high = np.fmin.reduce(values), np.fmax.reduce(values)  # NaN left out, NaN if nothing else
    shortest = max(3, int(round(SATURATION_SECONDS * rate)))
    if not low < high:
        return mask
    rails = [values == extreme for extreme in (low, high) if extreme]
    runs = [true_runs(rail, shortest) for rail in rails if np.count_nonzero(rail) >= shortest]
    runs = np.concatenate([*runs, np.empty((0, 2), np.int64)])
    if not len(runs):
        return mask
    between = np.concatenate([[False], values[1:] == values[:-1]]) & (values != low) & (values != high)
    return mask if len(true_runs(between, shortest - 1)) >= len(runs) else mask_of_runs(runs, len(values))


def out_of_range(force, rate, unit):
    """Samples of (n, 3) or (n,) forces at which a sensor was at the end of its range, or above 100 N: (n,) bool."""
    axes = force.T if force.ndim == 2 else [force]
    broken = np.any([saturated(axis, rate) for axis in axes], axis=0)
    return broken | over_range(force) if unit == "N" else broken


def check_ratings(values, shape, where):
    """Raises a `ValueError` unless answers have this shape and lie on the scale; NaN = missing."""
    if values.shape != shape:
        raise ValueError(f"{where} has shape {values.shape}, the names of raters, surfaces and axes give {shape}.")
    low, high = RATING_SCALE
    outside = values[(values < low) | (values > high)]
    if outside.size:
        raise ValueError(
            f"{where} {outside.size} ratings lie outside {low:g}-{high:g} (for example {outside[0]:g}). "
            "Map the scale to 0-8 and write missing answers as NaN."
        )
