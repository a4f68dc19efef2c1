"""The fits behind the baselines: spectral envelopes, Gaussian noise under them, and the regression on ratings."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import pandas
from scipy import fft, linalg
from scipy.interpolate import make_interp_spline
from sklearn import linear_model

from tactile_diffusers.evaluation.metrics.distances import covariance_root
from tactile_diffusers.evaluation.metrics.errors import OUT_OF_BAND_HZ
from tactile_diffusers.evaluation.metrics.texture_checks import in_blocks
from tactile_diffusers.signal import (
    BAND_HZ,
    WORKING_RATE,
    band_edges,
    band_levels_db,
    power_spectral_density,
    resample,
    rms,
)
from tactile_diffusers.signal.spectra import POWER_FLOOR

LPC_ORDER = 20
#: White noise under the autocorrelation, as a share of its power (-60 dB): what a filter leaves empty makes the normal
#: equations singular.
LPC_RIDGE = 1e-6
_TINY = np.finfo(np.float64).tiny


@dataclass(frozen=True)
class Grid:
    """The frequency bins of a texture of some samples inside its band, Hz, and noise made of them, periodic and empty
    elsewhere.
    """

    samples: int
    sampling_rate: float
    band: tuple[float, float] = BAND_HZ

    @cached_property
    def bins(self):
        """Indices of the bins inside the band, its upper edge left out: (bins,)."""
        frequencies = np.fft.rfftfreq(self.samples, 1 / self.sampling_rate)
        return np.flatnonzero((frequencies >= self.band[0]) & (frequencies < self.band[1]))

    @property
    def end(self):
        """Hz from which a texture should be empty, as `out_of_band_ratio_db` has it."""
        return self.band[1] * OUT_OF_BAND_HZ / BAND_HZ[1]

    @cached_property
    def frequencies(self):
        """Their frequencies in Hz: (bins,)."""
        return self.bins * self.sampling_rate / self.samples

    def noise(self, density, rng, level=None):
        """Gaussian noise of a power spectral density (n, bins), N^2/Hz, and an RMS (n,), N: (n, samples) float64.

        `level`, the RMS, is by default what the density adds up to. The first rows do not depend on how many follow.
        """
        if level is None:
            level = np.sqrt(density.sum(-1) * self.sampling_rate / self.samples)
        parts = rng.standard_normal((len(density), len(self.bins), 2)).view(np.complex128)[..., 0]
        spectra = np.zeros((len(density), self.samples // 2 + 1), dtype=np.complex128)
        spectra[:, self.bins] = parts * np.sqrt(density / np.maximum(density.max(-1, keepdims=True), _TINY))
        noise = fft.irfft(spectra, n=self.samples, axis=-1)
        return noise * (level / np.maximum(rms(noise), _TINY))[:, None]

    def interpolate_db(self, frequencies, decibels):
        """Density (n, bins) at the bins from decibels (n, points) at `frequencies`: see `interpolate_db`."""
        return 10 ** (interpolate_db(frequencies, decibels, self.frequencies) / 10)


def interpolate_db(frequencies, decibels, wanted):
    """Decibels (n, wanted) at other frequencies: linear over log frequency, flat beyond the ends."""
    line = make_interp_spline(np.log(frequencies), decibels, k=1, axis=-1)
    return line(np.log(np.clip(wanted, frequencies[0], frequencies[-1])))


def in_chunks(function, textures):
    """`function` of some hundred textures at a time, which bounds the memory, concatenated: (m, ...)."""
    return np.concatenate([function(rows) for rows in in_blocks(textures)])


def spectrum_db(textures, grid):
    """Frequencies (points,) in Hz, 5 Hz apart, and Welch's density (m, points), dB re 1 N^2/Hz, inside the band."""
    rate = grid.sampling_rate
    frequencies = power_spectral_density(textures[:1], rate)[0]
    inside = (frequencies >= grid.band[0]) & (frequencies <= grid.band[1])
    density = in_chunks(lambda rows: power_spectral_density(rows, rate)[1][:, inside], textures)
    return frequencies[inside], 10 * np.log10(np.maximum(density, POWER_FLOOR))


def nine_band_levels_db(textures, grid):
    """Levels in the nine bands of the grid's band: (m, 9), dB re 1 N^2."""
    edges = band_edges(9, grid.band)
    return in_chunks(lambda rows: band_levels_db(rows, grid.sampling_rate, edges), textures)


def lpc_density(textures, grid, order=LPC_ORDER):
    """Power spectra (n, bins) of autoregressive models: `1 / |1 - sum_k a_k exp(-2 pi i k f / rate)|^2`.

    Linear prediction by the autocorrelation method at `WORKING_RATE`: at 10 kHz the poles would go to the empty part.
    """
    rate = min(grid.sampling_rate, WORKING_RATE)
    rows = in_chunks(lambda part: _autocorrelation(resample(part, grid.sampling_rate, rate), order + 1), textures)
    rows[:, 0] = rows[:, 0] * (1 + LPC_RIDGE) + POWER_FLOOR
    coefficients = np.stack([linalg.solve_toeplitz(row[:-1], row[1:]) for row in rows])
    delays = np.exp(-2j * np.pi / rate * np.arange(1, order + 1)[:, None] * grid.frequencies)
    return 1 / np.abs(1 - coefficients @ delays) ** 2


def _autocorrelation(textures, lags):
    """Biased estimates at the first lags: (n, lags), N^2."""
    samples = textures.shape[-1]
    power = np.abs(fft.rfft(textures, n=2 * samples, axis=-1)) ** 2
    return fft.irfft(power, axis=-1)[:, :lags] / samples


def nine_band_density(levels_db, grid, iterations=20):
    """Smooth power spectra (n, bins), N^2/Hz, with given levels (n, 9), dB re 1 N^2, in the nine bands.

    Linear in dB over log frequency between band centres. The levels at the centres are shifted until each band holds
    its power; each of the `iterations` halves what is missing.
    """
    edges = band_edges(levels_db.shape[-1], grid.band)
    centres = np.sqrt(edges[:-1] * edges[1:])
    members = np.stack([(grid.frequencies >= low) & (grid.frequencies < high) for low, high in pairwise(edges)], -1)
    width = grid.sampling_rate / grid.samples
    anchors = levels_db - 10 * np.log10(members.sum(0) * width)
    for _ in range(iterations):
        held = 10 * np.log10(grid.interpolate_db(centres, anchors) @ members * width)
        anchors = anchors + levels_db - held
    return grid.interpolate_db(centres, anchors)


def ridge_fit(inputs, targets, penalty):
    """Ridge regression of targets (surfaces,), NaN left out, on inputs (surfaces, 3): a function of inputs."""
    known = np.isfinite(targets)
    if not known.any():
        return lambda inputs: np.full(len(inputs), np.nan)
    return linear_model.Ridge(penalty).fit(inputs[known], targets[known]).predict


def draw_missing(values, mean, covariance, normal):
    """Fills NaN in values (n, d) by draws from a Gaussian given the row's known values; normal (n, d) is the noise."""
    offsets = values - mean
    for pattern in np.unique(np.isnan(values), axis=0):
        rows = np.flatnonzero((np.isnan(values) == pattern).all(-1))
        missing, known = np.flatnonzero(pattern), np.flatnonzero(~pattern)
        cross = covariance[np.ix_(missing, known)]
        gain = cross @ np.linalg.pinv(covariance[np.ix_(known, known)])
        left = covariance[np.ix_(missing, missing)] - gain @ cross.T
        drawn = offsets[np.ix_(rows, known)] @ gain.T + normal[np.ix_(rows, missing)] @ covariance_root(left)
        offsets[np.ix_(rows, missing)] = drawn
    return mean + offsets


def surface_means(values, surface_ids):
    """Mean over the segments of each surface, in the order of their ids, NaN left out: (surfaces, ...)."""
    values = np.asarray(values, dtype=np.float64)
    means = pandas.DataFrame(values.reshape(len(values), -1)).groupby(np.asarray(surface_ids)).mean().to_numpy()
    return means.reshape(-1, *values.shape[1:])
