"""What playback asks of numbers: those of a stream, and of the conversion from newtons to drive."""

import sys
from numbers import Real

import numpy as np


def check_number(name, value, unit, *, above=None, at_least=None):
    """A finite float, above or at least a bound where one is given. An array or tensor without axes is a number, too.

    Raises:
        ValueError: if `value` is no finite number or beyond the bound; the message calls it `name`, in `unit`.
    """
    bound = f" above {above:g}" if above is not None else f" of at least {at_least:g}" if at_least is not None else ""
    if getattr(value, "shape", None) == () and hasattr(value, "item"):
        value = value.item()
    number = isinstance(value, Real) and not isinstance(value, bool)
    # a whole number beyond every float is no finite one; NaN fails
    if (
        not number
        or not abs(value) <= sys.float_info.max
        or (above is not None and value <= above)
        or (at_least is not None and value < at_least)
    ):
        raise ValueError(f"`{name}` must be a finite number{bound} in {unit}, got {value!r}. Give it in {unit}.")
    return float(value)


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
