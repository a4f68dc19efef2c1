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


def scalar_shift(config, ratings):
    """The shift at ratings (batch, axes), z-scores, NaN = not specified: (batch, scalars) float32; `None` without one.

    Ratings beyond the training range are held at its ends. What is not specified counts as it is expected to be, given
    the others.
    """
    if config.calibration is None:
        return None
    values = (config.calibration[name] for name in ("offset", "slopes", "centre", "covariance"))
    offset, slopes, centre, covariance = (torch.tensor(v, dtype=torch.float32, device=ratings.device) for v in values)
    ratings = ratings.float()
    limits = (config.rating_statistics or {}).get("range")
    if limits is not None:
        ratings = ratings.clamp(*torch.tensor(limits, device=ratings.device).unbind(-1))
    return offset + expected_ratings(ratings, centre, covariance) @ slopes


def expected_ratings(ratings, centre, covariance):
    """Ratings (batch, axes) whose NaN are replaced by their mean given the others, of a Gaussian."""
    known = ~ratings.isnan()
    apart = torch.where(known, ratings - centre, 0.0)
    # among the known ones their covariance; beside them nothing that could mix
    among = covariance * (known[:, :, None] & known[:, None]) + torch.diag_embed((~known).float())
    return torch.where(known, ratings, centre + torch.linalg.solve(among, apart) @ covariance)
