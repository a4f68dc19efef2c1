"""Axes of ratings that a lab's data name and a pretrained DALE does not know."""

import numpy as np
from sklearn.linear_model import RidgeCV
from sklearn.model_selection import KFold, cross_val_predict
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from ..data.ratings import check_axes, rating_quantiles
from ..models.calibration import own_calibration
from ..models.rating_statistics import RatingStatistics
from ..signal import coverage_distance

#: As how many surfaces counts what is expected of a new axis given the others: nothing.
PRIOR_SURFACES = 4
#: Fewer surfaces cannot tell what friction carries; below this R² it carries too little for a slider.
TOO_FEW, LEAST_R2 = 12, 0.1


def add_axes(dale, ratings, surfaces):
    """Adds axes to DALE's config. Its networks do not see them: slopes over them are all 0, until it is recalibrated.

    Args:
        dale (`DALEModel`): pretrained.
        ratings (`SurfaceRatings`): on all axes of the data.
        surfaces (`np.ndarray`): indices of the lab's surfaces.

    Returns:
        `list[str]`: the names of the new axes.

    Raises:
        ValueError: if the names of the axes clash.
    """
    known = tuple(dale.config.rating_axes)
    new = [axis for axis in ratings.axes if axis not in known]
    new = [axis for axis in new if differ(ratings.take([axis]).mean[surfaces, 0])]
    if not new:
        return []
    check_axes((*known, *new))
    taken = ratings.take((*known, *new))
    values, count = taken.mean[surfaces].astype(np.float64), len(known)
    statistics = RatingStatistics.from_config(dale.config)
    centre, covariance = _grown(statistics, values, count)
    earlier = own_calibration(dale.config, dale.num_scalars)
    slopes = [*earlier["slopes"], *[[0.0] * dale.num_scalars] * len(new)]
    dale.register_to_config(
        rating_axes=(*known, *new),
        network_axes=dale.config.network_axes or count,
        calibration=earlier | {"slopes": slopes, "centre": centre.tolist(), "covariance": covariance.tolist()},
        rating_statistics=_statistics(statistics, taken, values, count, centre, covariance),
    )
    return new


def differ(values):
    """Whether values (n,), NaN where unknown, are not the same for all."""
    values = values[np.isfinite(values)]
    return len(values) > 1 and np.ptp(values) > 1e-6


def _grown(statistics, values, count):
    """Centre and covariance of all axes: of the first `count` as they were, of the others given those."""
    centre, covariance = statistics.distribution(count)
    apart = np.nan_to_num(values[:, :count] - centre)
    means = np.nanmean(values[:, count:], axis=0)
    further = np.nan_to_num(values[:, count:] - means)
    slopes = np.linalg.solve(apart.T @ apart + PRIOR_SURFACES * np.eye(count), apart.T @ further)
    left = further - apart @ slopes
    rest = np.diag(np.square(left).sum(0) / len(values) + 1e-3)
    across = covariance @ slopes
    return np.concatenate([centre, means]), np.block([[covariance, across], [across.T, slopes.T @ across + rest]])


def _statistics(statistics, ratings, values, count, centre, covariance):
    """The entry `rating_statistics` of the config with those of the new axes; what was unknown stays so."""
    new, found = values[:, count:], {name: value for name, value in vars(statistics).items() if value is not None}
    shares = np.linspace(0, 1, len(statistics.quantiles[0])) if statistics.quantiles else None
    added = {
        "mean": ratings.raw_mean[count:].astype(float),
        "std": ratings.raw_scale[count:].astype(float),
        "range": rating_quantiles(new)[:, [0, -1]],
        "quantiles": None if shares is None else np.nanquantile(new, shares, axis=0).T,
    }
    for name, rows in added.items():
        if name in found:
            found[name] = [*found[name], *rows.tolist()]
    if "centre" in found and "covariance" in found:
        found |= {"centre": centre.tolist(), "covariance": covariance.tolist()}
        own = values[np.isfinite(values).all(1)]
        if statistics.reach is not None and len(own):
            found["reach"] = max(statistics.reach, float(coverage_distance(own, centre, covariance).max()))
    return found


def carried_words(axis, ratings, scalars):
    """A sentence on whether the friction force carries an axis, by R² on surfaces that are left out in turn.

    Args:
        axis (`str`): its name.
        ratings (`np.ndarray`): (n,), NaN = not rated.
        scalars (`np.ndarray`): (n, k), numbers of the surfaces' textures; columns with NaN are left out.
    """
    rated = np.isfinite(ratings)
    if rated.sum() < TOO_FEW:
        return f"{axis} is new: {rated.sum()} rated surfaces are too few to say whether friction carries it."
    inputs, wanted = scalars[rated][:, np.isfinite(scalars[rated]).all(0)], ratings[rated]
    model = make_pipeline(StandardScaler(), RidgeCV(np.logspace(0, 5, 11)))
    predicted = cross_val_predict(model, inputs, wanted, cv=KFold(min(10, len(wanted)), shuffle=True, random_state=0))
    r2 = 1 - np.square(predicted - wanted).sum() / np.square(wanted - wanted.mean()).sum()
    verdict = (
        "friction carries it" if r2 >= LEAST_R2 else "friction hardly carries it: do not expect its slider to do much"
    )
    return f"{axis} is new: from textures, R² {r2:.2f} on surfaces left out, so {verdict}."
