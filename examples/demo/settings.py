"""What a visitor may ask for, within limits, and the scale of the sliders."""

import math
from dataclasses import dataclass, fields

import numpy as np

from tactile_diffusers.models import RatingStatistics
from tactile_diffusers.pipelines import PRESETS
from tactile_diffusers.pipelines.inputs import LARGEST_GUIDANCE, LOUDEST_DEVIATIONS, parse_ratings
from tactile_diffusers.signal import RATING_AXES, coverage_distance
from tactile_diffusers.signal.checks import check_number

#: What the controls allow, and what is refused whoever asks: an answer takes seconds and megabytes at most.
LIMITS = {"seed": (0, 2**31 - 1), "guidance": (0.0, 5.0), "duration_s": (0.5, 10.0), "steps": (1, 25)}
#: Words at the lower and the upper end of each axis.
WORDS = {"roughness": ("smooth", "rough"), "bumpiness": ("even", "bumpy"), "slipperiness": ("sticky", "slippery")}


@dataclass(frozen=True)
class Settings:
    """How textures are made; a `ValueError` for a value outside `LIMITS`, or one that must be whole and is not."""

    seed: int = 6  # of the bundled checkpoint's first twelve, the one whose takes of presets are estimated best
    guidance: float = 1.0  # 1 = off
    duration_s: float = 1.6  # of the one segment, 1.6384 s, that is made at least
    steps: int | None = None  # of LCTG; None = what the checkpoint's own decoder of few steps takes

    def __post_init__(self):
        for field in fields(self):
            value, (low, high) = getattr(self, field.name), LIMITS[field.name]
            if value is None and field.default is None:
                continue
            check_number(field.name, value, at_least=low, at_most=high)
            if field.type is not float:
                if value != int(value):
                    raise ValueError(f"`{field.name}` must be a whole number, got {value}.")
                object.__setattr__(self, field.name, int(value))  # a browser sends 2.0

    @classmethod
    def of_make(cls, made):
        """Settings and checkpoint of the texture of Make; defaults without one."""
        if not made:
            return cls(), None
        (*_, guidance, duration_s, steps, checkpoint), texture, _told = made
        return cls(texture.seed, guidance, duration_s, steps), checkpoint


class Scale:
    """The sliders' scale: percentiles of the training surfaces, 0 to 100, of DALE's config.

    Raises:
        ValueError: if the checkpoint does not know them.
    """

    def __init__(self, config):
        self.config, self.statistics = config, RatingStatistics.from_config(config)
        self.axes = list(config.rating_axes)
        if self.statistics.quantiles is None:
            raise ValueError("The checkpoint's DALE has no `quantiles` of ratings: the sliders need them.")

    def to_z(self, values):
        """Ratings in z-scores, NaN = not specified, of sliders' values, `None` = not specified.

        Raises:
            ValueError: for a value beyond its slider, which names the axis.
        """
        for axis, value in zip(self.axes, values, strict=True):
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if value is not None and not (number and 0 <= value <= 100):
                raise ValueError(f"{axis} must be between 0 and 100, got {value!r}.")
        return tuple(parse_ratings([list(values)], self.config, "percentile")[0].tolist())

    def from_z(self, ratings):
        """Where sliders stand: a list of whole percentiles; `None` = not specified."""
        shares = np.linspace(0, 100, len(self.statistics.quantiles[0]))
        rows = zip(ratings, self.statistics.quantiles, strict=True)
        return [None if z is None or not np.isfinite(z) else round(np.interp(z, row, shares)) for z, row in rows]

    def preset(self, name):
        """Ratings of a preset in z-scores, a tuple with NaN = not specified; all NaN without one."""
        given = dict(zip(RATING_AXES, PRESETS.get(name, ()), strict=False))
        return tuple(math.nan if given.get(axis) is None else given[axis] for axis in self.axes)

    def describe(self, ratings):
        """Ratings in words: "roughness 75 · bumpiness any"."""
        shown = zip(self.axes, self.from_z(ratings), strict=True)
        return " · ".join(f"{axis} {'any' if value is None else f'{value:g}'}" for axis, value in shown)

    def novelty(self, ratings):
        """A sentence if no training surface is rated nearly so, else an empty string."""
        known = self.statistics
        far = known.reach is not None and coverage_distance([ratings], known.centre, known.covariance)[0] > known.reach
        return "No training surface is rated nearly so: the texture is extrapolated." if far else ""

    def strong(self, guidance):
        """A sentence if the guidance is beyond what the training data supports, else an empty string."""
        words = f"Guidance beyond {LARGEST_GUIDANCE:g}: levels leave those of the training surfaces."
        return words if guidance > LARGEST_GUIDANCE else ""

    def loud(self, rms):
        """Notes, none or one, on an RMS that is too large to be in N."""
        above = math.log(max(rms, 1e-12)) - self.config.level_mean
        words = f"its RMS is {math.exp(above):.0f} times that of the training surfaces: are the numbers newtons?"
        return [words] if above > LOUDEST_DEVIATIONS * self.config.level_std else []


def blend(first, second, share):
    """Ratings between two, in z-scores: the first at 0, the second at 1; what either leaves open stays open between.

    Raises:
        ValueError: for a share outside.
    """
    check_number("share", share, at_least=0, at_most=1)
    if share in (0, 1):  # NaN in the other one must not count
        return tuple((first, second)[int(share)])
    return tuple((1 - share) * a + share * b for a, b in zip(first, second, strict=True))
