"""The response to one rating over the whole range that the pipeline accepts, a part of the section "control"."""

import numpy as np

from tactile_diffusers.evaluation.metrics.errors import DB_PER_NEPER
from tactile_diffusers.evaluation.metrics.rating_effects import reversal
from tactile_diffusers.evaluation.metrics.statistics import estimate, leaf, number
from tactile_diffusers.pipelines.inputs import LARGEST_RATING
from tactile_diffusers.signal import level, power_spectral_density

from ..baselines import BaselineRequest

#: Ratings of the curves: nearly all surfaces of training lie within ±2.
RATINGS = (-LARGEST_RATING, -4.0, -3.0, -2.5, -2.0, -1.0, 0.0, 1.0, 2.0, 2.5, 3.0, 4.0, LARGEST_RATING)


def rating_requests(axis, takes, axes=3):
    """Requests for one axis (`int`) at all of `RATINGS`, the others not specified: (13 * takes, axes) z-scores."""
    requests = np.full((len(RATINGS) * takes, axes), np.nan)
    requests[:, axis] = np.repeat(RATINGS, takes)
    return requests


def response_curves(context, estimate):
    """`{"model": curves, "knn_blend": curves}`; the same noise at every rating of the model.

    Curves are `{axis: {"values": {rating: leaves}, "reversal": leaves}}`, of the measures "level_db", "centroid_hz",
    "log_friction" and "estimate", the judge's of the axis itself; "reversal" is `reversal` of each. `estimate` makes
    ratings (n, 3), or None, of embeddings (n, features) and friction coefficients (n,).
    """
    takes, sources = context.settings.response_takes, {"model": _generated, "knn_blend": _blended}
    return {
        name: {
            axis: _curve(context, index, source(context, rating_requests(index, takes, len(context.axes))), estimate)
            for index, axis in enumerate(context.axes)
        }
        for name, source in sources.items()
        if name == "model" or name in context.baselines
    }


def _generated(context, requests):
    seeds = np.tile(context.seeds(7, context.settings.response_takes), len(RATINGS))
    out = context.generate(requests, seeds, context.default_guidance)
    return out.textures, out.levels, out.friction_coefficients


def _blended(context, requests):
    baseline, request = context.baselines["knn_blend"], BaselineRequest(requests)
    textures = baseline.sample(request, context.rng("response"))
    # a generator in the same state: the friction that belongs to these textures
    return textures, level(textures), baseline.friction_coefficients(request, context.rng("response"))


def _curve(context, axis, made, estimate):
    textures, levels, frictions = made
    estimated = estimate(context.data.reference.embed(textures), frictions)
    measures = {
        "level_db": DB_PER_NEPER * levels,
        "centroid_hz": centroid_hz(textures, context.data.rate),
        "log_friction": np.log(frictions),
        "estimate": np.full(len(levels), np.nan) if estimated is None else estimated[:, axis],
    }
    columns = {name: values.reshape(len(RATINGS), -1) for name, values in measures.items()}
    rows = {str(value): {name: leaf(by[i]) for name, by in columns.items()} for i, value in enumerate(RATINGS)}
    return {"values": rows, "reversal": {name: reversal_leaf(by) for name, by in columns.items()}}


def reversal_leaf(measured):
    """Leaf of the `reversal` of the mean of (13, takes) measures at `RATINGS`; empty where they are unknown."""
    if not np.isfinite(measured).all():
        return number()
    takes = np.arange(measured.shape[1])
    return estimate(lambda mask: reversal(RATINGS, measured[:, mask].mean(1)), takes)


def centroid_hz(textures, sampling_rate):
    """Mean frequency of textures (n, samples), weighted by power: (n,) Hz."""
    frequencies, density = power_spectral_density(textures, sampling_rate)
    return density @ frequencies / np.maximum(density.sum(-1), np.finfo(np.float64).tiny)
