"""Errors of textures against references, one number for each texture: pure functions, the last axis is time.

Waveform errors (`snr_db`, `rmse`) reward silence: a silent texture has an SNR of 0 dB and an RMSE of the reference's
RMS, while another take of the same surface, which feels the same, has about -3 dB. Print both beside them.
"""

import numpy as np

from ...signal import BAND_HZ, band_levels_db, level, power_spectral_density, rms
from ...signal.spectra import POWER_FLOOR, periodogram
from .texture_checks import check_pair, check_textures

#: From here on a texture should be empty: the upper edge of the band and 5 % for the slope of its filter, Hz.
OUT_OF_BAND_HZ = 1.05 * BAND_HZ[1]
#: Bands of the signed error in a report, Hz: where lows fade, and where noise appears (paper section 4).
SIGNED_BANDS_HZ = ((20, 60), (60, 150), (150, 400), (400, 650), (650, 1000), (1000, 1200))
#: dB per unit of level, a natural logarithm of RMS.
DB_PER_NEPER = 20 / np.log(10)


def rmse(texture, reference):
    """Root mean square of the difference of two waveforms (..., samples), in their unit: (...,) (the paper's section
    3.1).

    A ValueError if the shapes differ or a value is not finite; so do the other functions of this file.
    """
    texture, reference = check_pair(texture, reference)
    return rms(texture - reference)


def snr_db(texture, reference):
    """Power of the reference over power of the difference of the waveforms, dB: (...,) (the paper's section 3.2).

    Powers below 1e-30 N^2 count as that, so the result is always finite.
    """
    texture, reference = check_pair(texture, reference)
    return _power_db(rms(reference) ** 2) - _power_db(rms(texture - reference) ** 2)


def power_difference(texture, reference):
    """Mean power of a texture minus its reference's, N^2: (...,) (the paper's section 3.2, which drops the sign)."""
    texture, reference = check_pair(texture, reference)
    return rms(texture) ** 2 - rms(reference) ** 2


def level_error_db(texture, reference):
    """How much stronger a texture is than its reference: signed ratio of their RMS, dB: (...,)."""
    texture, reference = check_pair(texture, reference)
    return DB_PER_NEPER * (level(texture) - level(reference))


def log_spectral_distance_db(texture, reference, sampling_rate, band=BAND_HZ):
    """Root mean square over frequency of the difference of the spectra in dB (log-spectral distance): (...,).

    `sqrt(mean_f (10 log10 P1(f) / P2(f))^2)` over Welch's densities (bins of 5 Hz) inside `band`, Hz, of textures
    (..., samples), N.
    """
    difference = np.subtract(*(_power_db(density) for density in _densities(texture, reference, sampling_rate, band)))
    return rms(difference)


def goodness_of_fit(texture, reference, sampling_rate, band=BAND_HZ):
    """Goodness-of-fit coefficient of two spectra after Hernández-Andrés, Romero and Lee (2001), 0 to 1: (...,).

    `|sum_f S1 S2| / sqrt(sum_f S1^2 sum_f S2^2)` with amplitude spectra S inside `band`; 0 where one is silent. It
    ignores gain and is governed by the strongest part of the spectrum: read it beside the nine-band error.
    """
    first, second = (np.sqrt(density) for density in _densities(texture, reference, sampling_rate, band))
    norm = np.sqrt((first**2).sum(-1) * (second**2).sum(-1))
    return (first * second).sum(-1) / np.maximum(norm, POWER_FLOOR)


def signed_band_error_db(texture, reference, sampling_rate, bands):
    """How much stronger a texture (..., samples) is than its reference in each of some bands, dB: (..., bands).

    `bands` are edges in Hz, which may overlap or leave gaps. A ValueError also if one does not lie inside [0,
    sampling_rate / 2].
    """
    texture, reference = check_pair(texture, reference)
    for low, high in bands:
        if not 0 <= low < high <= sampling_rate / 2:
            raise ValueError(f"`bands` must lie inside [0, {sampling_rate / 2:g}] Hz, got ({low:g}, {high:g}).")
    edges = np.unique(bands)
    powers = [10 ** (band_levels_db(signals, sampling_rate, edges) / 10) for signals in (texture, reference)]
    inside = [(edges[:-1] >= low) & (edges[1:] <= high) for low, high in bands]
    levels = [np.stack([10 * np.log10(power[..., own].sum(-1)) for own in inside], -1) for power in powers]
    return levels[0] - levels[1]


def signed_band_key(band):
    """Key of a band's signed error in a report: (20, 60) Hz -> "band_error_db_20_60"."""
    return f"band_error_db_{band[0]}_{band[1]}"


def out_of_band_ratio_db(texture, sampling_rate, low=OUT_OF_BAND_HZ, high=np.inf, floor_db=-120.0):
    """Power between `low` and `high` Hz, where a texture should be empty, over its whole power, dB: (...,).

    `floor_db` is the least that is returned, also for silence; what lies beyond half the sampling rate is empty.
    """
    texture = check_textures("texture", texture).astype(np.float64)
    frequencies, power = periodogram(texture, sampling_rate)
    outside = power[..., (frequencies >= low) & (frequencies < high)].sum(-1)
    ratio = outside / np.maximum(power.sum(-1), POWER_FLOOR)
    return 10 * np.log10(np.maximum(ratio, 10 ** (floor_db / 10)))


def _power_db(power):
    return 10 * np.log10(np.maximum(power, POWER_FLOOR))


def _densities(texture, reference, sampling_rate, band):
    """Welch's densities of both inside `band`: two arrays (..., bins)."""
    texture, reference = check_pair(texture, reference)
    frequencies, density = power_spectral_density(texture, sampling_rate)
    inside = (frequencies >= band[0]) & (frequencies <= band[1])
    if not inside.any():
        raise ValueError(
            f"`texture` of {texture.shape[-1]} samples at {sampling_rate:g} Hz has no frequency bin inside "
            f"{tuple(band)} Hz. Give a longer signal or another band."
        )
    return density[..., inside], power_spectral_density(reference, sampling_rate)[1][..., inside]
