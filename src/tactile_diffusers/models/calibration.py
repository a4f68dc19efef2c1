"""By how much an adapted DALE shifts the numbers of a whole texture, given the ratings.

A network that was trained on x0 knows x0 + d, too: at the angle phi its sample holds cos(phi) d more, and its velocity
-sin(phi) d. So a shift costs no training, and holds for every sampler, number of steps, guidance and length.
"""

import numpy as np
import torch

from .rating_statistics import RatingStatistics


def check_calibration(calibration, scalars, axes, seen):
    """Raises a `ValueError` unless `calibration` is `None`, or a dict of numbers that fit scalars and axes.

    Its entries: "offset" (scalars,) and "slopes" (axes, scalars) of one z-score, in standard deviations of the scalars;
    "centre" (axes,) and "covariance" (axes, axes) of the ratings that it was found on. Where the surfaces ask for it,
    "curves" (pairs, scalars), over the products of the `seen` axes that the networks know (`products`), and "trust",
    the share of each rating that the networks see.
    """
    if calibration is None:
        return
    pairs = seen * (seen + 1) // 2
    shapes = {"offset": (scalars,), "slopes": (axes, scalars), "centre": (axes,), "covariance": (axes, axes)}
    further = {"curves": (pairs, scalars), "trust": ()}
    if not set(shapes) <= set(calibration) <= set(shapes | further):
        raise ValueError(f"`calibration` must hold {sorted(shapes)}, got {sorted(calibration)}.")
    for name, values in calibration.items():
        shape, values = (shapes | further)[name], np.array(values, dtype=np.float64)  # models are built without memory
        if values.shape != shape or not np.isfinite(values).all():
            raise ValueError(f"`calibration`: `{name}` must be finite numbers of shape {shape}, got {values.shape}.")


def own_calibration(config, scalars):
    """The entries of DALE's config, all of them: a copy, or those that change nothing."""
    axes = len(config.rating_axes)
    centre, covariance = RatingStatistics.from_config(config).distribution(axes)
    count = config.network_axes or axes
    nothing = {
        "offset": [0.0] * scalars,
        "slopes": [[0.0] * scalars] * axes,
        "curves": [[0.0] * scalars] * (count * (count + 1) // 2),
        "trust": 1.0,
        "centre": centre.tolist(),
        "covariance": covariance.tolist(),
    }
    return nothing | (config.calibration or {})


def check_network_axes(count, axes, calibration):
    """How many of `axes` the networks see, `None` = all; a `ValueError` unless a `calibration` knows the others."""
    seen = len(axes) if count is None else count
    if not 0 < seen <= len(axes) or (seen < len(axes) and calibration is None):
        raise ValueError(
            f"`network_axes` must be from 1 to {len(axes)}, the number of `rating_axes`, and needs a `calibration` "
            f"where it is less, got {count}."
        )
    return seen


def scalar_shift(config, ratings):
    """The shift at ratings (batch, axes), z-scores, NaN = not specified: (batch, scalars) float32; `None` without one.

    Ratings beyond the training range are held at its ends. What is not specified counts as it is expected to be, given
    the others.
    """
    if config.calibration is None:
        return None
    count = config.network_axes or len(config.rating_axes)
    found = {name: torch.tensor(v, device=ratings.device).float() for name, v in config.calibration.items()}
    ratings = held_ratings(config, ratings.float())
    inputs = calibration_inputs(ratings, found["centre"], found["covariance"], count)
    shift = found["offset"] + inputs @ found["slopes"]
    return shift + products(inputs[:, :count]) @ found["curves"] if "curves" in found else shift


def held_ratings(config, ratings):
    """Ratings (batch, axes) within the training surfaces' range: beyond it nothing is known, and nothing turns back."""
    limits = (config.rating_statistics or {}).get("range")
    if limits is None:
        return ratings
    return ratings.clamp(*torch.tensor(limits, dtype=ratings.dtype, device=ratings.device).unbind(-1))


def products(inputs):
    """Of each axis with itself, less 1, and with each later one: (batch, axes) -> (batch, axes (axes + 1) / 2)."""
    rows, columns = torch.triu_indices(inputs.shape[1], inputs.shape[1], device=inputs.device)
    return inputs[:, rows] * inputs[:, columns] - (rows == columns).to(inputs)


def calibration_inputs(ratings, centre, covariance, count):
    """What slopes are multiplied by, (batch, axes): ratings of the first `count` axes, and of each further one how far
    it lies from what they let expect, 0 where it is open."""
    filled = expected_ratings(ratings, centre, covariance)
    known, further = filled[:, :count], filled[:, count:]
    expected = (known - centre[:count]) @ torch.linalg.solve(covariance[:count, :count], covariance[:count, count:])
    left = torch.where(ratings[:, count:].isnan(), 0.0, further - centre[count:] - expected)
    return torch.cat([known, left], dim=1)


def network_ratings(config, ratings):
    """What DALE's networks see of ratings (batch, axes): a share of those of the axes that they know.

    (batch, network_axes). Where one is asked that they do not know, an open one counts as it is expected to be then.
    """
    count, trust = config.network_axes, (config.calibration or {}).get("trust", 1.0)
    if count is None or count == ratings.shape[1]:
        return ratings * trust
    centre, covariance = (torch.tensor(config.calibration[n]).to(ratings) for n in ("centre", "covariance"))
    expected = expected_ratings(ratings, centre, covariance)[:, :count]
    known, asked = ratings[:, :count], ~ratings[:, count:].isnan().all(1, keepdim=True)
    return trust * torch.where(known.isnan() & asked, expected, known)


def expected_ratings(ratings, centre, covariance):
    """Ratings (batch, axes) whose NaN are replaced by their mean given the others, of a Gaussian."""
    known = ~ratings.isnan()
    apart = torch.where(known, ratings - centre, 0.0)
    # among the known ones their covariance; beside them nothing that could mix
    among = covariance * (known[:, :, None] & known[:, None]) + torch.diag_embed((~known).float())
    return torch.where(known, ratings, centre + torch.linalg.solve(among, apart) @ covariance)
