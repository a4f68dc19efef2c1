"""The judge: which ratings a texture would be given, read from the texture itself.

It is fitted on real textures of training surfaces and measures whether generated textures carry what was requested. It
is never used in training a generator: a generator that had learnt from it could please it without being right.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

from ..signal import RATING_AXES
from .metrics.statistics import jackknife_interval

#: Weight of log friction beside the features of the embedding, in standard deviations: one number that carries nearly
#: all of slipperiness, beside 53 others. Cross-validated R² of slipperiness on virtual surfaces, weights 1, 3 and 6:
#: 0.55, 0.56, 0.57; the other axes lose up to 0.005.
FRICTION_WEIGHT = 3.0
#: Widths of the Gaussian kernel, as multiples of the median distance between training textures; None = linear kernel.
KERNEL_WIDTHS = (None, 1.0, 2.0)
#: Added to the diagonal of a kernel matrix whose own diagonal is about 1.
REGULARISATIONS = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
FOLDS = 5
#: Two surfaces in each fold: fewer say nothing about unseen ones.
FEWEST_SURFACES = 2 * FOLDS


@dataclass(frozen=True)
class Judge:
    """Kernel ridge regression from textures to ratings; make one with `fit`.

    Args:
        inputs (`np.ndarray`): (n, features) of the training textures, centred.
        centre (`np.ndarray`): (53,) mean embedding.
        friction (`tuple[float, float]` or `None`): mean and standard deviation of log friction; `None` = not used.
        intercept (`np.ndarray`): (3,) mean ratings.
        coefficients (`np.ndarray`): (n, 3).
        choices (`tuple[dict, ...]`): per axis "axis", "width" (None = linear, that is plain ridge regression),
            "regularisation" and "r2", the cross-validated R² over textures.
    """

    inputs: np.ndarray
    centre: np.ndarray
    friction: tuple[float, float] | None
    intercept: np.ndarray
    coefficients: np.ndarray
    choices: tuple

    @classmethod
    def fit(cls, points, log_friction, ratings, surface_ids, seed=0):
        """Fits a judge; about 10 s for 2000 textures, growing with the cube of their number.

        For each axis the kernel (Gaussian of a few widths, or linear) and the regularisation are those with the least
        error on surfaces left out, in five folds.

        Args:
            points (`np.ndarray`): (n, features) z-scores of training surfaces' textures, from `TactileEmbedding`. They
                are not scaled again: its floors keep features that hardly vary from counting.
            log_friction (`np.ndarray`): (n,) natural log of the friction coefficient; all NaN = unknown, not used.
            ratings (`np.ndarray`): (n, 3) of each texture's surface; textures with a NaN are left out.
            surface_ids (`np.ndarray`): (n,) which textures belong together.
            seed (`int`): of the folds.

        Raises:
            ValueError: if shapes do not fit together, a feature is not finite, log friction is known of some textures
                only, or fewer than ten surfaces are rated on all axes.
        """
        points, log_friction = np.asarray(points, dtype=np.float64), np.asarray(log_friction, dtype=np.float64)
        ratings, surface_ids = np.asarray(ratings, dtype=np.float64), np.asarray(surface_ids)
        _check_lengths(points, log_friction=log_friction, ratings=ratings, surface_ids=surface_ids)
        _check_ratings(ratings=ratings)
        rated = ~np.isnan(ratings).any(1)
        points, log_friction, ratings, surface_ids = (
            values[rated] for values in (points, log_friction, ratings, surface_ids)
        )
        names, surface = np.unique(surface_ids, return_inverse=True)
        if len(names) < FEWEST_SURFACES:
            raise ValueError(
                f"`ratings` of {len(names)} surfaces are known on all axes; a judge needs at least {FEWEST_SURFACES}."
            )
        _check_finite("points", points)
        friction = None
        if not np.isnan(log_friction).all():
            _check_finite("log_friction", log_friction[:, None])
            friction = (float(log_friction.mean()), float(log_friction.std()) or 1.0)
        centre = points.mean(0)
        inputs = _inputs(points, log_friction, centre, friction)
        fold = (np.random.default_rng(seed).permutation(len(names)) % FOLDS)[surface]
        choices = _cross_validated(inputs, ratings, fold)
        intercept = ratings.mean(0)
        coefficients = np.empty_like(ratings)
        for axis, choice in enumerate(choices):
            kernel = _kernel(inputs, inputs, choice["width"])
            coefficients[:, axis] = _solve(kernel, ratings[:, axis] - intercept[axis], choice["regularisation"])
        return cls(inputs, centre, friction, intercept, coefficients, choices)

    def predict(self, points, log_friction):
        """Ratings that textures would be given.

        Args:
            points (`np.ndarray`): (n, features), by the embedding that `fit` was given.
            log_friction (`np.ndarray`): (n,); ignored where `friction` is None.

        Returns:
            `np.ndarray`: (n, 3) z-scores. They spread less than ratings: their slope on them is about R².

        Raises:
            ValueError: if shapes do not fit together or a feature that is used is not finite.
        """
        points, log_friction = np.asarray(points, dtype=np.float64), np.asarray(log_friction, dtype=np.float64)
        _check_lengths(points, log_friction=log_friction)
        inputs = _inputs(points, log_friction, self.centre, self.friction)
        ratings = np.empty((len(points), len(RATING_AXES)))
        for axis, choice in enumerate(self.choices):
            kernel = _kernel(inputs, self.inputs, choice["width"])
            ratings[:, axis] = self.intercept[axis] + kernel @ self.coefficients[:, axis]
        return ratings

    def r2(self, points, log_friction, ratings):
        """Share of the variance of ratings over textures that the judge explains: (3,), at most 1.

        Args:
            points, log_friction: as in `predict`.
            ratings (`np.ndarray`): (n, 3) of each texture's surface; NaN is left out.
        """
        sums = _rating_sums(self.predict(points, log_friction), ratings)
        return _r2(*sums.sum(0))

    def r2_interval(self, points, log_friction, ratings, surface_ids):
        """95 % interval of `r2` by leaving out one surface at a time: low and high, (3,) each."""
        _check_lengths(np.asarray(points), surface_ids=surface_ids)
        sums = _rating_sums(self.predict(points, log_friction), ratings)
        total = sums.sum(0)
        return jackknife_interval(_r2(*total), _r2(*np.moveaxis(total - _by_group(sums, surface_ids), 1, 0)))


def response_matrix(recovered, requested):
    """How recovered ratings follow requested ones: least squares with an intercept.

    Ones on the diagonal are full control; zeros, no control; anything off the diagonal, leakage from one rating into
    another. Read it beside the matrix of real textures: the judge's own slopes are below one.

    Args:
        recovered (`np.ndarray`): (n, 3), from `Judge.predict`.
        requested (`np.ndarray`): (n, 3), all specified; for requests that leave axes free, the ratings that come along
            with them (`RatedTextures.mean_rating`).

    Returns:
        `np.ndarray`: (3, 3) slopes, [recovered axis, requested axis].

    Raises:
        ValueError: if shapes differ, a value is not finite, or the requests do not vary along three axes.
    """
    gram, cross = _moments(recovered, requested)
    return _slopes(gram.sum(0), cross.sum(0))


def response_interval(recovered, requested, surface_ids):
    """95 % interval of `response_matrix` by leaving out one surface, or one request, at a time.

    Args:
        recovered, requested: as in `response_matrix`.
        surface_ids (`np.ndarray`): (n,) which textures belong together: takes of one request, or of one surface.

    Returns:
        `tuple[np.ndarray, np.ndarray]`: low and high, (3, 3) each.

    Raises:
        ValueError: also if the requests of fewer surfaces vary along three axes than can be left out.
    """
    gram, cross = _moments(recovered, requested)
    _check_lengths(np.asarray(requested), surface_ids=surface_ids)
    left_out = (sums.sum(0) - _by_group(sums, surface_ids) for sums in (gram, cross))
    return jackknife_interval(_slopes(gram.sum(0), cross.sum(0)), _slopes(*left_out))


def _inputs(points, log_friction, centre, friction):
    """(n, features) centred embedding, and weighted log friction where it is used."""
    if points.shape[1] != len(centre):
        raise ValueError(f"`points` must have {len(centre)} features, as in `fit`, got {points.shape[1]}.")
    _check_finite("points", points)
    if friction is None:
        return points - centre
    _check_finite("log_friction", log_friction[:, None])
    mean, scale = friction
    return np.concatenate([points - centre, FRICTION_WEIGHT * (log_friction[:, None] - mean) / scale], axis=1)


def _kernel(a, b, width):
    """Kernel matrix (n, m): Gaussian, or linear if `width` is None, then of a diagonal of about 1."""
    if width is None:
        return a @ b.T / a.shape[1]
    return np.exp(-0.5 * cdist(a, b, "sqeuclidean") / width**2)


def _solve(kernel, targets, regularisation):
    return cho_solve(cho_factor(kernel + regularisation * np.eye(len(kernel)), lower=True), targets)


def _cross_validated(inputs, ratings, fold):
    """Per axis the width and regularisation of the least squared error over all folds: a tuple of dicts."""
    spaced = inputs[np.linspace(0, len(inputs) - 1, min(len(inputs), 1000)).round().astype(int)]
    distance = np.median(cdist(spaced, spaced))
    widths = [None if factor is None else float(factor * distance) for factor in KERNEL_WIDTHS]
    settings = [(width, regularisation) for width in widths for regularisation in REGULARISATIONS]
    errors = []
    for width in widths:
        kernel = _kernel(inputs, inputs, width)
        for regularisation in REGULARISATIONS:
            errors.append(_left_out_errors(kernel, ratings, fold, regularisation))
    errors = np.array(errors)
    best, variance = errors.argmin(0), ratings.var(0)
    return tuple(
        {
            "axis": name,
            "width": settings[best[axis]][0],
            "regularisation": settings[best[axis]][1],
            "r2": float(1 - errors[best[axis], axis] / variance[axis]),
        }
        for axis, name in enumerate(RATING_AXES)
    )


def _left_out_errors(kernel, ratings, fold, regularisation):
    """Mean squared error on textures of surfaces left out: (3,)."""
    squares = np.zeros(ratings.shape[1])
    for number in range(FOLDS):
        inside, outside = np.flatnonzero(fold != number), np.flatnonzero(fold == number)
        mean = ratings[inside].mean(0)
        coefficients = _solve(kernel[np.ix_(inside, inside)], ratings[inside] - mean, regularisation)
        squares += np.square(mean + kernel[np.ix_(outside, inside)] @ coefficients - ratings[outside]).sum(0)
    return squares / len(ratings)


def _rating_sums(predicted, ratings):
    """What R² is made of, for each texture: (n, 4, 3) squared error, rating, its square, and 1; NaN counts nothing."""
    ratings = np.asarray(ratings, dtype=np.float64)
    _check_lengths(predicted, ratings=ratings)
    _check_ratings(ratings=ratings)
    known, values = ~np.isnan(ratings), np.nan_to_num(ratings)
    return np.stack([known * np.square(predicted - values), values, values**2, known], axis=1)


def _r2(error, total, squares, count):
    return 1 - error / np.maximum(squares - total**2 / np.maximum(count, 1), np.finfo(np.float64).tiny)


def _moments(recovered, requested):
    """Per row the products that least squares is made of: (n, 4, 4) and (n, 4, 3)."""
    recovered, requested = np.asarray(recovered, dtype=np.float64), np.asarray(requested, dtype=np.float64)
    _check_lengths(recovered, requested=requested)
    _check_ratings(recovered=recovered, requested=requested)
    for name, values in (("recovered", recovered), ("requested", requested)):
        if np.isnan(values).any():
            raise ValueError(f"`{name}` must not hold NaN: leave such rows out, or fill in the ratings of the truth.")
    rows = np.concatenate([np.ones((len(requested), 1)), requested], axis=1)
    return rows[:, :, None] * rows[:, None, :], rows[:, :, None] * recovered[:, None, :]


def _slopes(gram, cross):
    """(..., 3, 3) [recovered, requested] from sums of products (..., 4, 4) and (..., 4, 3)."""
    if not (np.linalg.cond(gram) < 1e10).all():
        raise ValueError(
            "`requested` must vary along all three axes independently, also when one surface is left out: give more "
            "different requests."
        )
    return np.swapaxes(np.linalg.solve(gram, cross)[..., 1:, :], -1, -2)


def _by_group(rows, surface_ids):
    """Sums of rows (n, ...) over each surface: (surfaces, ...)."""
    names, group = np.unique(np.asarray(surface_ids), return_inverse=True)
    if len(names) < 2:
        raise ValueError("`surface_ids` must name at least 2 surfaces for an interval.")
    sums = np.zeros((len(names), *rows.shape[1:]))
    np.add.at(sums, group, rows)
    return sums


def _check_finite(name, values):
    bad = ~np.isfinite(values).all(1)
    if bad.any():
        raise ValueError(f"`{name}` must be finite, but texture {np.argmax(bad)} ({bad.sum()} in all) is not.")


def _check_ratings(**ratings):
    for name, values in ratings.items():
        if values.ndim != 2 or values.shape[1] != len(RATING_AXES) or np.isinf(values).any():
            raise ValueError(
                f"`{name}` must have the shape (n, {len(RATING_AXES)}) and no infinity, got {values.shape}."
            )


def _check_lengths(points, **others):
    if points.ndim != 2 or not len(points):
        raise ValueError(f"`points` must have the shape (n, features) and not be empty, got {points.shape}.")
    for name, values in others.items():
        if len(values) != len(points):
            raise ValueError(f"`{name}` must have one entry per texture, {len(points)}, got {len(values)}.")
