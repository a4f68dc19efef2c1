"""Who explores: the two explorers of the recipe, and a population of further fingers."""

from dataclasses import dataclass

import numpy as np

from .streams import Stream, stream


@dataclass(frozen=True)
class Explorer:
    """A hand and its finger.

    Attributes:
        speed (`float`): mean, mm/s.
        normal_force (`float`): mean, N.
        moisture (`float`): factor on the friction coefficient.
        gain (`float`): factor on the amplitude of textures.
        cutoff (`float`): factor on the cutoff of the finger's low-pass.
    """

    speed: float
    normal_force: float
    moisture: float
    gain: float
    cutoff: float = 1.0


#: The two explorers of the recipe.
EXPLORERS = (Explorer(78.0, 0.52, 1.0, 1.0), Explorer(90.0, 0.47, 0.75, 0.8))
#: Standard deviations, in logarithms, of the population that further explorers come from (recipe). Its middle is the
#: geometric mean of the two, who lie within one standard deviation on either side: 0.9, 0.8, 0.6, 0.6 and 0. Skin
#: friction on one material differs by 15-45 % between people (aluminium 0.38 +- 0.13, sandpaper 0.61 +- 0.10, wet glass
#: 0.78 +- 0.35); finger mechanics differ much too (arXiv 2505.11162). Speeds and forces stay near the limits of usable
#: segments, as if explorers had been instructed.
POPULATION_SPREAD = Explorer(speed=0.08, normal_force=0.06, moisture=0.25, gain=0.2, cutoff=0.25)
#: Draws beyond so many standard deviations are held there.
FARTHEST = 2.0


def explorer(index, seed):
    """Explorer number `index` of a collection: the two of the recipe first, then fingers drawn from the population.

    Number 2 and up are unseen fingers to a model that learned from the first two: moister or drier, and of other
    mechanics, than both in about half of the draws.

    Args:
        index (`int`): 0, 1, ...
        seed (`int`): of the collection.

    Returns:
        `Explorer`
    """
    if index < len(EXPLORERS):
        return EXPLORERS[index]
    middle = np.exp(np.mean([np.log(list(vars(who).values())) for who in EXPLORERS], axis=0))
    spread = list(vars(POPULATION_SPREAD).values())
    draw = np.clip(stream(seed, Stream.EXPLORER, index).standard_normal(len(spread)), -FARTHEST, FARTHEST)
    return Explorer(*(middle * np.exp(draw * spread)).tolist())
