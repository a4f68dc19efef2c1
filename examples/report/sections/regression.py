"""Section "regression": how well a function of the ratings predicts the mean spectrum of an unseen surface.

Ratings do not determine a surface: the error of the best polynomial is what no generator can be expected to beat.
"""

import numpy as np
from sklearn.linear_model import Ridge
from sklearn.model_selection import PredefinedSplit, cross_val_predict
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures

from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.evaluation.metrics.statistics import leaf, number
from tactile_diffusers.signal import band_levels_db

from ..envelopes import surface_means
from ..virtual_truth import can_be_continued, virtual_truth
from .generation import unseen_errors

DEGREES = (1, 2, 3)
#: Added to the diagonal of the normal equations, in surfaces: holds a cubic of 50 surfaces in check, else nothing.
PENALTY = 1.0
FOLDS = 5


def run(context):
    """The section: `{"regression": {"same_data": ..., "many_surfaces": ...}}`; the latter of fresh surfaces."""
    data, training = context.data, context.data.training
    bands = band_levels_db(training.textures, data.rate, data.edges)
    generated, surfaces = context.generated[context.default_guidance], context.requests[1]
    ours = unseen_errors(data, generated.textures, surfaces)
    found = {"same_data": _fitted(data, ours, bands, training.ratings, training.surface_ids)}
    count = context.settings.regression_surfaces
    if can_be_continued(data.dataset):
        fresh = virtual_truth(
            PreparedDataset(data.dataset.path, "all").set_axes(context.axes),
            [[np.nan] * len(context.axes)],
            lambda textures, levels, frictions: {"bands": band_levels_db(textures, data.rate, data.edges)},
            surfaces=count,
            candidates=max(count, context.settings.truth_candidates),
            seconds=context.settings.truth_seconds,
            seed=context.seed + 1,
            workers=2,
            quiet=context.quiet,
        )
        ratings = fresh.ratings[fresh.surface_ids]
        found["many_surfaces"] = _fitted(data, ours, fresh.measures["bands"], ratings, fresh.surface_ids)
    return {"regression": found}


def _fitted(data, ours, bands, ratings, surface_ids):
    """Leaves of the best degree: error on held-out surfaces, also over `ours` (surfaces,), degree and surfaces."""
    rated = np.isfinite(ratings).all(1)
    ratings, bands, ids = ratings[rated], bands[rated], surface_ids[rated]
    points, targets = (surface_means(values, ids) for values in (ratings, bands))
    predict, degree = best_polynomial(points, targets, data.seed)
    requested, real = (surface_means(values, data.surfaces) for values in (data.ratings, data.bands))
    known = np.isfinite(requested).all(1)
    errors = np.abs(predict(requested[known]) - real[known]).mean(-1)
    return {
        "nine_band_db": leaf(errors),
        "nine_band_over_model_db": leaf(errors - ours[known]),
        "degree": number(degree),
        "surfaces": number(len(points)),
    }


def best_polynomial(points, targets, seed):
    """The polynomial with the least cross-validated error: a function of (n, ratings) -> (n, targets), and its degree.

    `points` (surfaces, ratings) z-scores and `targets` (surfaces, targets) are means over segments.
    """
    folds = PredefinedSplit(np.random.default_rng(seed).permutation(len(points)) % FOLDS)
    models = {n: make_pipeline(PolynomialFeatures(n, include_bias=False), Ridge(PENALTY)) for n in DEGREES}
    errors = [np.abs(cross_val_predict(model, points, targets, cv=folds) - targets).mean() for model in models.values()]
    degree = DEGREES[int(np.argmin(errors))]
    return models[degree].fit(points, targets).predict, degree
