"""Section "regression": how well any function of the ratings foretells the mean spectrum of an unseen surface.

Ratings do not settle a surface: what regression leaves is what no generator can be asked to know. Polynomials of the
ratings are fitted to the surfaces' mean band levels; a generator is compared with the best of them.
"""

import itertools

import numpy as np

from ...signal import RATING_AXES, band_levels_db
from ..metrics.statistics import leaf, number
from ..truth import VIRTUAL_SOURCE, virtual_truth

DEGREES = (1, 2, 3)
#: Added to the diagonal of the normal equations, in surfaces: holds a cubic of 50 surfaces in check, else nothing.
PENALTY = 1.0
FOLDS = 5


def run(context):
    """The section: `{"regression": {"same_data": ..., "many_surfaces": ...}}`; the latter for virtual surfaces only."""
    training = context.known_training
    bands = band_levels_db(training.textures, context.rate, context.edges)
    found = {"same_data": _fitted(context, bands, training.ratings, training.surface_ids)}
    count = context.settings.regression_surfaces
    if context.held_out.attributes["source"] == VIRTUAL_SOURCE:
        fresh = virtual_truth(
            context.held_out,
            [[np.nan] * len(RATING_AXES)],
            lambda textures, levels, frictions: {"bands": band_levels_db(textures, context.rate, context.edges)},
            surfaces=count,
            candidates=max(count, context.settings.truth_candidates),
            seconds=context.settings.truth_seconds,
            seed=context.seed + 1,
            workers=2,
            quiet=context.quiet,
        )
        ratings = fresh.ratings[fresh.surface_ids]
        found["many_surfaces"] = _fitted(context, fresh.measures["bands"], ratings, fresh.surface_ids)
    return {"regression": found}


def _fitted(context, bands, ratings, surface_ids):
    """Leaves of the degree with the least cross-validated error: its error on held-out surfaces, degree, surfaces."""
    rated = np.isfinite(ratings).all(1)
    _, first, surface = np.unique(surface_ids[rated], return_index=True, return_inverse=True)
    points, targets = ratings[rated][first], _means(bands[rated], surface)
    fold = np.random.default_rng(context.seed).permutation(len(points)) % FOLDS
    errors = [_cross_validated(points, targets, degree, fold) for degree in DEGREES]
    degree = DEGREES[int(np.argmin(errors))]
    _, first, surface = np.unique(context.surfaces, return_index=True, return_inverse=True)
    asked = context.held_out.surface_ratings[context.surfaces[first]]
    known = np.isfinite(asked).all(1)
    real = _means(context.real_bands, surface)[known]
    made = _predict(_fit(points, targets, degree), asked[known], degree)
    return {
        "nine_band_db": leaf(np.abs(made - real).mean(-1)),
        "degree": number(degree),
        "surfaces": number(len(points)),
    }


def _means(values, surface):
    sums = np.zeros((surface.max() + 1, values.shape[1]))
    np.add.at(sums, surface, values)
    return sums / np.bincount(surface)[:, None]


def _terms(ratings, degree):
    """All products of up to `degree` ratings: (n, terms)."""
    columns = [np.ones(len(ratings))]
    for order in range(1, degree + 1):
        for axes in itertools.combinations_with_replacement(range(ratings.shape[1]), order):
            columns.append(ratings[:, axes].prod(1))
    return np.stack(columns, 1)


def _fit(ratings, targets, degree):
    terms = _terms(ratings, degree)
    centre = targets.mean(0)
    gram = terms.T @ terms + PENALTY * np.eye(terms.shape[1])
    return np.linalg.solve(gram, terms.T @ (targets - centre)), centre


def _predict(fitted, ratings, degree):
    coefficients, centre = fitted
    return _terms(ratings, degree) @ coefficients + centre


def _cross_validated(ratings, targets, degree, fold):
    errors = []
    for number_ in range(FOLDS):
        inside, outside = fold != number_, fold == number_
        made = _predict(_fit(ratings[inside], targets[inside], degree), ratings[outside], degree)
        errors.append(np.abs(made - targets[outside]).mean())
    return float(np.mean(errors))
