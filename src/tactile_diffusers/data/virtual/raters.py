"""Virtual raters: how percepts become answers on a 0-8 scale. Every spread is an assumption."""

import numpy as np

from ...signal import RATING_AXES
from ..recordings import RATING_SCALE

RATERS = 12
#: What all raters feel of a surface beside friction (sd per axis, in units of the percept's own spread).
IDIOSYNCRASY = np.array([0.30, 0.40, 0.55])
#: Disagreement of one rater about one surface (sd per axis, same units) at agreement 1.
DISAGREEMENT = np.array([0.75, 0.95, 1.15])
OFFSET_SPREAD = 0.6
TYPICAL_GAIN = 1.75
GAIN_SPREAD = 0.25


def draw_raters(seed, count=RATERS):
    """Offset and gain of each rater and axis on the 0-8 scale: two arrays (count, 3); rater r is always the same."""
    streams = [np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(2, rater))) for rater in range(count)]
    draws = np.stack([stream.standard_normal((2, len(RATING_AXES))) for stream in streams], axis=1)
    return OFFSET_SPREAD * draws[0], TYPICAL_GAIN * np.exp(GAIN_SPREAD * draws[1])


def rate_surface(rng, percept, raters, agreement=1.0):
    """Answers of all raters about one surface.

    Args:
        rng (`np.random.Generator`): of the surface.
        percept (`np.ndarray`): (3,) from `percepts`.
        raters (`tuple[np.ndarray, np.ndarray]`): from `draw_raters`.
        agreement (`float`): divides the raters' disagreement; 1 is the recipe, larger = raters agree more.

    Returns:
        `np.ndarray`: (raters, 3) float32, whole numbers from 0 to 8.
    """
    offset, gain = raters
    shared = (percept + IDIOSYNCRASY * rng.standard_normal(3)) / np.sqrt(1 + IDIOSYNCRASY**2)
    noise = DISAGREEMENT / agreement * rng.standard_normal(offset.shape)
    low, high = RATING_SCALE
    answers = np.round((low + high) / 2 + offset + gain * (shared + noise))
    return np.clip(answers, low, high).astype(np.float32)
