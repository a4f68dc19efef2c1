"""What a visitor may ask for: how textures are made, within limits, and the scales that ratings are shown in."""

import math
from dataclasses import dataclass, fields

import numpy as np

from tactile_diffusers.models import RatingStatistics
from tactile_diffusers.pipelines.inputs import parse_ratings
from tactile_diffusers.signal import RATING_AXES, coverage_distance
from tactile_diffusers.signal.checks import check_number
from tactile_diffusers.signal.rating_scales import RATING_SCALE, to_raw

#: What the sliders allow, and what is refused whoever asks: an answer takes seconds and megabytes at most.
LIMITS = {
    "steps": (1, 25),
    "latent_steps": (1, 25),
    "order": (1, 2),
    "guidance": (0.0, 5.0),
    "seed": (0, 2**31 - 1),
    "duration_s": (0.5, 10.0),
    "takes": (1, 8),
}
#: Seconds of texture that one request may ask for, all takes together.
MOST_SECONDS = 20.0
#: Words at the lower and the upper end of each axis.
WORDS = {"roughness": ("smooth", "rough"), "bumpiness": ("even", "bumpy"), "slipperiness": ("sticky", "slippery")}
#: Scales, with their names on the page.
SCALES = {"percentile": "percentile of the training surfaces", "raw": "0–8, the typical rater's", "z": "z-scores"}
#: Ends of the sliders, in z-scores, where a checkpoint does not say what it was trained on.
_UNKNOWN_RANGE = (-2.0, 2.0)


@dataclass(frozen=True)
class Settings:
    """How textures are made.

    Args:
        steps (`int`): of LCTG; no more than a distilled decoder was made for = that decoder, where there is one.
        latent_steps (`int`): of DALE; a distilled one takes no more than it was made for.
        order (`int`): of both solvers, 1 or 2; a distilled decoder keeps its own.
        guidance (`float`): 1 = off.
        seed (`int`): take k is made with seed + k.
        duration_s (`float`): s.
        takes (`int`): textures of each rating.

    Raises:
        ValueError: for a value outside `LIMITS`, one that must be whole and is not, or more than `MOST_SECONDS`.
    """

    steps: int = 2
    latent_steps: int = 5
    order: int = 2
    guidance: float = 1.0
    seed: int = 4  # of the bundled checkpoint's first twelve, the one whose takes of the presets are the most usual
    duration_s: float = 1.6  # of the one segment, 1.6384 s, that is made at least
    takes: int = 1

    def __post_init__(self):
        for field in fields(self):
            value, (low, high) = getattr(self, field.name), LIMITS[field.name]
            check_number(field.name, value, at_least=low, at_most=high)
            if field.type is int:
                if value != int(value):
                    raise ValueError(f"`{field.name}` must be a whole number, got {value}.")
                object.__setattr__(self, field.name, int(value))  # a browser sends 2.0
        if self.takes * self.duration_s > MOST_SECONDS:
            raise ValueError(
                f"All takes together may last {MOST_SECONDS:g} s, got {self.takes} of {self.duration_s:g} s: ask for "
                "fewer or shorter ones."
            )


def digits(scale):
    """Decimals with which values on a scale are shown."""
    return 0 if scale == "percentile" else 2


def available_scales(config):
    """Those of `SCALES` whose statistics DALE's config has; z-scores always."""
    return [name for name in SCALES if not _lacks(config, name)]


def _lacks(config, scale):
    needed = {"percentile": ("quantiles",), "raw": ("mean", "std"), "z": ()}[scale]
    return any(getattr(RatingStatistics.from_config(config), name) is None for name in needed)


def to_z(values, scale, config):
    """Ratings of one texture in z-scores: a tuple of floats, NaN = not specified.

    Args:
        values (`Sequence[float | None]`): on `scale`, in the order of the axes; `None` = not specified.
        scale (`str`): of `SCALES`.
        config: DALE's.

    Raises:
        ValueError: see `parse_ratings`.
    """
    return tuple(parse_ratings([list(values)], config, scale)[0].tolist())


def from_z(ratings, scale, config):
    """Undoes `to_z`, within the ends of the scale: (axes,) float64, NaN stays."""
    ratings, statistics = np.asarray(ratings, dtype=np.float64), RatingStatistics.from_config(config)
    if scale == "raw":
        return np.clip(to_raw(ratings, np.array(statistics.mean), np.array(statistics.std)), *RATING_SCALE)
    if scale == "percentile":
        shares = np.linspace(0, 100, len(statistics.quantiles[0]))
        rows = zip(ratings, statistics.quantiles, strict=True)
        return np.array([np.interp(value, row, shares) if np.isfinite(value) else np.nan for value, row in rows])
    return ratings


def slider_ranges(scale, config):
    """Lowest and highest value of each axis' slider on a scale, `list[tuple[float, float]]`.

    They are the 0th and the 100th percentile of the training surfaces, whatever the scale; rounded inwards.
    """
    if scale == "percentile":
        return [(0.0, 100.0)] * len(RATING_AXES)
    known = RatingStatistics.from_config(config).range
    ends = np.array(known or [_UNKNOWN_RANGE] * len(RATING_AXES), dtype=np.float64)
    lows, highs = (from_z(side, scale, config) for side in ends.T)
    return [(math.ceil(low * 100) / 100, math.floor(high * 100) / 100) for low, high in zip(lows, highs, strict=True)]


def blend(first, second, share):
    """Ratings between two, in z-scores: the first at 0, the second at 1; what either leaves open stays open between.

    Args:
        first, second (`Sequence[float]`): (axes,) z-scores, NaN = not specified.
        share (`float`): 0 to 1.

    Raises:
        ValueError: for a share outside.
    """
    check_number("share", share, at_least=0, at_most=1)
    if share in (0, 1):  # NaN in the other one must not count
        return tuple((first, second)[int(share)])
    return tuple((1 - share) * a + share * b for a, b in zip(first, second, strict=True))


def describe(ratings, scale, config):
    """Ratings in words: "roughness 75, bumpiness not specified, ..." on a scale."""
    shown = from_z(ratings, scale, config)
    parts = (f"{value:.{digits(scale)}f}" if np.isfinite(value) else "not specified" for value in shown)
    return ", ".join(f"{axis} {part}" for axis, part in zip(RATING_AXES, parts, strict=True))


def novelty(ratings, config):
    """A sentence if no training surface is rated nearly so, else an empty string.

    Single axes need no check: the sliders end where training did.
    """
    statistics = RatingStatistics.from_config(config)
    if statistics.reach is None:
        return ""
    distance = coverage_distance([ratings], statistics.centre, statistics.covariance)[0]
    if np.isfinite(distance) and distance > statistics.reach:
        return "No training surface is rated nearly so in this combination: the texture is extrapolated."
    return ""
