"""Ratings: from raters' answers to one vector per surface (paper section 2.1)."""

from dataclasses import dataclass, field

import numpy as np

from ..signal import RATING_AXES


@dataclass
class SurfaceRatings:
    """Pooled ratings of surfaces.

    Attributes:
        mean (`np.ndarray`): (surfaces, 3) float32, mean over raters of their z-scores; NaN = not rated.
        std (`np.ndarray`): (surfaces, 3) float32, spread over raters (population standard deviation).
        count (`np.ndarray`): (surfaces, 3) float32, raters that answered.
        raw_mean, raw_scale (`np.ndarray`): (3,) float32, the typical rater's mean and standard deviation, 0-8 scale.
        left_out (`list[str]`): raters left out of an axis, and why.
    """

    mean: np.ndarray
    std: np.ndarray
    count: np.ndarray
    raw_mean: np.ndarray
    raw_scale: np.ndarray
    left_out: list = field(default_factory=list)


def no_ratings(surfaces):
    """`SurfaceRatings` of surfaces that nobody rated: NaN, count 0."""
    shape = (surfaces, len(RATING_AXES))
    nothing = np.full(shape, np.nan, np.float32)
    axis = np.full(len(RATING_AXES), np.nan, np.float32)
    return SurfaceRatings(nothing, nothing.copy(), np.zeros(shape, np.float32), axis, axis.copy())


def pool_ratings(scores, surfaces, training):
    """Z-scores each rater and axis on the training surfaces only, then averages over raters.

    The mean is never standardised again, so its standard deviation over surfaces stays below 1.

    Args:
        scores (`RaterScores`): answers on the 0-8 scale, NaN = missing.
        surfaces (`list[str]`): the order of the result; surfaces without answers become NaN.
        training (`np.ndarray`): (surfaces,) bool.

    Returns:
        `SurfaceRatings`.

    Raises:
        ValueError: if an axis of `RATING_AXES` is missing, or no rater is left on one.
    """
    absent = [axis for axis in RATING_AXES if axis not in scores.axes]
    if absent:
        raise ValueError(f"`scores` lacks the axes {absent} (it has {list(scores.axes)}): name them {RATING_AXES}.")
    values = np.full((len(scores.raters), len(surfaces), len(RATING_AXES)), np.nan)
    column = {name: i for i, name in enumerate(scores.surfaces)}
    rated = [i for i, name in enumerate(surfaces) if name in column]
    axes = [scores.axes.index(axis) for axis in RATING_AXES]
    values[:, rated] = scores.values[:, [column[surfaces[i]] for i in rated]][:, :, axes]

    mean, scale, answers = _moments(values[:, training], axis=1)
    usable = (answers > 0) & (scale > 0)
    left_out = [
        f"{scores.raters[r]} on {RATING_AXES[a]}: "
        + ("no answer on training surfaces" if answers[r, a] == 0 else "the same answer everywhere")
        for r, a in np.argwhere(~usable)
    ]
    if not usable.any(axis=0).all():
        axis = RATING_AXES[int(np.argmin(usable.any(axis=0)))]
        raise ValueError(f"No rater differs between training surfaces on {axis}: add ratings or training surfaces.")
    z = (values - mean[:, None]) / np.where(usable, scale, np.nan)[:, None]
    pooled, spread, count = _moments(z, axis=0)
    pooled[count == 0] = spread[count == 0] = np.nan
    typical = [np.nanmean(np.where(usable, moment, np.nan), axis=0).astype(np.float32) for moment in (mean, scale)]
    return SurfaceRatings(*(a.astype(np.float32) for a in (pooled, spread, count)), *typical, left_out)


def _moments(values, axis):
    """Mean, population standard deviation and count along an axis, NaN left out; zeros where all is NaN."""
    known = ~np.isnan(values)
    count = known.sum(axis)
    divisor = np.maximum(count, 1)
    mean = np.where(known, values, 0).sum(axis) / divisor
    deviation = np.where(known, values - np.expand_dims(mean, axis), 0)
    return mean, np.sqrt(np.square(deviation).sum(axis) / divisor), count


def to_raw(ratings, raw_mean, raw_scale):
    """From ratings in z-scores to the typical rater's 0-8 scale: (..., 3), not clipped."""
    return np.asarray(ratings) * raw_scale + raw_mean


def from_raw(answers, raw_mean, raw_scale):
    """From the typical rater's 0-8 scale to ratings in z-scores: (..., 3)."""
    return (np.asarray(answers) - raw_mean) / raw_scale
