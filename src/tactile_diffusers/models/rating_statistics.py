"""Statistics of the training surfaces' ratings: what the scales of ratings and warnings of extrapolation need."""

from dataclasses import asdict, dataclass, fields
from itertools import pairwise

import numpy as np


@dataclass(frozen=True)
class RatingStatistics:
    """The entry `rating_statistics` of DALE's config; `None` = unknown.

    Args:
        mean, std (`list[float]`): mean and standard deviation of a typical rater's raw scores (0-8), for each axis:
            raw = mean + std * z.
        range (`list[list[float]]`): smallest and largest rating of the training surfaces in z-scores, for each axis.
        quantiles (`list[list[float]]`): for each axis, quantiles of these ratings at equally spaced shares from 0 to 1,
            ascending (`tactile_diffusers.data.ratings.rating_quantiles`).
        centre, covariance (`list`): their mean (axes,) and covariance (axes, axes).
        reach (`float`): their largest Mahalanobis distance from the centre.
    """

    mean: list[float] | None = None
    std: list[float] | None = None
    range: list[list[float]] | None = None
    quantiles: list[list[float]] | None = None
    centre: list[float] | None = None
    covariance: list[list[float]] | None = None
    reach: float | None = None

    @classmethod
    def from_config(cls, config):
        """Of DALE's config; all unknown if it has none. Errors as of `from_dict`."""
        return cls.from_dict(getattr(config, "rating_statistics", None), len(config.rating_axes))

    @classmethod
    def from_dict(cls, entries, axes):
        """Of a dict, or `None`.

        Raises:
            ValueError: for an unknown entry, or a value that does not have one number or row for each of the axes.
        """
        names = [field.name for field in fields(cls)]
        unknown = sorted(set(entries or ()) - set(names))
        if unknown:
            raise ValueError(f"`rating_statistics` has unknown entries {unknown}; it may hold {names}.")
        statistics = cls(**(entries or {}))
        for name, value in asdict(statistics).items():
            if name != "reach" and value is not None and len(value) != axes:
                raise ValueError(f"`rating_statistics`: `{name}` must hold one entry for each of {axes} axes: {value}.")
        if statistics.quantiles is not None:
            lengths = {len(row) for row in statistics.quantiles}
            ascending = all(low <= high for row in statistics.quantiles for low, high in pairwise(row))
            if len(lengths) != 1 or min(lengths) < 2 or not ascending:
                raise ValueError(
                    "`rating_statistics`: `quantiles` must hold rows of ascending numbers, at least two and equally "
                    f"many, got {statistics.quantiles}. `tactile_diffusers.data.ratings.rating_quantiles` makes them."
                )
        return statistics

    def distribution(self, axes):
        """Centre (axes,) and covariance (axes, axes), float64: 0 and 1 where they are unknown."""
        centre = np.zeros(axes) if self.centre is None else np.array(self.centre)
        return centre, np.eye(axes) if self.covariance is None else np.array(self.covariance)
