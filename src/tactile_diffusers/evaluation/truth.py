"""The truth of a request: measures of real textures of surfaces with such ratings.

A request is a rating vector with NaN where an axis is not specified. No surface has exactly the requested ratings, so
surfaces count by a Gaussian kernel over the specified axes.
"""

from dataclasses import dataclass

import numpy as np

from ..signal import RATING_AXES
from .metrics.statistics import jackknife_interval
from .metrics.texture_checks import in_blocks

#: Standard deviation of the kernel over ratings, z-scores: a third of what ratings spread over surfaces.
KERNEL_WIDTH = 0.25
#: Below so many surfaces that count, a request lies outside of what the data hold: extrapolation.
LEAST_EFFECTIVE_SIZE = 20
# textures that are described at once
CHUNK = 256


@dataclass
class RatedTextures:
    """Measures of textures of rated surfaces, from which the truth of any request is estimated.

    `measures` are name -> (n, ...), one entry per texture; `surface_ids` (n,) are rows of `ratings` (S, axes), NaN =
    not rated. `importance` (S,) is how much of the population a surface stands for: ones, or draws over probability if
    they were drawn. `dropped` surfaces gave no texture. A ValueError if these do not fit together.
    """

    measures: dict
    surface_ids: np.ndarray
    ratings: np.ndarray
    importance: np.ndarray
    dropped: int = 0

    def __post_init__(self):
        self.surface_ids = np.asarray(self.surface_ids, dtype=np.int64)
        self.ratings = np.asarray(self.ratings, dtype=np.float64)
        self.importance = np.asarray(self.importance, dtype=np.float64)
        self.measures = {name: np.asarray(values) for name, values in self.measures.items()}
        if not np.array_equal(np.unique(self.surface_ids), np.arange(len(self.importance))):
            raise ValueError("`surface_ids` must name each surface of `importance` at least once, and no other.")
        if not (self.importance > 0).all():
            raise ValueError("`importance` must be above zero: leave out surfaces that were not drawn.")
        if len(self.ratings) != len(self.importance):
            raise ValueError(f"`ratings` must have a row for each of `importance`, got {len(self.ratings)}.")
        if wrong := {name: len(v) for name, v in self.measures.items() if len(v) != len(self.surface_ids)}:
            raise ValueError(f"`measures` must have one entry per texture, {len(self.surface_ids)}, got {wrong}.")
        self._textures = np.bincount(self.surface_ids)

    def surface_weights(self, request):
        """Weight of each surface for a request, (3,) z-scores (NaN or None = not specified): (S,), of sum 1."""
        logs = log_kernel(self.ratings, request) + np.log(self.importance)
        weights = np.exp(logs - logs.max())
        return weights / weights.sum()

    def weights(self, request):
        """Weight of each texture for a request: (n,), of sum 1; a surface's textures share its weight."""
        return (self.surface_weights(request) / self._textures)[self.surface_ids]

    def effective_size(self, request):
        """Number of equally weighted surfaces that would be as good: (sum w)^2 / sum w^2 (Kish 1965)."""
        return float(1 / np.sum(self.surface_weights(request) ** 2))

    def mean_rating(self, request):
        """Mean ratings of the surfaces that count for a request: (3,), NaN where none is rated.

        On specified axes they lie nearer to the middle than the request; on the others they say what comes along.
        """
        weights = self.surface_weights(request)[:, None] * ~np.isnan(self.ratings)
        total = weights.sum(0)
        return np.where(total > 0, (weights * np.nan_to_num(self.ratings)).sum(0) / np.maximum(total, 1e-300), np.nan)

    def draw_ratings(self, request, count):
        """Ratings of the surfaces that count for a request: those to generate from, to be compared with them.

        `request` (3,) z-scores specifies one axis at most, else a ValueError. Returns (count, 3), evenly spread over
        their distribution, ascending; NaN on axes that are not specified.
        """
        request = np.asarray(request, dtype=np.float64)
        specified = np.flatnonzero(~np.isnan(request))
        if len(specified) > 1:
            raise ValueError(f"`request` must specify one axis at most, got {request.tolist()}.")
        drawn = np.full((count, len(request)), np.nan)
        if len(specified):
            values = self.ratings[:, specified[0]]
            order = np.argsort(values)
            shares = np.cumsum(np.nan_to_num(self.surface_weights(request))[order])
            places = np.searchsorted(shares, (np.arange(count) + 0.5) / count * shares[-1])
            drawn[:, specified[0]] = values[order][np.minimum(places, len(order) - 1)]
        return drawn

    def mean(self, name, request):
        """Weighted mean of a measure over textures: (...,)."""
        return np.tensordot(self.weights(request), self.measures[name], 1)

    def interval(self, name, request):
        """95 % interval of `mean`, leaving out one surface at a time: low and high, (...,); NaN for fewer than two."""
        return self._interval(request, *self._left_out(name, request))

    def change(self, name, request):
        """`mean` over that of the whole population, and its 95 % interval as of `interval`: (...,) and two of these."""
        nothing = np.full(self.ratings.shape[1], np.nan)
        (value, left_out), (base, base_left_out) = (self._left_out(name, r) for r in (request, nothing))
        return value - base, self._interval(request, value - base, left_out - base_left_out)

    def _left_out(self, name, request):
        """`mean`, and for each surface the mean without it: (...,) and (S, ...)."""
        values, weights = self.measures[name], self.surface_weights(request)
        sums = np.zeros((len(weights), *values.shape[1:]))
        np.add.at(sums, self.surface_ids, values)
        column = (slice(None), *[None] * (values.ndim - 1))
        shares = sums * (weights / self._textures)[column]
        estimate = shares.sum(0)
        return estimate, (estimate - shares) / np.maximum(1 - weights, 1e-12)[column]

    def _interval(self, request, estimate, left_out):
        size = self.effective_size(request)
        if size < 2:
            return np.full_like(estimate, np.nan), np.full_like(estimate, np.nan)
        return jackknife_interval(estimate, left_out, size)

    def halves(self, rng):
        """Two random halves of the surfaces: a tuple of two `RatedTextures`."""
        first = rng.permutation(len(self.ratings)) < len(self.ratings) // 2
        return self._keep(first), self._keep(~first)

    def _keep(self, surfaces):
        rows, number = surfaces[self.surface_ids], np.cumsum(surfaces) - 1
        measures = {name: values[rows] for name, values in self.measures.items()}
        return RatedTextures(
            measures, number[self.surface_ids[rows]], self.ratings[surfaces], self.importance[surfaces]
        )


def log_kernel(ratings, request, width=KERNEL_WIDTH):
    """Log of the Gaussian kernel between ratings (S, axes) and a request (axes,) over its specified axes: (S,).

    0 at the request itself, -inf for a surface that is not rated on a specified axis. A ValueError if `request` is not
    a rating of each axis, `width` (z-scores) is not above zero, or no surface is rated on a specified axis.
    """
    request = np.asarray(request, dtype=np.float64)  # None becomes NaN
    axes = ratings.shape[1]
    if request.shape != (axes,) or np.isinf(request).any():
        raise ValueError(f"`request` must be {axes} ratings, NaN = not specified, got {request.tolist()}.")
    if not width > 0:
        raise ValueError(f"`width` must be above zero, got {width}.")
    specified = ~np.isnan(request)
    logs = -0.5 * np.square((ratings[:, specified] - request[specified]) / width).sum(1)
    if np.isnan(logs).all():
        names = [RATING_AXES[k] if k < len(RATING_AXES) else f"axis {k}" for k in np.flatnonzero(specified)]
        raise ValueError(f"No surface is rated on {' and '.join(names)}: leave these axes of `request` unspecified.")
    return np.where(np.isnan(logs), -np.inf, logs)


def recorded_truth(dataset, describe, per_surface=4, seed=0):
    """The truth of requests, of importance 1, from all surfaces of a view of a data set (the split "all").

    `describe(textures, levels, friction_coefficients)` gives `measures` of textures (n, samples) in N; levels and
    friction coefficients, both (n,), may be NaN.
    """
    chosen = dataset.non_overlapping(per_surface, seed)
    measures = [
        describe(dataset.textures(rows), dataset.levels[rows], dataset.friction_coefficients[rows])
        for rows in in_blocks(chosen, CHUNK)
    ]
    surfaces, surface_ids = np.unique(dataset.surface_ids[chosen], return_inverse=True)
    return RatedTextures(joined(measures), surface_ids, dataset.ratings.mean[surfaces], np.ones(len(surfaces)))


def joined(parts):
    """Dicts of arrays, joined along their first axis."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
