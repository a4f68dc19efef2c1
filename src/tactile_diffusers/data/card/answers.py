"""What raters answered, how far they agree, and whether their answers belong to the recordings."""

import warnings

import numpy as np
from scipy.stats import rankdata

from ...signal import RATING_AXES
from ...signal.rating_scales import RATING_SCALE
from ..ratings import axis_correlation, rating_reliability

#: Bins of pooled ratings, in z-scores.
Z_EDGES = np.linspace(-3, 3, 25)
#: Shuffles of surfaces behind the probability that ratings and recordings are unrelated (recipe).
SHUFFLES = 999
#: Fewer surfaces than this say nothing about a relation.
LEAST_SURFACES = 8


def describe_answers(scores, surfaces):
    """Raw answers, axis by axis, and the agreement of the raters.

    Args:
        scores (`RaterScores`): every axis of it is described, not only those that models use.
        surfaces (`tuple[str, ...]`): of the recordings.

    Returns:
        `dict`: counts of raters and surfaces, and per axis the counts of answers 0 to 8, their mean and standard
        deviation, the shares that are missing and that lie at either end, reliability, and each rater's correlation
        with the mean of the others.
    """
    reliability = rating_reliability(scores, scores.axes)
    rated = ~np.isnan(scores.values).all(axis=(0, 2))
    low, high = RATING_SCALE
    edges = np.arange(low, high + 2) - 0.5
    axes = {}
    for number, axis in enumerate(scores.axes):
        answers = scores.values[:, :, number]
        known = answers[~np.isnan(answers)]
        per_surface = (~np.isnan(answers[:, rated])).sum(axis=0)
        axes[axis] = {
            "counts": np.histogram(known, edges)[0],
            "mean": known.mean() if len(known) else np.nan,
            "std": known.std() if len(known) else np.nan,
            "missing_share": 1 - per_surface.sum() / max(1, per_surface.size * len(scores.raters)),
            "low_end_share": float(np.mean(known == low)) if len(known) else np.nan,
            "high_end_share": float(np.mean(known == high)) if len(known) else np.nan,
            "fewest_raters": int(per_surface.min()) if len(per_surface) else 0,
            "most_raters": int(per_surface.max()) if len(per_surface) else 0,
            "mean_correlation": reliability.mean_correlation[number],
            "alpha": reliability.alpha[number],
            "raters": reliability.raters[number],
            "with_others": dict(zip(scores.raters, _with_others(answers), strict=True)),
        }
    named = {surface for surface, known in zip(scores.surfaces, rated, strict=True) if known}
    return {
        "raters": len(scores.raters),
        "surfaces_rated": len(named),
        "surfaces_unrated": [surface for surface in surfaces if surface not in named],
        "axes": axes,
    }


def _with_others(answers):
    """Each rater's correlation with the mean of the others, (raters,), over the surfaces that both know."""
    deviations = _standardised(answers)
    result = []
    for rater in range(len(deviations)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # a surface that only this rater knows
            others = np.nanmean(np.delete(deviations, rater, axis=0), axis=0) if len(deviations) > 1 else np.nan
        result.append(axis_correlation(np.stack([deviations[rater], others + 0 * deviations[rater]], axis=-1))[0, 1])
    return np.array(result)


def _standardised(answers):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a rater without answers
        centred = answers - np.nanmean(answers, axis=1, keepdims=True)
        scale = np.nanstd(centred, axis=1, keepdims=True)
    return centred / np.where(scale > 0, scale, np.nan)


def describe_pooled(mean):
    """Distribution of the pooled ratings of surfaces (surfaces, 3) in z-scores, and correlations between axes."""
    columns = {axis: column[~np.isnan(column)] for axis, column in zip(RATING_AXES, mean.T, strict=True)}
    inside = {axis: np.clip(column, Z_EDGES[0], Z_EDGES[-1]) for axis, column in columns.items()}
    return {
        "edges": Z_EDGES,
        "counts": {axis: np.histogram(column, Z_EDGES)[0] for axis, column in inside.items()},
        "mean": {axis: column.mean() if len(column) else np.nan for axis, column in columns.items()},
        "std": {axis: column.std() if len(column) else np.nan for axis, column in columns.items()},
        "correlation": axis_correlation(mean),
    }


def relate(mean, quantities, seed=0):
    """Spearman correlations over surfaces between ratings and what was measured.

    The probability that ratings and recordings do not belong together comes from shuffling surfaces: it is the share
    of shuffles whose largest correlation, in size, reaches the one found.

    Args:
        mean (`np.ndarray`): (surfaces, 3) pooled ratings; NaN = not rated.
        quantities (`dict[str, np.ndarray]`): name -> (surfaces,); NaN = unknown. Those that are nowhere known are left
            out.
        seed (`int`): of the shuffles.

    Returns:
        `dict` or `None`: "surfaces" compared, "spearman" (quantity -> axis -> rho), "largest", "unrelated" (the
        probability); None with fewer than 8 surfaces.
    """
    quantities = {name: values for name, values in quantities.items() if not np.isnan(values).all()}
    measured = np.stack(list(quantities.values()), axis=-1) if quantities else np.empty((len(mean), 0))
    known = ~np.isnan(np.concatenate([mean, measured], axis=1)).any(axis=1)
    if known.sum() < LEAST_SURFACES or not quantities:
        return None
    ratings, measured = _ranks(mean[known]), _ranks(measured[known])
    rho = measured.T @ ratings
    rng = np.random.default_rng(seed)
    chance = [np.abs(measured.T @ ratings[rng.permutation(len(ratings))]).max() for _ in range(SHUFFLES)]
    largest = np.abs(rho).max()
    return {
        "surfaces": int(known.sum()),
        "spearman": {name: dict(zip(RATING_AXES, row, strict=True)) for name, row in zip(quantities, rho, strict=True)},
        "largest": largest,
        "unrelated": (1 + np.sum(np.array(chance) >= largest)) / (1 + SHUFFLES),
    }


def _ranks(columns):
    """Ranks of columns with zero mean and unit norm, so that products are Spearman's correlations; 0 if all alike."""
    ranks = rankdata(columns, axis=0)
    ranks -= ranks.mean(axis=0)
    norm = np.linalg.norm(ranks, axis=0)
    return ranks / np.where(norm > 0, norm, np.inf)
