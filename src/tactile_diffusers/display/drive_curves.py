"""How a steady drive changes friction on the two kinds of display, and back.

Electroadhesion pulls the finger to the glass with a force that goes with the square of the voltage (measured on
fingers: Meyer et al., World Haptics 2013) and so only adds friction; a display that saturates has a lookup. Ultrasonic
vibration lifts the finger on a film of air and only takes friction away, by a law that has to be measured on each
device (Wiertlewski et al., PNAS 2016).
"""

import numpy as np
from scipy.interpolate import PchipInterpolator

from ..signal.checks import check_rows

#: Kind of display and the unit of its drive: volts, or vibration amplitude relative to the largest.
DRIVE_UNITS = {"electroadhesion": "V", "ultrasonic": "1"}
LOOKUP_COLUMNS = {
    "electroadhesion": ("voltage", "friction_increase"),
    "ultrasonic": ("amplitude", "friction_reduction"),
}
#: Points at which a lookup is tabulated to invert it: linear between them errs below 1e-6 of its range.
_TABLE_POINTS = 4097


def check_kind(kind):
    """Raises a ValueError unless `kind` is one of `DRIVE_UNITS`."""
    if not isinstance(kind, str) or kind not in DRIVE_UNITS:
        raise ValueError(f"`kind` must be one of {', '.join(DRIVE_UNITS)}, got {kind!r}.")


def check_lookup(kind, lookup):
    """The lookup of a display as rows of floats: from (0, 0), both columns increasing, amplitudes of at most 1.

    `None` for electroadhesion is the square law. Raises a ValueError for all else.
    """
    if lookup is None:
        if kind == "electroadhesion":
            return None
        raise ValueError("`lookup` is missing: measure friction reduction (N) over amplitude (0-1) on this device.")
    columns = LOOKUP_COLUMNS[kind]
    lookup = check_rows("lookup", lookup, columns)
    if len(lookup) < 3 or lookup[0] != (0.0, 0.0):
        raise ValueError(
            f"`lookup` must start at (0, 0) and have at least 3 rows, got {len(lookup)} from {lookup[0]}. "
            "Without drive friction is not changed: subtract what was measured there."
        )
    if kind == "ultrasonic" and lookup[-1][0] > 1:
        raise ValueError(
            f"`lookup` must hold amplitudes from 0 to 1, got {lookup[-1][0]:g}. Divide them by the largest."
        )
    for row, (lower, upper) in enumerate(zip(lookup[:-1], lookup[1:], strict=True)):
        if upper[1] <= lower[1]:
            raise ValueError(
                f"`lookup` must have increasing values of {columns[1]}, got {lower[1]:g} and {upper[1]:g} in rows "
                f"{row} and {row + 1}. Average more strokes, or end it where friction changes no further."
            )
    return lookup


def friction_change(kind, lookup, drive):
    """Change of lateral force by a steady drive, per unit of gain: V squared, or plus or minus the lookup. (samples,).

    +V and -V pull alike.
    """
    drive = np.asarray(drive, dtype=np.float64)
    if lookup is None:
        return np.square(drive)
    sign = 1 if kind == "electroadhesion" else -1
    return sign * PchipInterpolator(*np.transpose(lookup))(np.abs(drive))


def inverse_table(lookup):
    """Changes of friction and their drives, both increasing, for `np.interp`."""
    amplitudes = np.linspace(0.0, lookup[-1][0], _TABLE_POINTS)
    return PchipInterpolator(*np.transpose(lookup))(amplitudes), amplitudes
