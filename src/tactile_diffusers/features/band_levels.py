"""Band levels over time: measured on a waveform, and imposed on one that a decoder got slightly wrong.

A few solver steps and a lossy latent leave every band of a decoded texture a decibel or two off. What the finger feels
most is the energy in each band, so it is kept as numbers beside the waveform's shape and restored after decoding, as
the CELT layer of the Opus codec keeps the energy of its bands (Valin et al. 2013, arXiv 1602.04845).
"""

from functools import lru_cache

import numpy as np
import torch

from ..signal import band_edges

#: Length of the Hann kernel that smooths powers over time, s: fast modulation stays the decoder's.
SMOOTHING_SECONDS = 0.4
#: Powers relative to white noise of unit RMS below which a band counts as silent.
POWER_FLOOR = 1e-6
#: Times that gains are corrected, on the powers of one transform: they overlap in time, so one time falls short. What
#: the synthesis smears over neighbouring bins stays: 0.043 dB in nine bands, where three transforms leave 0.041.
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


def band_sums(gains, sampling_rate, band, count, window):
    """Power of each band of white noise of unit RMS after gains of power (bins,): (count + 1,) float64."""
    members, _ = _members(sampling_rate, tuple(band), count, window)
    return np.bincount(members, gains, minlength=count + 1) / len(members)


def smoothing_kernel(rate):
    """Hann kernel of `SMOOTHING_SECONDS`, of unit sum and odd length, for so many values a second: (n,) float64."""
    half = max(1, round(SMOOTHING_SECONDS * rate / 2))
    kernel = np.hanning(2 * half + 1)[1:-1]
    return kernel / kernel.sum()


class _Grid:
    """Band levels on one grid of windows; its tensors are those of one dtype.

    PyTorch's transforms are several times as fast as SciPy's in float32 and let other threads run.
    """

    def __init__(self, sampling_rate, band, count, window, hop, dtype):
        members, shares = _members(sampling_rate, tuple(band), count, window)
        self.window, self.hop, self.members = window, hop, torch.from_numpy(members)
        self.hann = torch.hann_window(window, dtype=dtype)
        #: from power of bins to power of bands over that of white noise of unit RMS
        self.sums = torch.zeros(count + 1, len(members), dtype=dtype)
        self.sums[self.members, torch.arange(len(members))] = 1
        self.sums /= torch.from_numpy(shares)[:, None] * len(members) * self.hann.square().sum()
        self.smoothing = torch.from_numpy(smoothing_kernel(sampling_rate / hop)).to(dtype)

    def transform(self, waveform):
        """(batch, samples) -> (batch, bins, samples / hop + 1) complex."""
        half = self.window // 2
        padded = np.pad(waveform, ((0, 0), (half, half)), mode="reflect")  # also where a waveform is shorter than that
        padded = torch.from_numpy(padded).to(self.hann.dtype)
        return torch.stft(padded, self.window, self.hop, window=self.hann, center=False, return_complex=True)

    def invert(self, transform, samples):
        """Undoes `transform`."""
        return torch.istft(transform, self.window, self.hop, window=self.hann, length=samples).numpy()

    def powers(self, transform):
        """(batch, bins, frames + 1) -> (batch, bands, frames + 1): power over white noise's, at the edges of hops."""
        return self.sums @ (transform.real.square() + transform.imag.square())

    def log_powers(self, power, smooth=True):
        """(batch, bands, frames + 1) of `powers` -> (batch, bands, frames), natural log."""
        power = 0.5 * (power[..., 1:] + power[..., :-1])  # from the edges of hops to their middles
        if smooth:
            half = len(self.smoothing) // 2
            padded = torch.nn.functional.pad(power, (half, half), mode="replicate").flatten(0, 1)[:, None]
            power = torch.nn.functional.conv1d(padded, self.smoothing[None, None]).view_as(power)
        return torch.log(power + POWER_FLOOR)

    def fast_modulation(self, power):
        """What the window resolves and the smoothing does not."""
        return self.log_powers(power, smooth=False) - self.log_powers(power)

    @staticmethod
    def factors(gains):
        """(batch, bands, frames) natural logs of amplitude -> factors (batch, bands, frames + 1), at edges of hops."""
        edges = torch.nn.functional.pad(gains, (1, 1), mode="replicate")
        return torch.exp(0.5 * (edges[..., 1:] + edges[..., :-1]))

    def amplify(self, transform, factors):
        """Bins multiplied by the factors of their bands."""
        # real times complex would be computed as complex times complex
        return torch.view_as_complex(torch.view_as_real(transform) * factors[:, self.members, :, None])


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
    grid = _Grid(sampling_rate, band, count, window, hop, torch.float64)
    return grid.log_powers(grid.powers(grid.transform(np.asarray(waveform)))).numpy()


def measure_fast_modulation(waveform, sampling_rate, band, count, window, hop):
    """How band levels depart from their smooth course: what the window resolves, faster than `SMOOTHING_SECONDS`.

    Arguments are those of `measure_band_levels`.

    Returns:
        `np.ndarray`: (batch, count + 1, samples / hop) float64, difference of natural logs of power.
    """
    grid = _Grid(sampling_rate, band, count, window, hop, torch.float64)
    return grid.fast_modulation(grid.powers(grid.transform(np.asarray(waveform)))).numpy()


def impose_band_levels(waveform, levels, sampling_rate, band, window, hop, modulation_gain=None):
    """Gives a waveform the band levels that it should have, by slowly varying gains.

    Args:
        waveform (`np.ndarray`): (batch, samples), a multiple of `hop` samples.
        levels (`np.ndarray`): (batch, count + 1, samples / hop), as `measure_band_levels` returns them.
        sampling_rate, band, window, hop: as for `measure_band_levels`.
        modulation_gain (`np.ndarray`, *optional*): (batch, count + 1), factors by which each band's fast modulation
            (`measure_fast_modulation`) is deepened afterwards, in log power.

    Returns:
        `np.ndarray`: (batch, samples) float32.
    """
    waveform = np.asarray(waveform, dtype=np.float32)
    grid = _Grid(sampling_rate, band, levels.shape[1] - 1, window, hop, torch.float32)
    levels = torch.as_tensor(np.asarray(levels), dtype=torch.float32)
    limit, gains = LARGEST_GAIN_DB * np.log(10) / 20, torch.zeros_like(levels)
    transform = grid.transform(waveform)
    power = grid.powers(transform)
    for _ in range(PASSES):
        restored = power * grid.factors(gains).square()
        gains = torch.clamp(gains + 0.5 * (levels - grid.log_powers(restored)), -limit, limit)
    if modulation_gain is not None:
        deepened = torch.as_tensor(np.asarray(modulation_gain), dtype=torch.float32)[..., None] - 1
        restored = power * grid.factors(gains).square()
        gains = torch.clamp(gains + 0.5 * deepened * grid.fast_modulation(restored), -limit, limit)
    return grid.invert(grid.amplify(transform, grid.factors(gains)), waveform.shape[-1])
