"""Filters and resampling: pure functions on arrays whose last axis is time."""

from functools import lru_cache
from math import gcd

import numpy as np
from scipy import signal

from .constants import BAND_HZ


def band_pass(texture, sampling_rate, band=BAND_HZ, order=4, passes=2):
    """Butterworth band-pass along the last axis.

    Args:
        texture (`np.ndarray`): (..., samples), any unit.
        sampling_rate (`float`): Hz.
        band (`tuple[float, float]`): the design edges in Hz.
        order (`int`): order of the Butterworth design, per edge.
        passes (`int`): 2 = forward and backward, zero phase, the magnitude response squared (-6 dB at the design
            edges); 1 = forward only, causal (-3 dB at the edges).

    Returns:
        `np.ndarray`: float64, the shape of `texture`.

    Raises:
        ValueError: if the band does not lie inside (0, sampling_rate / 2), `passes` is neither 1 nor 2, or there is no
            sample.
    """
    low, high = band
    if not 0 < low < high < sampling_rate / 2:
        raise ValueError(f"`band` must satisfy 0 < low < high < {sampling_rate / 2} Hz, got {tuple(band)}.")
    if passes not in (1, 2):
        raise ValueError(f"`passes` must be 1 (causal) or 2 (zero phase), got {passes}.")
    sections = signal.butter(order, (low, high), btype="bandpass", fs=sampling_rate, output="sos")
    texture = np.asarray(texture, dtype=np.float64)
    if not texture.size:
        raise ValueError(f"`texture` must hold at least one sample, got the shape {texture.shape}.")
    if passes == 1:
        return signal.sosfilt(sections, texture, axis=-1)
    # the ring of the low edge lasts about two of its periods; pad at least that much
    padding = min(texture.shape[-1] - 1, int(2 * sampling_rate / low))
    return signal.sosfiltfilt(sections, texture, axis=-1, padlen=padding)


@lru_cache(maxsize=16)
def anti_alias_filter(up, down):
    """Kaiser low-pass for `resample`, flat up to 0.48 and stopped from 0.52 of the lower rate.

    Between 10 and 2.5 kHz that is 1200 and 1300 Hz: what would fold below 1.2 kHz is 80 dB down.
    """
    fastest = max(up, down)
    nyquist = fastest / 2  # of the upsampled signal, in units of the lower rate
    taps, beta = signal.kaiserord(80.0, 0.04 / nyquist)
    return signal.firwin(taps | 1, 0.5 / nyquist, window=("kaiser", beta))


def resample(texture, rate_in, rate_out):
    """Changes the sampling rate along the last axis by polyphase filtering.

    Args:
        texture (`np.ndarray`): (..., samples).
        rate_in, rate_out (`int`): Hz; whole numbers.

    Returns:
        `np.ndarray`: (..., ceil(samples * rate_out / rate_in)), float64, the time of the first sample unchanged.

    Raises:
        ValueError: if a rate is not a positive whole number.
    """
    for name, rate in (("rate_in", rate_in), ("rate_out", rate_out)):
        if not rate > 0 or rate % 1:  # of infinity, NaN
            raise ValueError(f"`{name}` must be a positive whole number of Hz, got {rate}.")
    texture = np.asarray(texture, dtype=np.float64)
    divisor = gcd(int(rate_in), int(rate_out))
    up, down = int(rate_out) // divisor, int(rate_in) // divisor
    if up == down:
        return texture
    return signal.resample_poly(texture, up, down, axis=-1, window=anti_alias_filter(up, down))
