"""Checks of what a caller gives: numbers, seeds, rows of samples and small tables."""

import sys
from numbers import Integral, Real

import numpy as np


def check_number(name, value, unit="", *, above=None, at_least=None, at_most=None):
    """A finite float inside the bounds that are given. An array or tensor without axes is a number, too.

    Raises:
        ValueError: if `value` is no finite number or outside the bounds; the message calls it `name`, in `unit`.
    """
    number = _as_number(value)
    inside = number is not None
    bounds = []
    if above is not None:
        inside, bounds = inside and number > above, [*bounds, f"above {above:g}"]
    if at_least is not None:
        inside, bounds = inside and number >= at_least, [*bounds, f"of at least {at_least:g}"]
    if at_most is not None:
        inside, bounds = inside and number <= at_most, [*bounds, f"of at most {at_most:g}"]
    if not inside:
        words = " and ".join(bounds) + (f" in {unit}" if unit else "")
        raise ValueError(f"`{name}` must be a finite number{' ' if words else ''}{words.strip()}, got {value!r}.")
    return float(number)


def check_whole_number(name, value, at_least=1, at_most=2**64 - 1):
    """A whole number inside the bounds, as an int.

    Raises:
        ValueError: if `value` is anything else; the message calls it `name`.
    """
    number = _as_number(value)
    if not isinstance(number, Integral) or not at_least <= number <= at_most:
        most = "" if at_most == 2**64 - 1 else f" and at most {at_most}"
        raise ValueError(f"`{name}` must be a whole number of at least {at_least}{most}, got {value!r}.")
    return int(number)


def check_seed(seed):
    """A seed as an int: a whole number of at least 0 that fits into 64 bits, as generators and files take it."""
    return check_whole_number("seed", seed, at_least=0)


def _as_number(value):
    """A finite real number, or `None`."""
    if getattr(value, "shape", None) == () and hasattr(value, "item"):
        value = value.item()
    number = isinstance(value, Real) and not isinstance(value, bool)
    # a whole number beyond every float is not finite; NaN fails
    return value if number and abs(value) <= sys.float_info.max else None


#: Any length is taken, but more textures than samples, of no more samples than this, are the columns of a table.
_MOST_COLUMNS = 16


def check_samples(name, values):
    """One row of finite real numbers as float64, (samples,).

    Raises:
        ValueError: on another shape or type, no samples, or NaN and infinity; the message calls it `name`.
    """
    values = np.asarray(values)
    if values.ndim != 1 or values.size == 0:
        raise ValueError(f"`{name}` must have the shape (samples,), got {values.shape}. Pass one channel at a time.")
    if values.dtype.kind not in "fiu":
        raise ValueError(f"`{name}` must hold real numbers, got dtype {values.dtype}. Convert it to float32.")
    values = values.astype(np.float64)
    finite = np.isfinite(values)
    if not finite.all():
        bad = np.flatnonzero(~finite)
        raise ValueError(
            f"`{name}` must be finite, got {values[bad[0]]} at sample {bad[0]} ({bad.size} such samples in all). "
            "Remove or interpolate them first."
        )
    return values


def check_rows(name, rows, columns):
    """A table as a tuple of tuples of floats, for instance pairs of speed and cutoff.

    Raises:
        ValueError: if there is no row, a row has not one finite number per column, or the first column does not
            increase.
    """
    try:
        table = np.asarray(rows, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"`{name}` must be rows of ({', '.join(columns)}), got {rows!r}.") from error
    if table.ndim != 2 or table.shape[1] != len(columns) or not len(table):
        raise ValueError(f"`{name}` must be rows of ({', '.join(columns)}), got the shape {table.shape}.")
    if not np.isfinite(table).all():
        row = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0])
        raise ValueError(f"`{name}` must be finite, got {table[row].tolist()} in row {row}. Leave that row out.")
    falls = np.flatnonzero(np.diff(table[:, 0]) <= 0)
    if falls.size:
        pair = table[falls[0] : falls[0] + 2, 0].tolist()
        raise ValueError(
            f"`{name}` must have increasing values of {columns[0]}, got {pair} in rows {falls[0]} and {falls[0] + 1}. "
            "Sort the rows and average what was measured twice."
        )
    return tuple(tuple(row) for row in table.tolist())


def texture_rows(texture):
    """Textures in any form, (samples,) or (batch, samples), as (batch, samples) float64; NaN stays.

    Raises:
        ValueError: on another shape, columns of a table, or what is no real number (which is not cut to its real part).
    """
    if hasattr(texture, "detach"):  # a tensor, without the import of torch
        texture = texture.detach().cpu()
        texture = (texture if texture.is_complex() else texture.double()).numpy()
    try:
        array = np.asarray(texture)
        if np.iscomplexobj(array):
            raise TypeError(f"got {array.dtype}")
        texture = array.astype(np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"`texture` must be real numbers, (samples,) or (batch, samples) ({error}).") from error
    texture = texture[None] if texture.ndim == 1 else texture
    if texture.ndim != 2 or 0 in texture.shape:
        raise ValueError(f"`texture` must be (samples,) or (batch, samples), not empty; got {texture.shape}.")
    if texture.shape[0] > texture.shape[1] <= _MOST_COLUMNS:
        raise ValueError(
            f"`texture` must be (samples,) or (batch, samples), got {texture.shape}: more textures than samples. "
            "Transpose it, or pass one column as (samples,)."
        )
    return texture
