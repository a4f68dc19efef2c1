"""Random streams: every kind of draw has its own, so that adding one leaves all others as they are."""

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """First number of a stream's key; numbers are never used again for something else."""

    SURFACE = 0  # surface: parameters, then profile
    EXPLORATION = 1  # surface, explorer, trial
    RATER = 2  # rater
    ANSWERS = 3  # surface
    EXPLORER = 4  # explorer
    FRESH_WINDOWS = 5  # surface, trial
    COMPLIANCE = 6  # surface
    DURATION = 7  # surface
    RATER_MOISTURE = 8  # surface


def stream(seed, kind, *numbers):
    """Generator of one kind of draw.

    Args:
        seed (`int`): of the collection.
        kind (`Stream`): what is drawn.
        numbers (`int`): of which surface, explorer or trial, as `Stream` says.

    Returns:
        `np.random.Generator`
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(int(kind), *numbers)))
