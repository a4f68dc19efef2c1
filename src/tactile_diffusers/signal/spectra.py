"""Spectra and band levels: pure functions on arrays whose last axis is time."""

import numpy as np
from scipy import signal

from .constants import BAND_HZ

#: Floor of powers in logarithms (N^2): 1e-30 N^2 is far below any sensor.
POWER_FLOOR = 1e-30


def rms(texture):
    """Root mean square along the last axis, in the unit of `texture`."""
    return np.sqrt(np.mean(np.square(np.asarray(texture, dtype=np.float64)), axis=-1))


def level(texture):
    """Natural logarithm of the RMS in N: the level of a texture, as loudness is perceived: by ratios."""
    return 0.5 * np.log(np.maximum(np.square(rms(texture)), POWER_FLOOR))


def power_spectral_density(texture, sampling_rate, window_seconds=0.2):
    """Welch's power spectral density along the last axis.

    Args:
        texture (`np.ndarray`): (..., samples), N.
        sampling_rate (`float`): Hz.
        window_seconds (`float`): length of the Hann windows; 0.2 s gives bins of 5 Hz.

    Returns:
        `tuple[np.ndarray, np.ndarray]`: frequencies (bins,) in Hz and density (..., bins) in N^2/Hz.
    """
    texture = np.asarray(texture, dtype=np.float64)
    window = min(texture.shape[-1], int(round(window_seconds * sampling_rate)))
    return signal.welch(texture, fs=sampling_rate, nperseg=window, axis=-1)


def periodogram(texture, sampling_rate):
    """Periodogram of the whole signal along the last axis, without its mean (Hann window).

    As `scipy.signal.periodogram`, in half of its time.

    Returns:
        `tuple[np.ndarray, np.ndarray]`: frequencies (bins,) in Hz and density (..., bins) in N^2/Hz.
    """
    texture = np.asarray(texture, dtype=np.float64)
    samples = texture.shape[-1]
    window = signal.get_window("hann", samples)
    spectrum = np.fft.rfft((texture - texture.mean(-1, keepdims=True)) * window)
    power = np.square(spectrum.real) + np.square(spectrum.imag)
    power[..., 1 : (samples + 1) // 2] *= 2  # all bins but those that have no negative twin
    return np.fft.rfftfreq(samples, 1 / sampling_rate), power / (sampling_rate * np.square(window).sum())


def band_edges(count=9, band=BAND_HZ):
    """Edges of `count` logarithmic bands in Hz: (count + 1,). Nine bands as in arXiv 2605.23804; the edges are ours."""
    return np.geomspace(band[0], band[1], count + 1)


def band_levels_db(texture, sampling_rate, edges=None):
    """Level of each band in dB re 1 N^2, from the periodogram of the whole signal (Hann window).

    Args:
        texture (`np.ndarray`): (..., samples), N.
        sampling_rate (`float`): Hz.
        edges (`np.ndarray`, *optional*, defaults to the nine bands): (bands + 1,) Hz.

    Returns:
        `np.ndarray`: (..., bands), dB.

    Raises:
        ValueError: if the signal is too short for a band to hold a frequency bin.
    """
    edges = band_edges() if edges is None else np.asarray(edges, dtype=np.float64)
    texture = np.asarray(texture)
    frequencies, power = periodogram(texture, sampling_rate)
    width = sampling_rate / texture.shape[-1]
    members = [(frequencies >= low) & (frequencies < high) for low, high in zip(edges[:-1], edges[1:], strict=True)]
    if not all(member.any() for member in members):
        raise ValueError(
            f"`texture` of {texture.shape[-1]} samples at {sampling_rate} Hz is too short: its bins of {width:.3g} Hz "
            f"leave a band of {np.round(edges, 1).tolist()} Hz empty. Give a longer signal or wider bands."
        )
    bands = np.stack([power[..., member].sum(-1) * width for member in members], axis=-1)
    return 10 * np.log10(np.maximum(bands, POWER_FLOOR))


def nine_band_error_db(texture, reference, sampling_rate, edges=None):
    """Mean absolute difference of the band levels of two textures, dB: (...,). Symmetric in its arguments."""
    difference = band_levels_db(texture, sampling_rate, edges) - band_levels_db(reference, sampling_rate, edges)
    return np.abs(difference).mean(-1)
