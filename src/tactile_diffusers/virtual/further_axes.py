"""What virtual raters say on axes beside the three: drawn apart, so that their other answers stay what they were."""

import numpy as np

from ..signal.rating_scales import RATING_SCALE
from .percepts import further_percept
from .raters import GAIN_SPREAD, OFFSET_SPREAD, TYPICAL_GAIN
from .streams import Stream, stream

#: Axes that can be asked for. Nothing of a friction force tells how warm a surface is.
FURTHER_AXES = ("regularity", "fineness", "warmth")
#: Idiosyncrasy, taste and noise of a trial, as in `raters`: of visual and tactile fineness raters agree as on bumpiness
#: (recipe).
_IDIOSYNCRASY, _TASTE, _TRIAL_NOISE = 0.40, 0.65, 0.65


def check_further_axes(value):
    """Names of `FURTHER_AXES`, also as one string with commas, as a tuple.

    Raises:
        ValueError: for another name, or one that comes twice.
    """
    names = tuple(name.strip() for name in value.split(",") if name.strip()) if isinstance(value, str) else tuple(value)
    if len(set(names)) < len(names) or not set(names) <= set(FURTHER_AXES):
        raise ValueError(f"`further_axes` must be different names of {list(FURTHER_AXES)}, got {value!r}.")
    return names


def further_answers(seed, surface, axes, raters, agreement=1.0, trial=0):
    """Answers of so many raters about one `VirtualSurface` on further axes: (raters, axes) float32, 0 to 8."""
    columns = []
    for axis in axes:
        number = FURTHER_AXES.index(axis)
        own, again = (
            stream(seed, Stream.FURTHER_ANSWERS, surface.index, number),
            stream(seed, Stream.FURTHER_TRIAL, surface.index, number, trial),
        )
        percept = own.standard_normal() if axis == "warmth" else further_percept(surface.parameters, axis)
        shared = (percept + _IDIOSYNCRASY * own.standard_normal()) / np.sqrt(1 + _IDIOSYNCRASY**2)
        disagreement = _TASTE * own.standard_normal(raters) + _TRIAL_NOISE * again.standard_normal(raters)
        draws = np.stack([stream(seed, Stream.FURTHER_RATER, r, number).standard_normal(2) for r in range(raters)], 1)
        gain = TYPICAL_GAIN * np.exp(GAIN_SPREAD * draws[1])
        low, high = RATING_SCALE
        answers = (low + high) / 2 + OFFSET_SPREAD * draws[0] + gain * (shared + disagreement / agreement)
        columns.append(np.clip(np.round(answers), low, high))
    return np.stack(columns, axis=-1).astype(np.float32)
