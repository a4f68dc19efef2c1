"""By how much an adapted DALE shifts the numbers of a whole texture, given the ratings.

A network that was trained on x0 knows x0 + d, too: at the angle phi its sample holds cos(phi) d more, and its velocity
-sin(phi) d. So a shift costs no training, and holds for every sampler, number of steps, guidance and length.
"""

import numpy as np
import torch


def check_calibration(calibration, scalars, axes):
    """Raises a `ValueError` unless `calibration` is `None`, or a dict of numbers that fit scalars and axes.

    Its entries: "offset" (scalars,) and "slopes" (axes, scalars) of one z-score, in standard deviations of the scalars;
    "centre" (axes,) and "covariance" (axes, axes) of the ratings that it was found on.
    """
    if calibration is None:
        return
    shapes = {"offset": (scalars,), "slopes": (axes, scalars), "centre": (axes,), "covariance": (axes, axes)}
    if set(calibration) != set(shapes):
        raise ValueError(f"`calibration` must hold {sorted(shapes)}, got {sorted(calibration)}.")
    for name, shape in shapes.items():
        values = np.array(calibration[name], dtype=np.float64)  # models are built without memory, too
        if values.shape != shape or not np.isfinite(values).all():
            raise ValueError(f"`calibration`: `{name}` must be finite numbers of shape {shape}, got {values.shape}.")


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
    values = (config.calibration[name] for name in ("offset", "slopes", "centre", "covariance"))
    offset, slopes, centre, covariance = (torch.tensor(v, dtype=torch.float32, device=ratings.device) for v in values)
    ratings = ratings.float()
    limits = (config.rating_statistics or {}).get("range")
    if limits is not None:
        ratings = ratings.clamp(*torch.tensor(limits, device=ratings.device).unbind(-1))
    return offset + calibration_inputs(ratings, centre, covariance, count) @ slopes


def calibration_inputs(ratings, centre, covariance, count):
    """What slopes are multiplied by, (batch, axes): ratings of the first `count` axes, and of each further one how far
    it lies from what they let expect, 0 where it is open."""
    filled = expected_ratings(ratings, centre, covariance)
    known, further = filled[:, :count], filled[:, count:]
    expected = (known - centre[:count]) @ torch.linalg.solve(covariance[:count, :count], covariance[:count, count:])
    left = torch.where(ratings[:, count:].isnan(), 0.0, further - centre[count:] - expected)
    return torch.cat([known, left], dim=1)


def network_ratings(config, ratings):
    """Ratings (batch, axes) of the axes that DALE's networks know, (batch, network_axes).

    Where one is asked that they do not know, an open one counts as it is expected to be then.
    """
    count = config.network_axes
    if count is None or count == ratings.shape[1]:
        return ratings
    centre, covariance = (torch.tensor(config.calibration[n]).to(ratings) for n in ("centre", "covariance"))
    expected = expected_ratings(ratings, centre, covariance)[:, :count]
    known, asked = ratings[:, :count], ~ratings[:, count:].isnan().all(1, keepdim=True)
    return torch.where(known.isnan() & asked, expected, known)


def expected_ratings(ratings, centre, covariance):
    """Ratings (batch, axes) whose NaN are replaced by their mean given the others, of a Gaussian."""
    known = ~ratings.isnan()
    apart = torch.where(known, ratings - centre, 0.0)
    # among the known ones their covariance; beside them nothing that could mix
    among = covariance * (known[:, :, None] & known[:, None]) + torch.diag_embed((~known).float())
    return torch.where(known, ratings, centre + torch.linalg.solve(among, apart) @ covariance)
