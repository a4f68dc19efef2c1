"""Summaries of measurements: the leaves of a report, with intervals over surfaces.

Segments of one surface are alike, so surfaces are the independent units. Intervals come from leaving out one surface
at a time (jackknife). A bootstrap would put the same texture into a set twice, which biases kernel distances.
"""

import numpy as np
from scipy import stats

_KEYS = ("mean", "n", "min", "max", "median", "interval")


def jackknife_interval(estimate, left_out, size=None):
    """95 % interval from estimates (groups, ...) that each leave out one group, by Student's t (Tukey 1958).

    `size` is the effective number of groups, by default their number. Returns low and high, (...,) each.
    """
    groups = len(left_out)
    error = np.sqrt((groups - 1) / groups * np.square(left_out - left_out.mean(0)).sum(0))
    reach = stats.t.ppf(0.975, max((groups if size is None else size) - 1, 1)) * error
    return estimate - reach, estimate + reach


def jackknife(statistic, groups):
    """A statistic and its 95 % interval by leaving out one group at a time.

    `statistic` takes a mask (n,) of the members to use and returns a number or an array; `groups` (n,) are usually
    surfaces. The interval (low, high) is NaN where there are fewer than three groups.
    """
    groups = np.asarray(groups)
    value = np.asarray(statistic(np.ones(len(groups), dtype=bool)), dtype=np.float64)
    names = np.unique(groups)
    if len(names) < 3:
        return value, np.full((2, *value.shape), np.nan)
    replicates = np.stack([np.asarray(statistic(groups != name), dtype=np.float64) for name in names])
    return value, np.stack(jackknife_interval(value, replicates))


def estimate(statistic, *groups, limits=(-np.inf, np.inf)):
    """Leaf of a statistic of one set or several, with the `jackknife` interval: a group is left out of all sets.

    The statistic takes a mask of each set; `groups` (n,), (m,), ... are those of the sets' members. The interval is cut
    to `limits`.
    """
    ends = np.cumsum([len(names) for names in groups])[:-1]
    value, interval = jackknife(lambda mask: statistic(*np.split(mask, ends)), np.concatenate(groups))
    return number(value, len(groups[0]), np.clip(interval, *limits))


def leaf(values=None, groups=None):
    """Summary of one number per texture or surface (n,), NaN left out; of nothing where a metric does not apply.

    `groups` (n,) are the independent units, each value its own by default. Returns a dict: "mean", "n", "min", "max",
    "median" and "interval", the 95 % interval of the mean; None where it does not apply.
    """
    values = np.atleast_1d(np.asarray([] if values is None else values, dtype=np.float64))
    known = np.isfinite(values)
    groups = np.arange(len(values)) if groups is None else np.asarray(groups)
    values, groups = values[known], groups[known]
    if not len(values):
        return number()
    _, interval = jackknife(lambda mask: values[mask].mean(), groups)
    return number(values.mean(), len(values), interval, values.min(), values.max(), np.median(values))


def number(mean=None, n=None, interval=None, least=None, largest=None, median=None):
    """A leaf from its parts: JSON numbers, and None for what is missing or not finite."""
    interval = None if interval is None else [_plain(bound) for bound in interval]
    interval = None if interval is None or None in interval else interval
    parts = (_plain(mean), None if n is None else int(n), _plain(least), _plain(largest), _plain(median), interval)
    return dict(zip(_KEYS, parts, strict=True))


def _plain(value):
    return None if value is None or not np.isfinite(value) else float(value)


def is_leaf(entry):
    """Whether an entry of a report is a leaf."""
    return isinstance(entry, dict) and set(entry) == set(_KEYS)
