"""Random streams: every kind of random draw has its own, so that a new one leaves all others as they are."""

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """First number of a stream's key; a number is never used for two purposes."""

    SURFACE = 0  # surface: parameters, then profile
    EXPLORATION = 1  # surface, explorer, trial
    RATER = 2  # rater
    ANSWERS = 3  # surface
    EXPLORER = 4  # explorer
    FRESH_WINDOWS = 5  # surface, trial
    TRIAL = 6  # surface, trial of the raters
    FURTHER_RATER = 7  # rater, axis
    FURTHER_ANSWERS = 8  # surface, axis
    FURTHER_TRIAL = 9  # surface, axis, trial of the raters


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
