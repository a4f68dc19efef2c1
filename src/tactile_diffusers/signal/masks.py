"""Masks over time: runs of True, gaps, and what lies beside them."""

import numpy as np


def true_runs(mask, shortest=1):
    """Start and stop (exclusive) of every run of at least `shortest` samples of True: (runs, 2) int64."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8))).reshape(-1, 2)
    return edges[edges[:, 1] - edges[:, 0] >= shortest]


def mask_of_runs(runs, samples):
    """(samples,) bool, True inside each (start, stop) of `runs`; parts outside the mask are cut off."""
    mask = np.zeros(samples, dtype=bool)
    for start, stop in np.clip(runs, 0, samples):
        mask[start:stop] = True
    return mask


def bridge_gaps(mask, longest):
    """A copy in which gaps of at most `longest` samples between two runs of True are True; gaps at the ends stay."""
    runs = true_runs(mask)
    gaps = np.stack([runs[:-1, 1], runs[1:, 0]], axis=-1)
    return mask | mask_of_runs(gaps[gaps[:, 1] - gaps[:, 0] <= longest], len(mask))


def interpolated(values, missing):
    """A copy of `values` (n,) with straight lines across the samples that are `missing`; the ends are held."""
    known = np.flatnonzero(~missing)
    return np.interp(np.arange(len(values)), known, values[known]) if missing.any() else values.copy()
