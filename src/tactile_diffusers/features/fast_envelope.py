"""The fast envelope of a waveform: the gain that all bands share, finer in time than the levels of bands.

Envelopes of a texture's bands move together (McDermott and Simoncelli 2011, 10.1016/j.neuron.2011.06.032), and where a
finger sticks and lets go they move within milliseconds. A few values of the latents carry that for all bands at once:
a waveform is divided by this gain before the decoder learns it, and multiplied by it after decoding. To the decoder
that is a prior noise that is already as loud as the texture at every moment.
"""

import numpy as np

from .band_levels import smoothing_kernel

#: Power relative to unit RMS that is added to both: silence has an envelope of 0.
POWER_FLOOR = 1e-4
#: Spread of the measured log amplitude of steady noise, times the square root of the samples per value (measured).
NOISE_SPREAD = 0.68
#: Least share that is believed, so that the course of a steady texture is that of noise, not nothing.
LEAST_BELIEVED = 0.05


def measure_fast_envelope(waveform, step, sampling_rate):
    """Level over time relative to its smooth course, shrunk by what steady noise would show of it.

    A few samples tell a level poorly. Of a texture whose measured envelope varies no more than that of steady noise,
    hardly anything is believed; of others as much as a Wiener filter would: 1 - noise variance / variance. Otherwise
    chance would be counted twice, in the envelope and in the noise that is multiplied by it.

    Args:
        waveform (`np.ndarray`): (batch, samples), whitened, unit RMS; a multiple of `step` samples.
        step (`int`): samples per value; each is measured with a Hann window of two steps.
        sampling_rate (`float`): Hz.

    Returns:
        `np.ndarray`: (batch, samples / step) float64, natural log of amplitude.
    """
    window = np.hanning(2 * step + 1)[:-1] + np.hanning(2 * step + 1)[1:]
    margin = step // 2, step - step // 2
    padded = np.pad(np.square(np.asarray(waveform, dtype=np.float64)), ((0, 0), margin), mode="symmetric")
    pieces = np.lib.stride_tricks.sliding_window_view(padded, 2 * step, axis=-1)[:, ::step]
    power = pieces @ (window / window.sum())
    kernel = smoothing_kernel(sampling_rate / step)  # slower changes are those of the band levels
    padded = np.pad(power, ((0, 0), (len(kernel) // 2, len(kernel) // 2)), mode="edge")
    smooth = np.lib.stride_tricks.sliding_window_view(padded, len(kernel), axis=-1) @ kernel
    envelope = 0.5 * np.log((power + POWER_FLOOR) / (smooth + POWER_FLOOR))
    variance = envelope.var(-1, keepdims=True)
    return envelope * np.maximum(1 - NOISE_SPREAD**2 / step / np.maximum(variance, 1e-12), LEAST_BELIEVED)


def envelope_gain(envelope, step):
    """The gain over time that a fast envelope stands for, straight between its values in log amplitude.

    Args:
        envelope (`np.ndarray`): (batch, values), natural log of amplitude.
        step (`int`): samples per value.

    Returns:
        `np.ndarray`: (batch, values * step), like `envelope`.
    """
    padded = np.pad(envelope, ((0, 0), (1, 1)), mode="edge")
    share = ((np.arange(step) + 0.5) / step).astype(envelope.dtype)
    # from the middle of a value to that of the next one
    between = padded[:, :-1, None] + np.diff(padded)[..., None] * share
    start = step - step // 2
    return np.exp(between.reshape(len(envelope), -1)[:, start : start + envelope.shape[1] * step])


def gain_of_frames(envelope, samples):
    """`envelope_gain` of values as latents hold them: (batch, values per frame, frames) -> (batch, samples)."""
    values = envelope.transpose(0, 2, 1).reshape(len(envelope), -1)
    return envelope_gain(values, samples // values.shape[1])
