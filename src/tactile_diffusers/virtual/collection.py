"""A collection of virtual surfaces: everything that its recordings and ratings depend on."""

from dataclasses import asdict, dataclass
from math import ceil

import numpy as np

from ..signal import SEGMENT_SECONDS
from .exploration import VELOCITY_RATE
from .percepts import reference_friction
from .raters import RATERS, draw_raters
from .recipe import RECIPE_VERSION
from .streams import Stream, stream
from .surface import VirtualSurface


@dataclass(frozen=True)
class Collection:
    """Settings of a collection. How many surfaces there are is none of them: surfaces do not depend on each other.

    Attributes:
        seconds (`float`): mean duration of a recording.
        explorers (`int`): recordings per surface; number 2 and up are fingers beside the recipe's two.
        seed (`int`): of everything.
        agreement (`float`): divides the raters' disagreement; 1 is the recipe.
        raters (`int`): number of raters.
        rater_moisture, axis_correlation (`float`): see `rate_surface`; 0 is the recipe.
        duration_spread (`float`): standard deviation of the log duration over surfaces (uneven sampling); 0 = equal.

    Raises:
        ValueError: naming the argument, if one is out of range.
    """

    seconds: float
    explorers: int = 2
    seed: int = 0
    agreement: float = 1.0
    raters: int = RATERS
    rater_moisture: float = 0.0
    axis_correlation: float = 0.0
    duration_spread: float = 0.0

    def __post_init__(self):
        for name, lowest in (("explorers", 1), ("raters", 1), ("seed", 0)):
            value = getattr(self, name)
            if not value >= lowest or value % 1:
                raise ValueError(f"`{name}` must be a whole number of at least {lowest}, got {value}.")
            object.__setattr__(self, name, int(value))  # a plain number, as it comes back from a file
        if not SEGMENT_SECONDS <= self.seconds < float("inf"):
            raise ValueError(f"`seconds` must be at least one segment, {SEGMENT_SECONDS} s, got {self.seconds}.")
        if not self.agreement > 0:
            raise ValueError(f"`agreement` must be positive (1 is the recipe), got {self.agreement}.")
        for name, highest in (("rater_moisture", 2), ("axis_correlation", 0.95), ("duration_spread", 2)):
            value = getattr(self, name)
            if not 0 <= value <= highest:
                raise ValueError(f"`{name}` must be from 0 (off) to {highest}, got {value}.")
        for name in ("seconds", "agreement", "rater_moisture", "axis_correlation", "duration_spread"):
            object.__setattr__(self, name, float(getattr(self, name)))

    @property
    def attributes(self):
        """What the attributes of a file say of its collection: a dict."""
        return {"recipe_version": RECIPE_VERSION, **asdict(self)}

    def surface(self, index):
        """Surface number `index`."""
        return VirtualSurface(self.seed, index)

    def duration(self, index):
        """Seconds of each recording of surface `index`: log-normal over surfaces, at least one segment."""
        draw = np.clip(stream(self.seed, Stream.DURATION, index).standard_normal(), -3, 3)
        seconds = self.seconds * np.exp(self.duration_spread * draw - self.duration_spread**2 / 2)
        return max(round(seconds * VELOCITY_RATE), ceil(SEGMENT_SECONDS * VELOCITY_RATE)) / VELOCITY_RATE

    def answers(self, surfaces):
        """(raters, surfaces, 3) answers about a list of `VirtualSurface`."""
        raters = draw_raters(self.seed, self.raters)
        settings = self.agreement, self.rater_moisture, self.axis_correlation
        return np.stack([surface.answers(raters, *settings) for surface in surfaces], axis=1)


def truth_fields(surfaces):
    """What is known of surfaces, for `RecordingsWriter.set_truth`.

    Args:
        surfaces (`list[VirtualSurface]`): the surfaces.

    Returns:
        `dict[str, np.ndarray]`: `percepts` (surfaces, 3); `friction_coefficient` at 0.5 N and 80 mm/s of a finger of
        moisture 1; `material`, the class; and the further `SurfaceParameters`, NaN where they belong to a grating that
        the surface does not have.
    """
    rows = [asdict(surface.parameters) for surface in surfaces]
    fields = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    for name in ("wavelength", "harmonic_decay", "jitter"):
        fields[name][fields["grating_level"] == 0] = np.nan
    fields["friction_coefficient"] = np.array([reference_friction(surface.parameters) for surface in surfaces])
    del fields["friction"]  # without compliance: not what a finger meets
    fields["percepts"] = np.stack([surface.percepts for surface in surfaces])
    return fields
