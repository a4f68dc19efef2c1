"""Triangular filters over frequency, spaced on a mel or logarithmic scale, on windows of several lengths."""

from functools import lru_cache

import numpy as np

FILTER_SCALES = ("slaney", "log")


@lru_cache(maxsize=8)
def filterbank(sampling_rate, band, num_filters, window_lengths, scale):
    """Triangular filters over `band`, each on the shortest window that resolves it.

    A filter narrower than the bins of the longest window is widened to one bin on either side, so none is empty.

    Returns:
        `tuple`: one (num_filters, bins) matrix per window, rows summing to 1 or, if another window has the filter, 0.
    """
    import librosa

    if scale == "log":
        corners = np.geomspace(*band, num_filters + 2)
    else:
        corners = librosa.mel_frequencies(num_filters + 2, fmin=band[0], fmax=band[1])
    spacings = [sampling_rate / length for length in window_lengths]
    banks = [np.zeros((num_filters, length // 2 + 1)) for length in window_lengths]
    for index, (left, centre, right) in enumerate(zip(corners[:-2], corners[1:-1], corners[2:], strict=True)):
        fitting = [i for i, spacing in enumerate(spacings) if right - left >= 3 * spacing]
        chosen = min(fitting, key=lambda i: window_lengths[i]) if fitting else int(np.argmax(window_lengths))
        left, right = min(left, centre - spacings[chosen]), max(right, centre + spacings[chosen])
        bins = np.arange(banks[chosen].shape[1]) * spacings[chosen]
        weights = np.clip(np.minimum((bins - left) / (centre - left), (right - bins) / (right - centre)), 0, None)
        banks[chosen][index] = weights / weights.sum()
    return tuple(banks)
