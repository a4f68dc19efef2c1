"""The band-pass of textures: a pure function on arrays whose last axis is time."""

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
