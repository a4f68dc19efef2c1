"""What somebody likes, from comparisons: a Gaussian process of a utility, in Laplace's approximation.

Chu & Ghahramani, "Preference learning with Gaussian processes" (ICML 2005), with a third answer: a difference of
utilities below a threshold is not told (`"neither"`; Thurstone's model with ties). The libraries have no such model
that fits here: scikit-learn's Gaussian processes know no pairs, and BoTorch's `PairwiseGP` no ties; it brings gpytorch,
pyro and linear_operator for what is forty lines on matrices of at most a hundred rows.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import log_ndtr, ndtr

#: The answers: what differs in utility less than `TIE` (in standard deviations of an answer's noise) is "neither".
ANSWERS = ("first", "second", "neither")
TIE = 0.3
#: Curvature of the utility expected before any answer: a taste has its best point inside the range, not at its ends.
#: In units of the amplitude, for coordinates of unit standard deviation.
BOWL = 0.35
#: Standard deviation of the slope, and of the wiggles on top, in the same units; length of the wiggles.
SLOPE, WIGGLE, LENGTH = 1.0, 0.4, 1.5
#: What an amplitude, in standard deviations of an answer's noise, may be: chosen by the evidence of the answers.
#: Answers that contradict each other leave the lowest.
AMPLITUDES = (0.25, 0.5, 1.0, 2.0, 4.0)
_NEWTON_STEPS, _JITTER = 30, 1e-6


@dataclass(frozen=True)
class PreferenceModel:
    """The posterior of a utility after comparisons; `fit` makes one.

    Args:
        points (`np.ndarray`): (n, dimensions) that were compared.
        amplitude (`float`): of the utility, in standard deviations of an answer's noise.
        weights (`np.ndarray`): (n,) of the points in the mean.
        shrinkage (`np.ndarray`): (n, n) by which they reduce the variance.
        evidence (`float`): log probability of the answers.
    """

    points: np.ndarray
    amplitude: float
    weights: np.ndarray
    shrinkage: np.ndarray
    evidence: float

    @classmethod
    def fit(cls, first, second, answers):
        """The model of the amplitude that makes the answers most likely.

        Args:
            first, second (`np.ndarray`): (m, dimensions), what was compared; coordinates of unit standard deviation.
            answers (`Sequence[str]`): (m,) of `ANSWERS`; they may contradict each other.
        """
        points = np.concatenate([first, second])
        if not len(answers):
            return cls(points, 1.0, np.zeros(0), np.zeros((0, 0)), 0.0)
        codes = np.array([ANSWERS.index(answer) for answer in answers], dtype=int)
        return max((_laplace(cls, points, codes, amplitude) for amplitude in AMPLITUDES), key=lambda one: one.evidence)

    def mean(self, places):
        """Mean (n,) of the utility at places (n, dimensions)."""
        return _prior_mean(places, self.amplitude) + _covariance(places, self.points, self.amplitude) @ self.weights

    def posterior(self, places):
        """Mean (n,) and covariance (n, n) of the utility at places (n, dimensions)."""
        across = _covariance(places, self.points, self.amplitude)
        return self.mean(places), _covariance(places, places, self.amplitude) - across @ self.shrinkage @ across.T


def _prior_mean(places, amplitude):
    return -BOWL * amplitude * np.square(places).sum(-1)


def _covariance(left, right, amplitude):
    apart = np.square(left[:, None] - right[None]).sum(-1)
    return amplitude**2 * (SLOPE**2 * left @ right.T + WIGGLE**2 * np.exp(-0.5 * apart / LENGTH**2))


def _laplace(cls, points, codes, amplitude):
    """The mode of the utilities at the points by Newton's method, and the normal distribution about it."""
    count = len(codes)
    differences = np.hstack([np.eye(count), -np.eye(count)])
    prior, mean = _covariance(points, points, amplitude), differences @ _prior_mean(points, amplitude)
    # all in the differences of the pairs, (m,): nothing else is seen
    covariance = differences @ prior @ differences.T + _JITTER * np.eye(count)
    solved = cho_factor(covariance)
    place = mean.copy()
    for _ in range(_NEWTON_STEPS):
        _, slope, curvature = _likelihood(place, codes)
        root = np.sqrt(curvature)
        inner = cho_factor(np.eye(count) + root[:, None] * covariance * root)
        target = curvature * (place - mean) + slope
        new = mean + covariance @ (target - root * cho_solve(inner, root * (covariance @ target)))
        done, place = np.abs(new - place).max(initial=0) < 1e-6, new
        if done:
            break
    value, slope, curvature = _likelihood(place, codes)
    root = np.sqrt(curvature)
    inner = cho_factor(np.eye(count) + root[:, None] * covariance * root)
    shrinkage = root[:, None] * cho_solve(inner, np.diag(root))
    away = cho_solve(solved, place - mean)
    evidence = value.sum() - 0.5 * away @ (place - mean) - np.log(np.diag(inner[0])).sum()
    return cls(points, amplitude, differences.T @ away, differences.T @ shrinkage @ differences, float(evidence))


def _likelihood(difference, codes):
    """Log probability of each answer by the difference of utilities, its slope and minus its curvature: (m,) each."""
    sign = np.where(codes == 1, -1.0, 1.0)
    told = sign * difference - TIE
    log_told = log_ndtr(told)
    ratio = np.exp(-0.5 * told**2 - 0.5 * math.log(2 * math.pi) - log_told)
    low, high = -TIE - np.abs(difference), TIE - np.abs(difference)  # on the side where ndtr is exact
    mass = np.maximum(ndtr(high) - ndtr(low), 1e-300)
    density_low, density_high = (np.exp(-0.5 * edge**2) / math.sqrt(2 * math.pi) for edge in (low, high))
    tie_slope = np.sign(difference) * (density_low - density_high) / mass
    tie_curvature = tie_slope**2 + (high * density_high - low * density_low) / mass
    tie = codes == 2
    value = np.where(tie, np.log(mass), log_told)
    slope = np.where(tie, tie_slope, sign * ratio)
    return value, slope, np.maximum(np.where(tie, tie_curvature, ratio * (ratio + told)), 1e-9)
