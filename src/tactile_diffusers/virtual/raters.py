"""Virtual raters: how percepts become answers on a 0-8 scale."""

from functools import lru_cache

import numpy as np

from ..signal import RATING_AXES
from ..signal.rating_scales import RATING_SCALE
from .percepts import further_percept, percept_correlation
from .streams import Stream, stream

RATERS = 12
#: Impression that all raters share and no percept explains (sd per axis, in units of the percept's own): roughness
#: keeps R^2 of about 0.7 with vibration power, slipperiness 0.5 with log friction (Culbertson & Kuchenbecker 2017).
IDIOSYNCRASY = np.array([0.55, 0.40, 0.80])
#: Disagreement at agreement 1 (sd per axis, in units of the shared impression): what a rater keeps from trial to trial,
#: and what is new in every trial. Bare hands (Cleland et al. 2024) correlate by 0.62 and 0.60 between raters in
#: roughness and stickiness, and by 0.74 and 0.83 between trials of one rater; bumpiness, which nobody measured, lies
#: at 0.5 and 0.75 (recipe).
TASTE = np.array([0.42, 0.65, 0.58])
TRIAL_NOISE = np.array([0.63, 0.65, 0.48])
DISAGREEMENT = np.hypot(TASTE, TRIAL_NOISE)
OFFSET_SPREAD = 0.6
TYPICAL_GAIN = 1.75
GAIN_SPREAD = 0.25
#: Correlations of the impressions: (rough, bumpy), (rough, slippery), (bumpy, slippery). Bare hands and styli say -0.6
#: to -0.9 for the second over sets without smooth, sticky surfaces; with glass and rubber it should be weaker. The
#: third is the product of the other two: bumpiness and slipperiness go together through roughness alone (recipe).
RATING_CORRELATION = (0.40, -0.50, -0.20)
#: Smallest eigenvalue of a matrix of correlations that raters can have: below, an axis repeats the two others.
LEAST_EIGENVALUE = 0.02
#: Axes that can be asked for. Nothing of a friction force tells how warm a surface is.
FURTHER_AXES = ("regularity", "fineness", "warmth")
#: Their idiosyncrasy, taste and noise of a trial: of visual and tactile fineness raters agree as on bumpiness
#: (recipe).
FURTHER_IDIOSYNCRASY, FURTHER_TASTE, FURTHER_TRIAL_NOISE = 0.40, 0.65, 0.65


def check_rating_correlation(value):
    """Three correlations, (rough, bumpy), (rough, slippery), (bumpy, slippery): a tuple of floats.

    Raises:
        ValueError: if they are not three numbers in [-0.95, 0.95], or no three ratings can correlate so.
    """
    try:
        pairs = tuple(float(number) for number in value)
    except (TypeError, ValueError):
        pairs = ()
    if len(pairs) != 3 or not all(abs(number) <= 0.95 for number in pairs):
        raise ValueError(
            "`rating_correlation` must be three numbers from -0.95 to 0.95: (rough, bumpy), (rough, slippery), "
            f"(bumpy, slippery), got {value!r}."
        )
    if np.linalg.eigvalsh(correlation_matrix(pairs))[0] < LEAST_EIGENVALUE * (1 - 1e-6):
        raise ValueError(
            f"`rating_correlation` {pairs} is impossible: no three ratings correlate so. Nearer to 0 they do."
        )
    return pairs


def correlation_matrix(pairs):
    """(3, 3) from (rough, bumpy), (rough, slippery), (bumpy, slippery)."""
    matrix = np.eye(3)
    matrix[np.triu_indices(3, 1)] = pairs
    return matrix + np.triu(matrix, 1).T


@lru_cache(maxsize=16)
def judgement(rating_correlation):
    """Matrix that gives the shared impressions their correlations (a halo, in the field's word).

    Of all linear maps between the two covariances it moves the impressions least:
    A = C^-1/2 (C^1/2 T C^1/2)^1/2 C^-1/2, with C the correlations that physics alone gives and T the target.

    Args:
        rating_correlation (`tuple[float, float, float]`): checked.

    Returns:
        `np.ndarray`: (3, 3), symmetric.
    """
    scale = 1 / np.sqrt(1 + IDIOSYNCRASY**2)
    physics = percept_correlation() * np.outer(scale, scale)
    np.fill_diagonal(physics, 1.0)
    root, inverse = _power(physics, 0.5), _power(physics, -0.5)
    return inverse @ _power(root @ correlation_matrix(rating_correlation) @ root, 0.5) @ inverse


def _power(matrix, exponent):
    """Power of a symmetric positive definite matrix."""
    values, vectors = np.linalg.eigh(matrix)
    return (vectors * values**exponent) @ vectors.T


def draw_raters(seed, count=RATERS):
    """Offset and gain of each rater and axis on the 0-8 scale: two arrays (count, 3); rater r is always the same."""
    streams = [stream(seed, Stream.RATER, rater) for rater in range(count)]
    draws = np.stack([rng.standard_normal((2, len(RATING_AXES))) for rng in streams], axis=1)
    return OFFSET_SPREAD * draws[0], TYPICAL_GAIN * np.exp(GAIN_SPREAD * draws[1])


def rate_surface(rng, trial_rng, percept, raters, agreement=1.0, rating_correlation=RATING_CORRELATION):
    """Answers of all raters about one surface.

    Args:
        rng, trial_rng (`np.random.Generator`): of the surface, and of the surface and the trial.
        percept (`np.ndarray`): (3,) from `percepts`.
        raters (`tuple[np.ndarray, np.ndarray]`): from `draw_raters`.
        agreement (`float`): divides the raters' disagreement; 1 is the recipe, larger = raters agree more.
        rating_correlation (`tuple[float, float, float]`): of the shared impressions, see `RATING_CORRELATION`.

    Returns:
        `np.ndarray`: (raters, 3) float32, whole numbers from 0 to 8.
    """
    offset, gain = raters
    shared = (percept + IDIOSYNCRASY * rng.standard_normal(3)) / np.sqrt(1 + IDIOSYNCRASY**2)
    disagreement = TASTE * rng.standard_normal(offset.shape) + TRIAL_NOISE * trial_rng.standard_normal(offset.shape)
    perceived = (shared + disagreement / agreement) @ judgement(rating_correlation)
    low, high = RATING_SCALE
    answers = np.round((low + high) / 2 + offset + gain * perceived)
    return np.clip(answers, low, high).astype(np.float32)


def check_further_axes(value):
    """Names of `FURTHER_AXES`, also as one string with commas, as a tuple.

    Raises:
        ValueError: for another name, or one that comes twice.
    """
    names = tuple(name.strip() for name in value.split(",") if name.strip()) if isinstance(value, str) else tuple(value)
    if len(set(names)) < len(names) or not set(names) <= set(FURTHER_AXES):
        raise ValueError(f"`further_axes` must be different names of {list(FURTHER_AXES)}, got {value!r}.")
    return names


def further_answers(seed, surface, axes, raters, agreement=1.0, trial=0):
    """Answers of so many raters about one `VirtualSurface` on further axes: (raters, axes) float32, 0 to 8."""
    columns = []
    for axis in axes:
        number = FURTHER_AXES.index(axis)
        own, again = (
            stream(seed, Stream.FURTHER_ANSWERS, surface.index, number),
            stream(seed, Stream.FURTHER_TRIAL, surface.index, number, trial),
        )
        percept = own.standard_normal() if axis == "warmth" else further_percept(surface.parameters, axis)
        shared = (percept + FURTHER_IDIOSYNCRASY * own.standard_normal()) / np.sqrt(1 + FURTHER_IDIOSYNCRASY**2)
        disagreement = FURTHER_TASTE * own.standard_normal(raters) + FURTHER_TRIAL_NOISE * again.standard_normal(raters)
        draws = np.stack([stream(seed, Stream.FURTHER_RATER, r, number).standard_normal(2) for r in range(raters)], 1)
        gain = TYPICAL_GAIN * np.exp(GAIN_SPREAD * draws[1])
        low, high = RATING_SCALE
        answers = (low + high) / 2 + OFFSET_SPREAD * draws[0] + gain * (shared + disagreement / agreement)
        columns.append(np.clip(np.round(answers), low, high))
    return np.stack(columns, axis=-1).astype(np.float32)
