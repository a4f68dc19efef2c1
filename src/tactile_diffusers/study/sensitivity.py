"""ABX: from sensitivity to proportion correct and back, by the differencing model.

Two textures are felt as Gaussian values of unit variance, d' apart. The observer compares X with the middle between A
and B, and so is right if A and B were felt in their true order and X on its true side, or if both were felt wrongly:

    p(correct) = Phi(d'/sqrt 2) Phi(d'/sqrt 6) + Phi(-d'/sqrt 2) Phi(-d'/sqrt 6)

Macmillan and Creelman, "Detection Theory: A User's Guide", chapter on classification designs; the same model as
`dprime.ABX(method = "diff")` of the R package psyphy.
"""

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

#: No larger sensitivity is looked for: there the observer is wrong once in 50 000 trials.
LARGEST_DPRIME = 10.0


def abx_proportion_correct(dprime):
    """Proportion correct of an unbiased observer: float or array in [0.5, 1), of `dprime` >= 0 (likewise for < 0)."""
    first, second = np.asarray(dprime) / np.sqrt(2), np.asarray(dprime) / np.sqrt(6)
    return ndtr(first) * ndtr(second) + ndtr(-first) * ndtr(-second)


def abx_dprime(proportion_correct, trials=None):
    """Sensitivity from a proportion correct.

    A proportion below one half is a chance result below chance: it gives the negative of what its mirror image gives,
    so that observers who feel nothing are zero on average. Near one half d' grows as the root of the excess, so a small
    d' is known badly.

    Args:
        proportion_correct (`float` or `np.ndarray`): in [0, 1]; NaN stays NaN.
        trials (`int` or `np.ndarray`, *optional*): that the proportion is of; proportions are then limited to
            1 / (2 trials) from 0 and 1 (Macmillan and Kaplan 1985), so that d' is finite.

    Returns:
        `float` or `np.ndarray`: at most `LARGEST_DPRIME`.

    Raises:
        ValueError: if a proportion is outside [0, 1].
    """
    proportion = np.asarray(proportion_correct, dtype=np.float64)
    outside = (proportion < 0) | (proportion > 1)
    if outside.any():
        raise ValueError(f"`proportion_correct` must be in [0, 1], got {proportion[outside].flat[0]}.")
    if trials is not None:
        margin = 1 / (2 * np.asarray(trials))
        proportion = np.clip(proportion, margin, 1 - margin)
    found = _solve(np.abs(proportion - 0.5) + 0.5) * np.sign(proportion - 0.5)
    return float(found) if found.ndim == 0 else found


@np.vectorize
def _solve(proportion):
    """The d' of one proportion correct of at least one half."""
    if np.isnan(proportion):
        return np.nan
    if proportion >= abx_proportion_correct(LARGEST_DPRIME):
        return LARGEST_DPRIME
    return brentq(lambda dprime: abx_proportion_correct(dprime) - proportion, 0.0, LARGEST_DPRIME)
