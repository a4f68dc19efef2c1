"""Checks of numbers that a caller gives: finite numbers, whole numbers, seeds."""

import sys
from numbers import Integral, Real


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
