"""Ratings: from raters' answers to one vector per surface (paper section 2.1), and how far the raters agree.

Axes are what the data name: the three of `RATING_AXES` come first, others follow.
"""

from dataclasses import dataclass, field

import numpy as np

from ..signal import RATING_AXES, coverage_distance

#: A rater whose answers (0-8 scale) have a smaller standard deviation gives one answer: the rest is rounding.
LEAST_DEVIATION = 1e-6
#: Beginnings of the words that name the three axes, or their other direction.
_STEMS = dict(zip(RATING_AXES, (("rough", "smooth"), ("bump", "flat", "even"), ("slipper", "stick")), strict=True))
_LARGER = dict(zip(RATING_AXES, ("rougher", "bumpier", "more slippery"), strict=True))
#: Correlations over fewer common surfaces are left out: over two, every one is 1 or -1.
LEAST_COMMON = 3
#: Why a rater is left out of an axis, by the number of answers.
_TOO_FEW = ("no answer on", "one answer on", "the same answer on all")
#: Values of the table behind percentiles, one every 5 %. Straight lines between them are off by 0.03 z (RMS, 480
#: virtual surfaces), less than the quantiles' own sampling error: 0.05 z for 480 surfaces, 0.17 z for 40.
QUANTILES = 21


@dataclass
class RatingReliability:
    """How far raters agree on each axis, over all rated surfaces: nothing is trained on it.

    Attributes:
        axes (`tuple[str, ...]`): names of the axes, in the order of the arrays.
        mean_correlation (`np.ndarray`): (axes,) mean over pairs of raters of Pearson's correlation over the surfaces
            that both rated, 3 at least; NaN without a pair.
        alpha (`np.ndarray`): (axes,) standardised Cronbach's alpha, see `rating_reliability`; NaN without a pair.
        raters (`np.ndarray`): (axes,) int64, raters that are in a pair.
        pairs (`np.ndarray`): (axes,) int64, pairs with a correlation.
        raters_per_surface (`np.ndarray`): (axes,) mean number of these raters over the surfaces they rated; NaN
            without a pair.
    """

    axes: tuple[str, ...]
    mean_correlation: np.ndarray
    alpha: np.ndarray
    raters: np.ndarray
    pairs: np.ndarray
    raters_per_surface: np.ndarray

    def __str__(self):
        return "\n".join(
            f"{axis}: mean inter-rater correlation {self.mean_correlation[i]:.2f} ({self.pairs[i]} pairs of "
            f"{self.raters[i]} raters), Cronbach's alpha {self.alpha[i]:.2f} "
            f"({self.raters_per_surface[i]:.1f} raters a surface)"
            for i, axis in enumerate(self.axes)
        )


@dataclass
class SurfaceRatings:
    """Pooled ratings of surfaces.

    Attributes:
        mean (`np.ndarray`): (surfaces, axes) float32, mean over raters of their z-scores; NaN = not rated.
        std (`np.ndarray`): (surfaces, axes) float32, population standard deviation over raters.
        count (`np.ndarray`): (surfaces, axes) float32, raters that answered.
        raw_mean, raw_scale (`np.ndarray`): (axes,) float32, the typical rater's mean and standard deviation, 0-8 scale.
        left_out (`list[str]`): raters left out of an axis, and why.
        reliability (`RatingReliability` or `None`): how far the raters agree; `None` if nobody rated.
        single (`np.ndarray` or `None`): (raters, surfaces, axes) float32, z-scores of single raters, NaN = no answer;
            `None` if nobody rated.
        axes (`tuple[str, ...]`): their names.
    """

    mean: np.ndarray
    std: np.ndarray
    count: np.ndarray
    raw_mean: np.ndarray
    raw_scale: np.ndarray
    left_out: list = field(default_factory=list)
    reliability: RatingReliability | None = None
    single: np.ndarray | None = None
    axes: tuple[str, ...] = RATING_AXES

    def take(self, axes):
        """The same ratings on these axes, in this order; NaN where nobody was asked. Reliability stays that of all."""
        columns = [self.axes.index(axis) if axis in self.axes else None for axis in axes]

        def taken(values, nothing=np.nan):
            parts = [np.full(values.shape[:-1], nothing) if c is None else values[..., c] for c in columns]
            return np.stack(parts, axis=-1).astype(np.float32)

        single = None if self.single is None else taken(self.single)
        moments = taken(self.mean), taken(self.std), taken(self.count, 0), taken(self.raw_mean), taken(self.raw_scale)
        return SurfaceRatings(*moments, self.left_out, self.reliability, single, tuple(axes))

    @classmethod
    def from_dict(cls, fields):
        """The inverse of `dataclasses.asdict`."""
        fields = {**fields, "left_out": list(fields["left_out"]), "axes": tuple(fields.get("axes", RATING_AXES))}
        if fields.get("reliability") is not None:
            fields["reliability"] = RatingReliability(**fields["reliability"])
        return cls(**fields)


def no_ratings(surfaces):
    """`SurfaceRatings` of surfaces that nobody rated: NaN, count 0."""
    unknown = np.full((surfaces, len(RATING_AXES)), np.nan, np.float32)
    axis = np.full(len(RATING_AXES), np.nan, np.float32)
    return SurfaceRatings(unknown, unknown.copy(), np.zeros_like(unknown), axis, axis.copy())


def pool_ratings(scores, surfaces, training):
    """Z-scores each rater and axis on the training surfaces only, then averages over raters.

    The mean is never standardised again: as raters disagree, it varies less over surfaces than one rater's z-scores. A
    rater without two different answers on training surfaces is left out of that axis, and `left_out` names the rater.
    A further axis on which nobody differs is left out, too.

    Args:
        scores (`RaterScores`): answers on the 0-8 scale, NaN = missing.
        surfaces (`list[str]`): the order of the result; surfaces without answers become NaN.
        training (`np.ndarray`): (surfaces,) bool.

    Returns:
        `SurfaceRatings`.

    Raises:
        ValueError: if an axis of `RATING_AXES` is missing, axes clash (`check_axes`), a surface is named twice, or no
            rater is left on one of `RATING_AXES`.
    """
    _axis_numbers(scores, RATING_AXES)
    names = check_axes(scores.axes)
    axes = _axis_numbers(scores, names)
    column = {name: i for i, name in enumerate(scores.surfaces)}
    if len(column) < len(scores.surfaces):
        twice = next(name for i, name in enumerate(scores.surfaces) if column[name] != i)
        raise ValueError(f"`scores` has the surface {twice!r} more than once: merge or rename its answers.")
    values = np.full((len(scores.raters), len(surfaces), len(names)), np.nan)
    rated = [i for i, name in enumerate(surfaces) if name in column]
    values[:, rated] = scores.values[:, [column[surfaces[i]] for i in rated]][:, :, axes]

    mean, scale, answers = _moments(values[:, training], axis=1)
    usable = scale > LEAST_DEVIATION
    left_out = [
        f"{scores.raters[r]} on {names[a]}: {_TOO_FEW[min(2, answers[r, a])]} training surfaces"
        for r, a in np.argwhere(~usable)
    ]
    rated = usable.any(axis=0)
    if not rated[: len(RATING_AXES)].all():
        axis = RATING_AXES[int(np.argmin(rated))]
        raise ValueError(f"No rater differs between training surfaces on {axis}: add ratings or training surfaces.")
    z = (values - mean[:, None]) / np.where(usable, scale, np.nan)[:, None]
    pooled, deviation, count = _moments(z, axis=0)
    pooled[count == 0] = deviation[count == 0] = np.nan
    kept = tuple(name for name, known in zip(names, rated, strict=True) if known)
    usable, mean, scale, *pooled = (array[:, rated] for array in (usable, mean, scale, pooled, deviation, count))
    typical = [np.nanmean(np.where(usable, moment, np.nan), axis=0).astype(np.float32) for moment in (mean, scale)]
    pooled = [array.astype(np.float32) for array in pooled]
    reliability = rating_reliability(scores, kept)
    return SurfaceRatings(*pooled, *typical, left_out, reliability, z[..., rated].astype(np.float32), kept)


def check_axes(axes):
    """The names of axes, those of `RATING_AXES` first.

    Raises:
        ValueError: if two names are the same but for capitals, or one names an axis of `RATING_AXES` another way or
            in the other direction, such as "smoothness".
    """
    found = {}
    for axis in axes:
        known = [ours for ours, stems in _STEMS.items() if axis.lower().startswith(stems)]
        if known and axis != known[0]:
            raise ValueError(
                f"`axes`: {axis!r} is {known[0]!r} by another name or in the other direction. Call it {known[0]}; "
                f"larger answers must mean {_LARGER[known[0]]}."
            )
        if axis.lower() in found:
            raise ValueError(f"`axes`: {found[axis.lower()]!r} and {axis!r} are the same name. Rename one of them.")
        found[axis.lower()] = axis
    return (*(axis for axis in RATING_AXES if axis in axes), *(axis for axis in axes if axis not in RATING_AXES))


def _axis_numbers(scores, axes):
    absent = [axis for axis in axes if axis not in scores.axes]
    if absent:
        raise ValueError(f"`scores` lacks the axes {absent} (it has {list(scores.axes)}): name them {tuple(axes)}.")
    return [scores.axes.index(axis) for axis in axes]


def _moments(values, axis):
    """Mean, population standard deviation and count along an axis, NaN left out; zeros where all is NaN."""
    known = ~np.isnan(values)
    count = known.sum(axis)
    divisor = np.maximum(count, 1)
    mean = np.where(known, values, 0).sum(axis) / divisor
    deviation = np.where(known, values - np.expand_dims(mean, axis), 0)
    return mean, np.sqrt(np.square(deviation).sum(axis) / divisor), count


def rating_reliability(scores, axes=RATING_AXES):
    """Mean inter-rater correlation and Cronbach's alpha of each axis.

    Alpha is the standardised one, k r / (1 + (k - 1) r), with r the mean correlation of pairs of raters and k the mean
    number of raters a surface: the reliability of the mean over k raters (Spearman-Brown). Without missing answers it
    is exactly Cronbach's alpha of the raters' z-scores (Cronbach 1951, "Coefficient alpha and the internal structure of
    tests"). Units do not matter: raw answers and z-scores correlate alike.

    Args:
        scores (`RaterScores`): answers, NaN = missing.
        axes (`Sequence[str]`, *optional*): which of the axes of `scores`; defaults to `RATING_AXES`.

    Returns:
        `RatingReliability`.

    Raises:
        ValueError: if `scores` lacks an axis.
    """
    columns = [_agreement(scores.values[:, :, number]) for number in _axis_numbers(scores, axes)]
    return RatingReliability(tuple(axes), *(np.array(column) for column in zip(*columns, strict=True)))


def _agreement(answers):
    """Mean correlation, alpha, raters, pairs and raters a surface of one axis: (raters, surfaces) answers."""
    of_pairs = axis_correlation(answers.T)
    of_pairs[np.diag_indices(len(answers))] = np.nan
    known = ~np.isnan(of_pairs)
    if not known.any():
        return np.nan, np.nan, 0, 0, np.nan
    r, paired = of_pairs[known].mean(), known.any(axis=0)
    per_surface = (~np.isnan(answers[paired])).sum(axis=0)
    k = per_surface[per_surface > 0].mean()
    divisor = 1 + (k - 1) * r  # zero or less: raters contradict each other more than k complete raters could
    return r, k * r / divisor if divisor > 0 else np.nan, paired.sum(), known.sum() // 2, k


def axis_correlation(mean):
    """Pearson correlations of columns over the rows that both know.

    Args:
        mean (`np.ndarray`): (surfaces, axes) pooled ratings, NaN = not rated.

    Returns:
        `np.ndarray`: (axes, axes) float64; NaN for two axes with fewer than 3 surfaces rated on both, or all alike.
    """
    import pandas

    return pandas.DataFrame(mean).corr(min_periods=LEAST_COMMON).to_numpy(copy=True)


def rating_quantiles(mean):
    """Quantiles of pooled means at 0, 5, ... 100 %, the table behind percentiles.

    Args:
        mean (`np.ndarray`): (surfaces, axes) z-scores, NaN = not rated; training surfaces only.

    Returns:
        `np.ndarray`: (axes, 21) float64, ascending; the ends are the smallest and largest rating. NaN for an axis on
        which no surface is rated.
    """
    shares = np.linspace(0, 1, QUANTILES)
    known = [column[~np.isnan(column)] for column in np.asarray(mean, dtype=np.float64).T]
    return np.stack([np.quantile(k, shares) if len(k) else np.full(QUANTILES, np.nan) for k in known])


def rating_coverage(mean):
    """Where in the space of ratings surfaces lie: centre (axes,), covariance (axes, axes) and reach.

    The reach is the largest Mahalanobis distance of a surface from the centre; `coverage_distance` is how far others
    are.

    Args:
        mean (`np.ndarray`): (surfaces, axes) pooled ratings; surfaces with a NaN are left out.

    Returns:
        `tuple[np.ndarray, np.ndarray, float]`, or `None` for fewer surfaces than settle a covariance.
    """
    known = mean[np.isfinite(mean).all(1)].astype(np.float64)
    if len(known) < 2 * mean.shape[1]:
        return None
    centre = known.mean(0)
    covariance = np.cov(known.T) + 1e-6 * np.eye(mean.shape[1])  # axes that are always rated alike stay solvable
    return centre, covariance, float(coverage_distance(known, centre, covariance).max())
