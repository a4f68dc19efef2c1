"""Does a generator copy its training segments?

A copy need not share a sample with its original: a decoder draws a new waveform, and a shift, a blend or a little noise
hide the old one. What it shares is how strong each band is and when.
"""

from itertools import pairwise

import numpy as np
import torch
from scipy import signal
from tqdm.auto import tqdm

from ...signal import BAND_HZ, band_edges
from .texture_checks import check_textures, in_blocks

#: Bands whose envelopes are compared.
BANDS = 18
#: Modulations up to this rate are compared, Hz: at faster ones a decoder draws envelopes of its own.
RATE_HZ = 4.0
#: This share of real textures of unseen surfaces counts as close to training.
QUANTILE = 0.05
# s at each end of a segment that are faded, and that are left out of envelopes
_TAPER, _TRIM = 0.02, 0.05
# envelope frames per second, and the standard deviation of the Gaussian low-pass of the power, Hz
_FRAME_HZ, _SMOOTHING_HZ = 20.0, 5.0
# least eigenvalue of a cross-spectral matrix that whitening divides by, relative to the mean one
_LEAST_POWER = 0.05
_RESAMPLES = 400


class TrainingEnvelopes:
    """Log envelopes of the training segments, to find out whether a texture follows one of them.

    The overall level does not count. Envelopes are whitened by the mean cross-spectral matrix of the bands at each
    modulation rate, and limited: changes of all bands at once, and a few strong lines, would rule the match. `chunks`
    are arrays (n, samples) of training segments of one length, 0.5 s or more, read one at a time; else a ValueError.
    """

    def __init__(self, chunks, sampling_rate, quiet=True):
        self.sampling_rate, self.samples = float(sampling_rate), None
        envelopes = [self._envelopes(chunk, "chunks") for chunk in tqdm(chunks, disable=quiet, desc="envelopes")]
        if not envelopes:
            raise ValueError("`chunks` must hold at least one array of training segments, got none.")
        envelopes = torch.cat(envelopes)
        self._mean, frames = envelopes.mean((0, 2), keepdim=True), envelopes.shape[-1]
        self._rates = torch.arange(max(2, int(RATE_HZ * 2 * frames / _FRAME_HZ)))  # of a transform twice as long
        lags = torch.arange(-(frames // 2), frames // 2 + 1)
        # overlaps of half a segment and more, weighted so that chance alone gives as much at each lag
        waves = torch.exp(1j * torch.pi / frames * self._rates[:, None] * lags) * (1 - lags.abs() / frames).rsqrt()
        self._lags = torch.cat([waves.real, -waves.imag]).float()
        self._segments = self._spectra(envelopes)
        cross = torch.einsum("nbf,ncf->fbc", self._segments, self._segments.conj()).real / len(envelopes)
        values, vectors = torch.linalg.eigh(cross)
        values = torch.maximum(values, _LEAST_POWER * values.mean(-1, keepdim=True)).clamp_min(1e-12)
        self._whitening = ((vectors * values.rsqrt()[:, None]) @ vectors.mT).to(self._segments.dtype)
        self._segments = self._whitened(self._segments)

    def __len__(self):
        return len(self._segments)

    def _envelopes(self, textures, name):
        textures = check_textures(name, textures, rank=2)
        self.samples = self.samples or textures.shape[-1]
        if textures.shape[-1] != self.samples or self.samples < 0.5 * self.sampling_rate:
            raise ValueError(
                f"`{name}` must have {self.samples} samples, as the first training segments, and last 0.5 s, got "
                f"{textures.shape[-1]}."
            )
        parts = [_log_envelopes(block, self.sampling_rate) for block in in_blocks(textures, 64)]
        return torch.from_numpy(np.concatenate(parts))

    def _spectra(self, envelopes):
        centred = envelopes - self._mean
        centred = centred - centred.mean((1, 2), keepdim=True)
        return torch.fft.rfft(centred, 2 * centred.shape[-1])[..., : len(self._rates)]

    def _whitened(self, spectra):
        whitened = torch.einsum("fbc,ncf->nbf", self._whitening, spectra)
        whitened = whitened / (1 + whitened.abs().square()).sqrt()
        norm = torch.linalg.vector_norm(whitened, dim=(1, 2), keepdim=True)
        return whitened / torch.where(norm > 1e-6, norm, torch.inf)

    def nearest_correlation(self, textures):
        """The largest correlation of the envelopes of textures (n, samples) with those of a training segment at any
        lag: (n,).

        Lags reach to half a segment. 1 = a copy, also if it is scaled, inverted or decoded anew; 0.3 to 0.4 is usual of
        textures of other surfaces; 0 = silence. A ValueError if textures are not finite or of another length than the
        training segments.
        """
        probes, best = self._whitened(self._spectra(self._envelopes(textures, "textures"))), []
        for probe in probes.split(16):
            found = []
            for segments in self._segments.split(512):
                product = torch.einsum("tbf,sbf->tsf", probe, segments.conj())
                found.append((torch.cat([product.real, product.imag], -1) @ self._lags).amax((1, 2)))
            best.append(torch.stack(found).amax(0))
        best = torch.cat(best).double().numpy()
        return np.where(np.any(textures, axis=-1), np.clip(best, 0, 1), 0.0)


def _log_envelopes(textures, sampling_rate):
    """Smoothed log power of each band over time: (n, bands, frames) float32."""
    samples = textures.shape[-1]
    spectra = np.fft.rfft(textures * signal.windows.tukey(samples, 2 * _TAPER * sampling_rate / samples))
    spacing, frames = sampling_rate / samples, round(samples / sampling_rate * _FRAME_HZ)
    smoothing = np.exp(-0.5 * (np.arange(frames // 2 + 1) * spacing / _SMOOTHING_HZ) ** 2)
    edge, envelopes = int(np.ceil(_TRIM * _FRAME_HZ)), []
    for low, high in pairwise(np.ceil(band_edges(BANDS, BAND_HZ) / spacing).astype(int)):
        # a band's bins alone are its complex envelope; so long that slow modulations of its power do not alias
        size = high - low + frames
        power = np.abs(np.fft.ifft(spectra[:, low:high], n=size)) ** 2
        slow = np.fft.rfft(power)[:, : frames // 2 + 1] * smoothing / size
        smooth = np.fft.irfft(slow, n=frames)[:, edge : frames - edge]
        least = 1e-3 * smooth.mean(-1, keepdims=True)
        envelopes.append(np.log(np.maximum(smooth, least) + 1e-30))
    return np.stack(envelopes, 1).astype(np.float32)


def copied_share(values, groups, real_values, real_groups, quantile=QUANTILE, seed=0):
    """Share of textures that are closer to training than nearly all real textures of other, unseen surfaces.

    Real textures get about `quantile` themselves, as each is compared with those of the other surfaces; a copying
    generator gets up to 1. `values` (n,) are `nearest_correlation` of textures generated for the surfaces `groups`
    (n,); `real_values`, `real_groups` (m,) those of real unseen textures of two surfaces and more. Returns the share
    and its 95 % interval, a bootstrap over surfaces of both sets at once. A ValueError if an argument is empty, not
    finite or out of range.
    """
    if not 0 < quantile < 1:
        raise ValueError(f"`quantile` must be between 0 and 1, got {quantile}.")
    values, real = (check_textures(n, v, 1) for n, v in (("values", values), ("real_values", real_values)))
    if len(np.unique(real_groups)) < 2:
        raise ValueError(f"`real_groups` must name two surfaces or more, got {np.unique(real_groups).tolist()}.")
    names, group = np.unique(np.concatenate([groups, real_groups]), return_inverse=True)
    group, real_group = group[: len(values)], group[len(values) :]
    order = np.argsort(-np.asarray(real, np.float64), kind="stable")
    real, real_group = real[order], real_group[order]
    drawn = np.random.default_rng(seed).integers(0, len(names), (_RESAMPLES, len(names)))
    counts = np.stack([np.bincount(row, minlength=len(names)) for row in [np.arange(len(names)), *drawn]]).astype(float)
    close = np.zeros(len(counts))
    for surface in np.unique(group):
        weights = np.where(real_group == surface, 0.0, counts[:, real_group])
        # Weibull's positions k / (n + 1): a new draw exceeds the k-th largest of n others with that probability
        rank = np.maximum(np.floor(quantile * (weights.sum(1, keepdims=True) + 1) + 1e-9), 1)
        place = (weights.cumsum(1) < rank).sum(1)
        threshold = real[np.minimum(place, len(real) - 1)]
        close += counts[:, surface] * (values[group == surface] > threshold[:, None]).sum(1)
    share, *shares = close / np.maximum((counts[:, group]).sum(1), 1)
    low, high = np.quantile(shares, [0.025, 0.975])
    return float(share), (float(min(low, share)), float(max(high, share)))
