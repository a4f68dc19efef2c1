"""The scales of ratings (z-scores, raw answers, percentiles), and how far ratings lie from those of surfaces."""

import numpy as np

#: The scale of the ratings in SENS3 (paper section 2.1).
RATING_SCALE = (0.0, 8.0)


def from_raw(answers, raw_mean, raw_scale):
    """From the typical rater's 0-8 scale to ratings in z-scores: (..., 3)."""
    return (np.asarray(answers) - raw_mean) / raw_scale


def from_percentile(percentiles, quantiles):
    """From percentiles to ratings in z-scores, along straight lines between the quantiles.

    Args:
        percentiles (`np.ndarray`): (..., axes) in [0, 100], NaN = not specified (and stays NaN).
        quantiles (`np.ndarray`): (axes, n) at equally spaced shares from 0 to 1, as `rating_quantiles` makes them.

    Returns:
        `np.ndarray`: (..., axes) float64.
    """
    percentiles, quantiles = np.asarray(percentiles, dtype=np.float64), np.asarray(quantiles)
    steps = np.linspace(0, 100, quantiles.shape[1])
    return np.stack([np.interp(percentiles[..., a], steps, row) for a, row in enumerate(quantiles)], axis=-1)


def coverage_distance(ratings, centre, covariance):
    """Mahalanobis distance of ratings (n, axes) from the centre over the axes that each specifies: (n,), NaN = none."""
    ratings, centre, covariance = (np.asarray(values, dtype=np.float64) for values in (ratings, centre, covariance))
    specified = np.isfinite(ratings)
    away = np.where(specified, ratings - centre, 0.0)[..., None]
    # among the specified axes their covariance; beside them nothing that could mix
    among = np.where(specified[:, :, None] & specified[:, None], covariance, np.eye(len(centre)))
    squares = (away.mT @ np.linalg.solve(among, away))[:, 0, 0]
    return np.where(specified.any(1), np.sqrt(squares), np.nan)
