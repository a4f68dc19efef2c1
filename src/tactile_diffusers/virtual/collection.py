"""A collection of virtual surfaces: the settings that its recordings and ratings depend on."""

from dataclasses import asdict, dataclass

import numpy as np

from ..signal import RATING_AXES
from ..signal.checks import check_number, check_seed, check_whole_number
from ..signal.constants import LEAST_RECORDING
from .raters import (
    RATERS,
    RATING_CORRELATION,
    check_further_axes,
    check_rating_correlation,
    draw_raters,
    further_answers,
)
from .recipe import RECIPE_VERSION
from .surface import VirtualSurface


@dataclass(frozen=True)
class Collection:
    """Settings of a collection; surfaces do not depend on how many there are.

    Attributes:
        seconds (`float`): duration of a recording.
        explorers (`int`): recordings per surface; number 2 and up are fingers beside the recipe's two.
        seed (`int`): of everything.
        agreement (`float`): divides the raters' disagreement; 1 is the recipe.
        raters (`int`): number of raters.
        rating_correlation (`tuple[float, float, float]`): of the impressions that raters share, as (rough, bumpy),
            (rough, slippery), (bumpy, slippery).
        impulsiveness (`float`): 0 = Gaussian profiles, 1 = the recipe, 2 = twice the intermittency and catches.
        further_axes (`tuple[str, ...]`): on which the raters answer beside the three, of `FURTHER_AXES`.

    Raises:
        ValueError: naming the argument, if one is out of range.
    """

    seconds: float
    explorers: int = 2
    seed: int = 0
    agreement: float = 1.0
    raters: int = RATERS
    rating_correlation: tuple[float, float, float] = RATING_CORRELATION
    impulsiveness: float = 1.0
    further_axes: tuple[str, ...] = ()

    def __post_init__(self):
        checked = {
            "seconds": check_number("seconds", self.seconds, "s", at_least=LEAST_RECORDING),
            "explorers": check_whole_number("explorers", self.explorers),
            "seed": check_seed(self.seed),
            "agreement": check_number("agreement", self.agreement, above=0),
            "raters": check_whole_number("raters", self.raters),
            "rating_correlation": check_rating_correlation(self.rating_correlation),
            "impulsiveness": check_number("impulsiveness", self.impulsiveness, at_least=0, at_most=4),
            "further_axes": check_further_axes(self.further_axes),
        }
        for name, value in checked.items():  # plain numbers, as they come back from a file
            object.__setattr__(self, name, value)

    @property
    def attributes(self):
        """The settings as attributes of a file: a dict."""
        further = ", ".join(self.further_axes)
        found = {"recipe_version": RECIPE_VERSION, **asdict(self), "further_axes": further}
        return found if further else {name: value for name, value in found.items() if name != "further_axes"}

    @property
    def rating_axes(self):
        """Names of the axes that raters answer on."""
        return (*RATING_AXES, *self.further_axes)

    @classmethod
    def from_attributes(cls, attributes):
        """The collection that a file's attributes describe; a file of another source has none of them."""
        fields = {name: attributes[name] for name in cls.__dataclass_fields__ if name in attributes}
        return cls(**fields)

    def surface(self, index):
        """Surface number `index`."""
        return VirtualSurface(self.seed, index, self.impulsiveness)

    def answers(self, surfaces, trial=0):
        """(raters, surfaces, axes) answers about a list of `VirtualSurface`."""
        raters = draw_raters(self.seed, self.raters)
        settings = self.agreement, self.rating_correlation, trial
        answers = np.stack([one.answers(raters, *settings) for one in surfaces], axis=1)
        if not self.further_axes:
            return answers
        asked = self.further_axes, self.raters, self.agreement, trial
        return np.concatenate([answers, np.stack([further_answers(self.seed, s, *asked) for s in surfaces], 1)], -1)
