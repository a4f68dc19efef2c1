"""Band levels over time: measured on a waveform, and given back to one that a decoder got slightly wrong.

A few solver steps and a lossy latent leave every band of a decoded texture a decibel or two off. What the finger feels
most is the energy in each band, so it is kept as numbers beside the waveform's shape and restored after decoding, as
the CELT layer of the Opus codec keeps the energy of its bands (Valin et al. 2013, arXiv 1602.04845).
"""

from functools import lru_cache

import numpy as np
from scipy import signal

from ..signal import band_edges

#: Length of the Hann kernel that smooths powers over time, s: fast modulation stays the decoder's.
SMOOTHING_SECONDS = 0.4
#: Powers relative to white noise of unit RMS below which a band counts as silent.
POWER_FLOOR = 1e-6
#: Times that levels are measured and corrected: gains overlap in time and frequency, so one pass falls short of them.
PASSES = 3
#: Largest correction in dB: more means that the decoder left a band empty, and would only lift its noise.
LARGEST_GAIN_DB = 20.0


@lru_cache(maxsize=8)
def _members(sampling_rate, band, count, window):
    """For each STFT bin its band, and for each band the power of white noise of unit RMS: (bins,), (count + 1,).

    The lowest band reaches down to 0 Hz; one more lies above `band`, where a texture's filter fades.
    """
    frequencies = np.fft.rfftfreq(window, 1 / sampling_rate)
    edges = band_edges(count, band)
    edges[-1] += 2 * sampling_rate / window  # a tone on the edge lies in the band, with all of its main lobe
    members = np.searchsorted(edges[1:], frequencies, side="right")
    shares = np.bincount(members, minlength=count + 1)
    if not shares.all():
        raise ValueError(
            f"`level_bands` of {count} leaves a band of {tuple(band)} Hz without a bin of {sampling_rate / window:.3g} "
            "Hz. Use fewer bands or a longer window."
        )
    return members, shares / len(frequencies)


def check_band_levels(sampling_rate, band, count, window, hop):
    """Raises a `ValueError` unless levels of `count` bands can be measured, and restored, on such a grid."""
    if window < 2 * hop or window % 2:
        raise ValueError(
            f"`level_bands` need an even window of at least two latent frames (2 x {hop} samples), got {window}."
        )
    _members(sampling_rate, tuple(band), count, window)


def _transform(waveform, window, hop):
    """(batch, samples) -> (batch, bins, samples / hop + 1) complex."""
    half = window // 2
    padded = np.pad(waveform, ((0, 0), (half, half)), mode="reflect")  # also where a waveform is shorter than that
    return signal.stft(padded, nperseg=window, noverlap=window - hop, boundary=None, scaling="psd")[2]


def _smoothing(sampling_rate, hop):
    half = max(1, round(SMOOTHING_SECONDS * sampling_rate / hop / 2))
    kernel = np.hanning(2 * half + 1)[1:-1]
    return kernel / kernel.sum()


def _log_powers(transform, members, shares, kernel):
    """(batch, bins, frames + 1) -> (batch, bands, frames), natural log of power over white noise's."""
    power = np.abs(transform) ** 2
    power = np.stack([power[:, members == index].sum(1) for index in range(len(shares))], axis=1)
    power = power / (shares[:, None] * len(members))
    power = 0.5 * (power[..., 1:] + power[..., :-1])  # from the edges of hops to their middles
    half = len(kernel) // 2
    padded = np.pad(power, ((0, 0), (0, 0), (half, half)), mode="edge")
    smooth = signal.oaconvolve(padded, kernel[None, None], mode="valid", axes=-1)
    return np.log(np.maximum(smooth, 0) + POWER_FLOOR)


def measure_band_levels(waveform, sampling_rate, band, count, window, hop):
    """Log powers of logarithmic bands over time.

    Args:
        waveform (`np.ndarray`): (batch, samples), a multiple of `hop` samples.
        sampling_rate (`float`): Hz.
        band (`tuple[float, float]`): Hz.
        count (`int`): bands inside `band`; the lowest reaches down to 0 Hz.
        window, hop (`int`): of the Hann windows, samples.

    Returns:
        `np.ndarray`: (batch, count + 1, samples / hop) float64, natural log of power relative to white noise of unit
        RMS, smoothed over 0.4 s; the last row is what lies above `band`.
    """
    members, shares = _members(sampling_rate, tuple(band), count, window)
    transform = _transform(np.asarray(waveform, dtype=np.float64), window, hop)
    return _log_powers(transform, members, shares, _smoothing(sampling_rate, hop))


def measure_fast_modulation(waveform, sampling_rate, band, count, window, hop):
    """How band levels depart from their smooth course: what the window resolves, faster than `SMOOTHING_SECONDS`.

    Arguments are those of `measure_band_levels`.

    Returns:
        `np.ndarray`: (batch, count + 1, samples / hop) float64, difference of natural logs of power.
    """
    members, shares = _members(sampling_rate, tuple(band), count, window)
    transform = _transform(np.asarray(waveform, dtype=np.float64), window, hop)
    return _fast_modulation(transform, members, shares, _smoothing(sampling_rate, hop))


def _fast_modulation(transform, members, shares, smoothing):
    return _log_powers(transform, members, shares, np.ones(1)) - _log_powers(transform, members, shares, smoothing)


def impose_band_levels(waveform, levels, sampling_rate, band, window, hop, contrast=None):
    """Gives a waveform the band levels that it should have, by slowly varying gains.

    Args:
        waveform (`np.ndarray`): (batch, samples), a multiple of `hop` samples.
        levels (`np.ndarray`): (batch, count + 1, samples / hop), as `measure_band_levels` makes them.
        sampling_rate, band, window, hop: as for `measure_band_levels`.
        contrast (`np.ndarray`, *optional*): (batch, count + 1), factors by which the fast modulation of each band
            (`measure_fast_modulation`) is made deeper afterwards, in log power.

    Returns:
        `np.ndarray`: (batch, samples) float64.
    """
    waveform = np.asarray(waveform, dtype=np.float64)
    members, shares = _members(sampling_rate, tuple(band), levels.shape[1] - 1, window)
    transform, smoothing = _transform(waveform, window, hop), _smoothing(sampling_rate, hop)
    limit, gains, restored = LARGEST_GAIN_DB * np.log(10) / 20, 0.0, waveform

    def apply(gains):
        edges = np.pad(gains, ((0, 0), (0, 0), (1, 1)), mode="edge")
        edges = np.exp(0.5 * (edges[..., 1:] + edges[..., :-1]))  # back to the edges of hops
        made = signal.istft(transform * edges[:, members], nperseg=window, noverlap=window - hop, scaling="psd")[1]
        return made[:, : waveform.shape[-1]]

    for _ in range(PASSES):
        measured = _log_powers(_transform(restored, window, hop), members, shares, smoothing)
        gains = np.clip(gains + 0.5 * (np.asarray(levels, dtype=np.float64) - measured), -limit, limit)
        restored = apply(gains)
    if contrast is not None:
        fast = _fast_modulation(_transform(restored, window, hop), members, shares, smoothing)
        restored = apply(np.clip(gains + 0.5 * (np.asarray(contrast)[..., None] - 1) * fast, -limit, limit))
    return restored
