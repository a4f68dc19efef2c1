"""The judge: ratings estimated from a texture, to measure control.

It is fitted on real textures of training surfaces. It is never used in training a generator, which could otherwise
learn to please it without being right.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist
from sklearn.kernel_ridge import KernelRidge
from sklearn.model_selection import PredefinedSplit, cross_val_predict
from sklearn.utils import check_array, check_consistent_length

from ..signal import RATING_AXES

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

    `inputs` (n, features) of the training textures are centred by `centre`, their mean embedding; `friction` is mean
    and standard deviation of log friction, None = not used; `intercept` (axes,) mean ratings, `coefficients` (n, axes).
    `choices` are dicts, one an axis: "axis", "width" (None = linear), "regularisation" and the cross-validated "r2".
    """

    inputs: np.ndarray
    centre: np.ndarray
    friction: tuple[float, float] | None
    intercept: np.ndarray
    coefficients: np.ndarray
    choices: tuple

    @classmethod
    def fit(cls, points, log_friction, ratings, surface_ids, seed=0, axes=RATING_AXES):
        """Fits a judge on embeddings (n, features), log friction (n,), all NaN = not used, and ratings (n, axes), rows
        with a NaN left out; `axes` are their names.

        For each axis the kernel (Gaussian of a few widths, or linear) and the regularisation are those with the least
        error on surfaces left out, in five folds; `surface_ids` (n,) say which textures belong together. About 10 s for
        2000 textures, growing with the cube of their number. A ValueError if lengths differ, a feature is not finite,
        log friction is known of some textures only, or fewer than ten surfaces are rated on all axes.
        """
        check_consistent_length(points, log_friction, ratings, surface_ids)
        rated = np.isfinite(ratings).all(1)
        points, log_friction, ratings, ids = (
            np.asarray(c)[rated] for c in (points, log_friction, ratings, surface_ids)
        )
        names, surface = np.unique(ids, return_inverse=True)
        if len(names) < FEWEST_SURFACES:
            raise ValueError(
                f"`ratings` of {len(names)} surfaces are known on all axes; a judge needs at least {FEWEST_SURFACES}."
            )
        known, centre, intercept = not np.isnan(log_friction).all(), points.mean(0), ratings.mean(0)
        friction = (float(log_friction.mean()), float(log_friction.std()) or 1.0) if known else None
        inputs = _inputs(points, log_friction, centre, friction)
        fold = (np.random.default_rng(seed).permutation(len(names)) % FOLDS)[surface]
        choices, targets, coefficients = _cross_validated(inputs, ratings, fold, axes), ratings - intercept, []
        for axis, choice in enumerate(choices):
            model = KernelRidge(kernel="precomputed", alpha=choice["regularisation"])
            coefficients.append(model.fit(_kernel(inputs, inputs, choice["width"]), targets[:, axis]).dual_coef_)
        return cls(inputs, centre, friction, intercept, np.stack(coefficients, 1), choices)

    def predict(self, points, log_friction):
        """Estimated ratings (n, axes), z-scores, of embedded textures (n, features) and their log friction (n,).

        They spread less than ratings: their slope on them is about R². A ValueError if a feature that is used is not
        finite.
        """
        inputs = _inputs(points, log_friction, self.centre, self.friction)
        ratings = [
            _kernel(inputs, self.inputs, choice["width"]) @ self.coefficients[:, axis]
            for axis, choice in enumerate(self.choices)
        ]
        return self.intercept + np.stack(ratings, 1)


def explained(predicted, ratings):
    """R²: share of the variance of ratings (n, axes), NaN left out, that predictions (n, axes) explain: (axes,)."""
    return 1 - np.nanmean(np.square(predicted - ratings), 0) / np.nanvar(ratings, 0)


def response_matrix(estimated, requested):
    """Slopes of estimated ratings (n, axes) on requested ones: (axes, axes) [estimated axis, requested axis].

    Least squares with an intercept. Ones on the diagonal are full control, zeros none; anything off the diagonal is
    leakage from one rating into another. The judge's own slopes are below one: read it beside the matrix of real
    textures. A ValueError if lengths differ, a value is not finite, or the requests do not vary along all axes.
    """
    check_consistent_length(estimated, requested)
    requested = check_array(requested, input_name="requested")
    rows = np.column_stack([np.ones(len(requested)), requested])
    slopes, _, rank, _ = np.linalg.lstsq(rows, check_array(estimated, input_name="estimated"), rcond=1e-5)
    if rank < rows.shape[1]:
        raise ValueError(
            "`requested` must vary along all axes independently, also when one surface is left out: give more "
            "different requests."
        )
    return slopes[1:].T


def _inputs(points, log_friction, centre, friction):
    """(n, features) centred embedding, and weighted log friction where it is used."""
    points = check_array(points, input_name="points") - centre
    if friction is None:
        return points
    (mean, scale), column = friction, check_array(np.reshape(log_friction, (-1, 1)), input_name="log_friction")
    return np.concatenate([points, FRICTION_WEIGHT * (column - mean) / scale], axis=1)


def _kernel(a, b, width):
    """Kernel matrix (n, m): Gaussian, or linear if `width` is None, then of a diagonal of about 1."""
    if width is None:
        return a @ b.T / a.shape[1]
    return np.exp(-0.5 * cdist(a, b, "sqeuclidean") / width**2)


def _cross_validated(inputs, ratings, fold, axes):
    """Per axis the width and regularisation of the least squared error over all folds: a tuple of dicts."""
    spaced = inputs[np.linspace(0, len(inputs) - 1, min(len(inputs), 1000)).round().astype(int)]
    distance, centred, settings, r2 = np.median(cdist(spaced, spaced)), ratings - ratings.mean(0), [], []
    for width in (None if factor is None else float(factor * distance) for factor in KERNEL_WIDTHS):
        kernel = _kernel(inputs, inputs, width)
        for regularisation in REGULARISATIONS:
            model = KernelRidge(kernel="precomputed", alpha=regularisation)
            settings.append({"width": width, "regularisation": regularisation})
            r2.append(explained(cross_val_predict(model, kernel, centred, cv=PredefinedSplit(fold)), centred))
    best = np.argmax(r2, 0)
    return tuple(
        {"axis": name, **settings[best[axis]], "r2": float(r2[best[axis]][axis])} for axis, name in enumerate(axes)
    )
