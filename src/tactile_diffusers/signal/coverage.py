"""How far ratings lie from those of a set of surfaces: on the ground floor, so that a pipeline need not read data."""

import numpy as np


def coverage_distance(ratings, centre, covariance):
    """Mahalanobis distance of ratings (n, axes) from the centre over the axes that each specifies: (n,), NaN = none."""
    ratings, centre, covariance = (np.asarray(values, dtype=np.float64) for values in (ratings, centre, covariance))
    distances = np.full(len(ratings), np.nan)
    for row, rating in enumerate(ratings):
        specified = np.flatnonzero(np.isfinite(rating))
        if len(specified):
            away = rating[specified] - centre[specified]
            distances[row] = np.sqrt(away @ np.linalg.solve(covariance[np.ix_(specified, specified)], away))
    return distances
