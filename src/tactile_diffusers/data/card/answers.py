"""The raters' answers, how far they agree, and whether they belong to the recordings."""

import numpy as np
import pandas
from scipy.stats import rankdata

from ...signal import RATING_AXES
from ...signal.rating_scales import RATING_SCALE
from ..ratings import LEAST_COMMON, axis_correlation, rating_reliability

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
    axes = {}
    for number, axis in enumerate(scores.axes):
        answers = pandas.DataFrame(scores.values[:, rated, number].T, columns=list(scores.raters))
        known, per_surface = answers.stack().dropna(), answers.count(axis=1)
        axes[axis] = {
            "counts": np.histogram(known, np.arange(low, high + 2) - 0.5)[0],
            "mean": known.mean(),
            "std": known.std(ddof=0),
            "missing_share": 1 - per_surface.sum() / max(1, answers.size),
            "low_end_share": (known == low).mean(),
            "high_end_share": (known == high).mean(),
            "fewest_raters": per_surface.min() if len(per_surface) else 0,
            "most_raters": per_surface.max() if len(per_surface) else 0,
            "mean_correlation": reliability.mean_correlation[number],
            "alpha": reliability.alpha[number],
            "raters": reliability.raters[number],
            "with_others": _with_others(answers),
        }
    named = {surface for surface, known in zip(scores.surfaces, rated, strict=True) if known}
    return {
        "raters": len(scores.raters),
        "surfaces_rated": len(named),
        "surfaces_unrated": [surface for surface in surfaces if surface not in named],
        "axes": axes,
    }


def _with_others(answers):
    """Each rater's correlation with the mean z-score of the others, over the surfaces that both know."""
    z = (answers - answers.mean()) / answers.std(ddof=0).replace(0, np.nan)
    return {
        rater: z[rater].corr(z.drop(columns=rater).mean(axis=1), min_periods=LEAST_COMMON) if len(z) else np.nan
        for rater in z
    }


def describe_pooled(mean):
    """Distribution of the pooled ratings of surfaces (surfaces, 3) in z-scores, and correlations between axes."""
    columns = {axis: column[~np.isnan(column)] for axis, column in zip(RATING_AXES, mean.T, strict=True)}
    return {
        "edges": Z_EDGES,
        "counts": {axis: np.histogram(np.clip(c, Z_EDGES[0], Z_EDGES[-1]), Z_EDGES)[0] for axis, c in columns.items()},
        "std": {axis: column.std() if len(column) else np.nan for axis, column in columns.items()},
        "correlation": axis_correlation(mean),
    }


def relate(mean, quantities, seed=0):
    """Spearman correlations over surfaces between ratings and measured quantities, and a shuffling test.

    The probability that ratings and recordings do not belong together is the share of shuffles of surfaces whose
    largest correlation, in size, reaches the one found.

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
