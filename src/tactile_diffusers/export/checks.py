"""What every writer asks of its arguments before it touches the disk."""

import math
from pathlib import Path

import numpy as np

from ..signal import RATING_AXES


def check_texture(texture, sampling_rate):
    """The samples of one texture as an array, once they are known to be writable.

    Args:
        texture (`np.ndarray`): (samples,) floats, N.
        sampling_rate (`int`): Hz; a whole number, as in the header of a WAV file.

    Returns:
        `np.ndarray`: (samples,) float64.

    Raises:
        ValueError: if `texture` is not one row of finite numbers, or `sampling_rate` not a positive whole number.
    """
    texture = np.asarray(texture)
    if texture.ndim != 1 or texture.size == 0:
        raise ValueError(
            f"`texture` must have the shape (samples,), got {texture.shape}. Write the textures of a batch one by one."
        )
    if texture.dtype.kind not in "fiu":
        raise ValueError(f"`texture` must hold real numbers, got dtype {texture.dtype}. Convert it to float32.")
    texture = texture.astype(np.float64)
    bad = np.flatnonzero(~np.isfinite(texture))
    if bad.size:
        raise ValueError(
            f"`texture` must be finite, got {texture[bad[0]]} at sample {bad[0]} ({bad.size} such samples in all). "
            "Remove or interpolate them first."
        )
    if not (0 < _as_float(sampling_rate) < math.inf and int(sampling_rate) == sampling_rate):
        raise ValueError(
            f"`sampling_rate` must be a positive whole number of Hz, got {sampling_rate}. "
            "Pass the rate that came with the texture."
        )
    return texture


def check_ratings(ratings):
    """Ratings (3,) as float64 in the order of `RATING_AXES`, NaN = not specified.

    Raises:
        ValueError: if there is not one value for each axis, or one is infinite.
    """
    try:
        found = np.array([math.nan if value is None else float(value) for value in ratings])
    except (TypeError, ValueError, OverflowError):
        found = np.empty(0)
    if len(found) != len(RATING_AXES) or np.isinf(found).any():
        raise ValueError(
            f"`ratings` must be {len(RATING_AXES)} numbers, {', '.join(RATING_AXES)}, got {ratings!r}. "
            "Give NaN for an axis that is not specified."
        )
    return found


def check_positive_or_unknown(name, value):
    """A float above zero, or NaN for a quantity that was not measured.

    Raises:
        ValueError: if `value` is infinite, zero or negative; the message calls it `name`.
    """
    number = _as_float(value)
    if not (math.isnan(number) or 0 < number < math.inf):
        raise ValueError(f"`{name}` must be above zero, or NaN if unknown, got {value!r}.")
    return number


def check_above_zero(name, value):
    """A float above zero.

    Raises:
        ValueError: if `value` is not finite, zero or negative; the message calls it `name`.
    """
    number = _as_float(value)
    if not 0 < number < math.inf:
        raise ValueError(f"`{name}` must be above zero, got {value!r}.")
    return number


def _as_float(value):
    """A float; infinity for what is none, which no check lets pass."""
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.inf


def check_file(path):
    """A path as `Path`, once it is known that there is a file.

    Raises:
        FileNotFoundError: if there is none.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"`path` {path} does not exist.")
    return path
