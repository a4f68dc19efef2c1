"""The judge: ratings estimated from a texture, to measure control.

It is fitted on real textures of training surfaces. It is never used in training a generator, which could otherwise
learn to please it without being right.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

from ..signal import RATING_AXES
from .metrics.statistics import jackknife

#: Weight of log friction beside the features of the embedding, in standard deviations: one number that carries nearly
#: all of slipperiness, beside the first 53. Cross-validated R² of slipperiness on virtual surfaces, weights 1, 3 and 6:
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
        centre (`np.ndarray`): (features,) mean embedding.
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
            points (`np.ndarray`): (n, features) z-scores of training surfaces' textures, from `TactileEmbedding`.
            log_friction (`np.ndarray`): (n,) natural log of the friction coefficient; all NaN = unknown, not used.
            ratings (`np.ndarray`): (n, 3) of each texture's surface; textures with a NaN are left out.
            surface_ids (`np.ndarray`): (n,) which textures belong together.
            seed (`int`): of the folds.

        Raises:
            ValueError: if shapes do not fit together, a feature is not finite, log friction is known of some textures
                only, or fewer than ten surfaces are rated on all axes.
        """
        points, log_friction = _checked(points, log_friction)
        ratings, surface_ids = _checked_ratings("ratings", ratings, points), np.asarray(surface_ids)
        rated = ~np.isnan(ratings).any(1)
        points, log_friction, ratings = points[rated], log_friction[rated], ratings[rated]
        names, surface = np.unique(surface_ids[rated], return_inverse=True)
        if len(names) < FEWEST_SURFACES:
            raise ValueError(
                f"`ratings` of {len(names)} surfaces are known on all axes; a judge needs at least {FEWEST_SURFACES}."
            )
        known, centre = not np.isnan(log_friction).all(), points.mean(0)
        friction = (float(log_friction.mean()), float(log_friction.std()) or 1.0) if known else None
        inputs = _inputs(points, log_friction, centre, friction)
        fold = (np.random.default_rng(seed).permutation(len(names)) % FOLDS)[surface]
        choices = _cross_validated(inputs, ratings, fold)
        intercept = ratings.mean(0)
        coefficients = [
            _solve(_kernel(inputs, inputs, choice["width"]), ratings[:, axis] - mean, choice["regularisation"])
            for axis, (choice, mean) in enumerate(zip(choices, intercept, strict=True))
        ]
        return cls(inputs, centre, friction, intercept, np.stack(coefficients, 1), choices)

    def predict(self, points, log_friction):
        """Estimated ratings (n, 3), z-scores, of embedded textures (n, features) and their log friction (n,).

        They spread less than ratings: their slope on them is about R². Log friction is ignored where `friction` is
        None.

        Raises:
            ValueError: if shapes do not fit together or a feature that is used is not finite.
        """
        inputs = _inputs(*_checked(points, log_friction), self.centre, self.friction)
        ratings = [
            _kernel(inputs, self.inputs, choice["width"]) @ self.coefficients[:, axis]
            for axis, choice in enumerate(self.choices)
        ]
        return self.intercept + np.stack(ratings, 1)

    def r2(self, points, log_friction, ratings):
        """Share of the variance of ratings (n, 3), NaN left out, over textures that the judge explains: (3,)."""
        return _r2(self.predict(points, log_friction), _checked_ratings("ratings", ratings, points))

    def r2_interval(self, points, log_friction, ratings, surface_ids):
        """95 % interval of `r2` by leaving out one surface at a time: low and high, (3,) each."""
        predicted, ratings = self.predict(points, log_friction), _checked_ratings("ratings", ratings, points)
        return jackknife(lambda mask: _r2(predicted[mask], ratings[mask]), surface_ids)[1]


def _r2(predicted, ratings):
    known = ~np.isnan(ratings)
    error = np.where(known, np.square(predicted - np.nan_to_num(ratings)), 0).sum(0)
    mean = np.nan_to_num(ratings).sum(0) / np.maximum(known.sum(0), 1)
    squares = np.where(known, np.square(np.nan_to_num(ratings) - mean), 0).sum(0)
    return 1 - error / np.maximum(squares, np.finfo(np.float64).tiny)


def response_matrix(estimated, requested):
    """Slopes of estimated on requested ratings: least squares with an intercept.

    Ones on the diagonal are full control, zeros no control; anything off the diagonal is leakage from one rating into
    another. Read it beside the matrix of real textures: the judge's own slopes are below one.

    Args:
        estimated (`np.ndarray`): (n, 3), from `Judge.predict`.
        requested (`np.ndarray`): (n, 3), all specified.

    Returns:
        `np.ndarray`: (3, 3) slopes, [estimated axis, requested axis].

    Raises:
        ValueError: if shapes differ, a value is not finite, or the requests do not vary along three axes.
    """
    requested = _checked_ratings("requested", requested, requested, complete=True)
    estimated = _checked_ratings("estimated", estimated, requested, complete=True)
    rows = np.concatenate([np.ones((len(requested), 1)), requested], axis=1)
    gram = rows.T @ rows
    if not np.linalg.cond(gram) < 1e10:
        raise ValueError(
            "`requested` must vary along all three axes independently, also when one surface is left out: give more "
            "different requests."
        )
    return np.linalg.solve(gram, rows.T @ estimated)[1:].T


def response_interval(estimated, requested, surface_ids):
    """95 % interval of `response_matrix` by leaving out one surface at a time: (2, 3, 3), low and high.

    `surface_ids` (n,) says which textures belong together: takes of one request, or of one surface.

    Raises:
        ValueError: as `response_matrix`, also with one surface left out, or if there are fewer than three surfaces.
    """
    estimated, requested = np.asarray(estimated), np.asarray(requested)
    if len(np.unique(surface_ids)) < 3:
        raise ValueError("`surface_ids` must name at least 3 surfaces for an interval.")
    return jackknife(lambda mask: response_matrix(estimated[mask], requested[mask]), surface_ids)[1]


def _inputs(points, log_friction, centre, friction):
    """(n, features) centred embedding, and weighted log friction where it is used."""
    if points.shape[1] != len(centre):
        raise ValueError(f"`points` must have {len(centre)} features, as in `fit`, got {points.shape[1]}.")
    used = {"points": points} if friction is None else {"points": points, "log_friction": log_friction[:, None]}
    for name, values in used.items():
        bad = ~np.isfinite(values).all(1)
        if bad.any():
            raise ValueError(f"`{name}` must be finite, but texture {np.argmax(bad)} ({bad.sum()} in all) is not.")
    if friction is None:
        return points - centre
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
    settings, errors = [], []
    for width in (None if factor is None else float(factor * distance) for factor in KERNEL_WIDTHS):
        kernel = _kernel(inputs, inputs, width)
        for regularisation in REGULARISATIONS:
            settings.append({"width": width, "regularisation": regularisation})
            errors.append(_left_out_errors(kernel, ratings, fold, regularisation))
    errors, variance = np.array(errors), ratings.var(0)
    best = errors.argmin(0)
    return tuple(
        {"axis": name, **settings[best[axis]], "r2": float(1 - errors[best[axis], axis] / variance[axis])}
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


def _checked(points, log_friction):
    """Both as float64, one entry of log friction for each row of points."""
    points, log_friction = np.asarray(points, dtype=np.float64), np.asarray(log_friction, dtype=np.float64)
    if points.ndim != 2 or log_friction.shape != points.shape[:1] or not len(points):
        raise ValueError(
            f"`points` and `log_friction` must have the shapes (n, features) and (n,), got {points.shape} and "
            f"{log_friction.shape}."
        )
    return points, log_friction


def _checked_ratings(name, ratings, points, complete=False):
    """Ratings (n, 3) as float64, one row for each of `points`; `complete`: without NaN."""
    ratings, shape = np.asarray(ratings, dtype=np.float64), (len(points), len(RATING_AXES))
    if ratings.shape != shape or np.isinf(ratings).any() or (complete and np.isnan(ratings).any()):
        finite = "finite" if complete else "without infinity"
        raise ValueError(f"`{name}` must have the shape {shape} and be {finite}, got {ratings.shape}.")
    return ratings
