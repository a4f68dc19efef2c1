"""Virtual raters: how percepts become answers on a 0-8 scale. Every standard deviation is an assumption."""

from functools import lru_cache

import numpy as np

from ..signal import RATING_AXES
from ..signal.rating_scales import RATING_SCALE
from .percepts import percept_correlation
from .streams import Stream, stream

RATERS = 12
#: Impression that all raters share and no percept explains (sd per axis, in units of the percept's own).
IDIOSYNCRASY = np.array([0.30, 0.40, 0.55])
#: Disagreement of one rater about one surface (sd per axis, same units) at agreement 1.
DISAGREEMENT = np.array([0.75, 0.95, 1.15])
OFFSET_SPREAD = 0.6
TYPICAL_GAIN = 1.75
GAIN_SPREAD = 0.25
#: Settings of ratings and their defaults (the recipe), as the attributes of a file name them.
RATER_SETTINGS = {"raters": RATERS, "agreement": 1.0, "axis_correlation": 0.0}


def rater_settings(attributes):
    """`RATER_SETTINGS` of a collection from the attributes of its file: keyword arguments of `fresh_ratings`."""
    return {name: attributes.get(name, default) for name, default in RATER_SETTINGS.items()}


def draw_raters(seed, count=RATERS):
    """Offset and gain of each rater and axis on the 0-8 scale: two arrays (count, 3); rater r is always the same."""
    streams = [stream(seed, Stream.RATER, rater) for rater in range(count)]
    draws = np.stack([rng.standard_normal((2, len(RATING_AXES))) for rng in streams], axis=1)
    return OFFSET_SPREAD * draws[0], TYPICAL_GAIN * np.exp(GAIN_SPREAD * draws[1])


def shared_impression(rng, percept):
    """(3,) impression of a surface that all raters share: its percepts plus a random part, of unit variance."""
    return (percept + IDIOSYNCRASY * rng.standard_normal(3)) / np.sqrt(1 + IDIOSYNCRASY**2)


@lru_cache(maxsize=16)
def halo(axis_correlation):
    """Matrix that pulls the correlation of every two axes of the shared impression up to a value (recipe).

    Of all linear maps between the two covariances it moves the impressions least:
    A = C^-1/2 (C^1/2 T C^1/2)^1/2 C^-1/2, with C the correlations as they are and T = max(C, axis_correlation).

    Returns:
        `np.ndarray`: (3, 3), symmetric; the identity if all correlations are above the value.
    """
    scale = 1 / np.sqrt(1 + IDIOSYNCRASY**2)
    correlation = percept_correlation() * np.outer(scale, scale)
    np.fill_diagonal(correlation, 1.0)
    target = np.maximum(correlation, axis_correlation)
    root = _power(correlation, 0.5)
    inverse = _power(correlation, -0.5)
    return inverse @ _power(root @ target @ root, 0.5) @ inverse


def _power(matrix, exponent):
    """Power of a symmetric positive definite matrix."""
    values, vectors = np.linalg.eigh(matrix)
    return (vectors * values**exponent) @ vectors.T


def rate_surface(rng, percept, raters, agreement=1.0, axis_correlation=0.0):
    """Answers of all raters about one surface.

    Args:
        rng (`np.random.Generator`): of the surface.
        percept (`np.ndarray`): (3,) from `percepts`.
        raters (`tuple[np.ndarray, np.ndarray]`): from `draw_raters`.
        agreement (`float`): divides the raters' disagreement; 1 is the recipe, larger = raters agree more.
        axis_correlation (`float`): axes of the shared impression correlate by at least this much (halo effect); 0 is
            the recipe.

    Returns:
        `np.ndarray`: (raters, 3) float32, whole numbers from 0 to 8.
    """
    offset, gain = raters
    shared = shared_impression(rng, percept)
    if axis_correlation > 0:
        shared = halo(axis_correlation) @ shared
    perceived = shared + DISAGREEMENT / agreement * rng.standard_normal(offset.shape)
    low, high = RATING_SCALE
    answers = np.round((low + high) / 2 + offset + gain * perceived)
    return np.clip(answers, low, high).astype(np.float32)
