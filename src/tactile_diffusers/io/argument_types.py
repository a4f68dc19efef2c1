"""Types of numbers on command lines: argparse adds the name of the argument to their refusals, and exits with 2."""

import argparse
import math


def checked(kind, allowed, words):
    """A `type` for `add_argument`: an int or float, refused with `words` unless it is `allowed`."""

    def parse(text):
        value = kind(text)
        if not allowed(value):
            raise argparse.ArgumentTypeError(f"must be {words}, got {text}")
        return value

    parse.__name__ = kind.__name__  # argparse names it for text that is no number
    return parse


count = checked(int, lambda value: value >= 1, "at least 1")
not_negative_int = checked(int, lambda value: value >= 0, "at least 0")
positive_number = checked(float, lambda value: 0 < value < math.inf, "above zero")
not_negative = checked(float, lambda value: 0 <= value < math.inf, "at least 0")
share = checked(float, lambda value: 0 <= value <= 1, "in [0, 1]")
below_one = checked(float, lambda value: 0 <= value < 1, "in [0, 1)")
#: Of PyTorch's generators and HDF5, and of libraries that take less.
seed = checked(int, lambda value: 0 <= value < 2**63, "at least 0 and below 2**63")
small_seed = checked(int, lambda value: 0 <= value < 2**32, "at least 0 and below 2**32")
