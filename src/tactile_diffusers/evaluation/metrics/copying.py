"""Does a generator copy its training segments?"""

import numpy as np
import torch
from scipy.fft import next_fast_len
from tqdm.auto import tqdm

from .texture_checks import check_sets, check_textures, in_blocks

#: Band in which waveforms are compared, Hz. A low upper edge keeps lags resolved at a low rate, which makes this fast.
COPY_BAND_HZ = (20.0, 400.0)
# lags per period of the band's upper edge: 0.35 ms at 400 Hz
_LAGS_PER_PERIOD = 7.2
# width over which the mean spectrum is smoothed, Hz: a rough one, as of few segments, would make whitening ring
_SMOOTHING_HZ = 10.0
# least amplitude of the mean spectrum that whitening divides by, relative to its largest (60 dB)
_SPECTRUM_FLOOR = 1e-3
# least energy of an overlapping part, relative to the whole segment (a stationary texture has at least a half): what
# is left beside a burst is the ringing of the burst, which resembles that of others
_ENERGY_FLOOR = 0.1
# training segments that are correlated at once: their transforms stay in the processor's cache
_SEGMENTS = 64


class TrainingWaveforms:
    """The training segments as whitened spectra, to find out whether a texture is a copy of one of them.

    Each segment is brought to unit energy in the band and divided by the smoothed mean amplitude spectrum of the set:
    otherwise slow components, which are strong and look alike in all textures, would rule the correlation. Only the
    bins of the band are kept, as complex64: 157 MB for 21,000 segments of 1.64 s in 20-400 Hz.

    Args:
        chunks (`Iterable[np.ndarray]`): arrays (n, samples) of training segments of one length, any unit; they are
            read once, one at a time.
        sampling_rate (`float`): Hz.
        band (`tuple[float, float]`): Hz.
        quiet (`bool`): no progress bars.

    Raises:
        ValueError: if a chunk is not (n, samples), not finite or of another length than the first, there is no chunk,
            or the band does not lie inside (0, sampling_rate / 2) or holds no frequency bin.
    """

    def __init__(self, chunks, sampling_rate, band=COPY_BAND_HZ, quiet=True):
        if not 0 < band[0] < band[1] < sampling_rate / 2:
            raise ValueError(f"`band` must satisfy 0 < low < high < {sampling_rate / 2:g} Hz, got {tuple(band)}.")
        self.sampling_rate, self.band, self.quiet = float(sampling_rate), tuple(band), quiet
        self.samples, spectra = None, []
        for chunk in tqdm(chunks, disable=quiet, desc="training waveforms"):
            chunk = check_textures("chunks", chunk, rank=2)
            if self.samples is None:
                self._set_grid(chunk.shape[-1])
            spectra.append(_unit_energy(self._spectra(chunk, "chunks")))
        if not spectra:
            raise ValueError("`chunks` must hold at least one array of training segments, got none.")
        self._whitening = self._whitening_gain(sum(chunk.abs().sum(0, dtype=torch.float64) for chunk in spectra))
        self._segments = torch.cat(spectra).mul_(self._whitening)

    def __len__(self):
        return len(self._segments)

    def _set_grid(self, samples):
        """Sizes: of the transform at the full rate, of that at the rate of the lags, of a segment at that rate."""
        self.samples = samples
        # half a segment of zeros is enough to keep apart the lags that are looked at
        self._padded = next_fast_len(-(-3 * samples // 2), real=True)
        spacing = self.sampling_rate / self._padded
        self._bins = slice(int(np.ceil(self.band[0] / spacing)), int(self.band[1] / spacing) + 1)
        if self._bins.stop <= self._bins.start:
            raise ValueError(
                f"`chunks` of {samples} samples at {self.sampling_rate:g} Hz have no frequency bin inside {self.band} "
                "Hz. Give longer segments or a wider band."
            )
        self._size = next_fast_len(int(np.ceil(_LAGS_PER_PERIOD * self.band[1] / spacing)), real=True)
        self._length = -(-samples * self._size // self._padded)

    def _spectra(self, textures, name):
        """The band's bins of zero-padded textures: (n, bins) complex64."""
        if textures.shape[-1] != self.samples:
            raise ValueError(
                f"`{name}` must have {self.samples} samples, as the first training segments, got {textures.shape[-1]}."
            )
        rows = torch.as_tensor(np.ascontiguousarray(textures, dtype=np.float32))
        return torch.fft.rfft(rows, self._padded)[:, self._bins].clone()

    def _whitening_gain(self, amplitude):
        """What flattens an amplitude spectrum (bins,), up to a factor."""
        width = int(_SMOOTHING_HZ * self._padded / self.sampling_rate / 2)  # bins to either side
        amplitude = torch.nn.functional.avg_pool1d(
            amplitude[None], 2 * width + 1, stride=1, padding=width, count_include_pad=False
        )[0]
        amplitude = amplitude / amplitude.max().clamp_min(torch.finfo(torch.float64).tiny)
        return amplitude.clamp_min(_SPECTRUM_FLOOR).reciprocal().float()

    def _overlap_gain(self, spectra):
        """1 / root of the energy that overlaps at each lag 0, 1, ..., -1; 0 beyond half a segment: (n, size)."""
        signals = torch.fft.irfft(self._full_spectrum(spectra), self._size)[:, : self._length].double()
        energy = torch.nn.functional.pad(signals.square().cumsum(-1), (1, 0))  # of the first k samples, k = 0, 1, ...
        whole, half = energy[:, -1:], self._length // 2
        overlapping = energy.new_full((len(energy), self._size), torch.inf)
        overlapping[:, : half + 1] = whole - energy[:, : half + 1]
        overlapping[:, self._size - half :] = energy[:, self._length - half : -1]
        gain = torch.maximum(overlapping, _ENERGY_FLOOR * whole).rsqrt()
        return torch.where(whole > 0, gain, 0.0).float()

    def _full_spectrum(self, spectra):
        """Bins of the band put where the transform of the low rate expects them: (n, size / 2 + 1)."""
        full = spectra.new_zeros(len(spectra), self._size // 2 + 1)
        full[:, self._bins] = spectra
        return full

    def nearest_correlation(self, textures):
        """The largest absolute normalised cross-correlation of each texture with any training segment at any lag.

        Lags reach to plus and minus half a segment, in steps of at most 0.35 ms at an upper edge of 400 Hz. The
        correlation is divided by the root of the energies of both overlapping parts, each counted as at least a tenth
        of its whole. A copy gives 1, also if it is scaled or inverted, and above 0.95 if it is shifted. Independent
        noise of 1.64 s stays near 0.2; periodic surfaces resemble each other more, so judge the values by those of
        real test segments (`closer_share`). A texture takes about half a second against 21,000 segments on one core.

        Args:
            textures (`np.ndarray`): (n, samples), of the length and sampling rate of the training segments, any unit.

        Returns:
            `np.ndarray`: (n,) float64, 0 to 1; 0 for silence.

        Raises:
            ValueError: if `textures` is not (n, samples), not finite or of another length.
        """
        textures = check_textures("textures", textures, rank=2)
        probes = _unit_energy(self._spectra(textures, "textures") * self._whitening)
        gains = self._overlap_gain(probes)
        best = torch.zeros(len(textures), dtype=torch.float64)
        # every training segment meets every texture while its own energies are at hand
        for segments in tqdm(self._segments.split(_SEGMENTS), disable=self.quiet, desc="nearest training segment"):
            # what is a positive lag to the texture is a negative one to the segment
            segment_gains = self._overlap_gain(segments).flip(-1).roll(1, -1)
            product = self._full_spectrum(segments)
            for row, (probe, gain) in enumerate(zip(probes, gains, strict=True)):
                torch.mul(segments.conj(), probe, out=product[:, self._bins])
                correlation = torch.fft.irfft(product, self._size)
                best[row] = max(best[row], correlation.mul_(segment_gains).mul_(gain).abs_().max())
        # ringing at the ends of the segment lies outside of the energies: a part in a thousand
        return best.clamp_max(1.0).numpy()


def _unit_energy(spectra):
    """Spectra of unit sum of squares; silence stays silence."""
    norm = torch.linalg.vector_norm(spectra, dim=-1, keepdim=True)
    return spectra / torch.where(norm > 0, norm, 1.0)


def nearest_distance(points, reference):
    """Euclidean distance (n,) of each point (n, features) to the nearest of a reference (m, features).

    Points are embeddings or flattened latents; the distance is exactly 0 for a point of the reference.

    Raises:
        ValueError: if the sets do not fit together, are empty, or hold NaN or infinity.
    """
    points, reference = check_sets(points=points, reference=reference)
    centre = reference.mean(0)  # large offsets would cost digits below
    centred = reference - centre
    norms = (centred**2).sum(-1)
    distances = []
    for block in in_blocks(points):
        # |r|^2 - 2 p.r orders the reference as the distance does, and is one matrix product: fast, but it loses digits
        nearest = (norms - 2 * (block - centre) @ centred.T).argmin(-1)
        distances.append(np.linalg.norm(block - reference[nearest], axis=-1))
    return np.concatenate(distances)


def closer_share(values, real_values, quantile=0.01, higher_is_closer=False):
    """Share of textures that are closer to the training set than nearly all real ones are.

    The threshold is the `quantile` of the values of real textures that the generator has not seen. An honest
    generator gives about `quantile`, one that copies gives up to 1. From `n` independent real values the share that
    an honest generator gets scatters by `sqrt(quantile / n)`: a first percentile needs at least 100 of them.

    Args:
        values (`np.ndarray`): (n,) `nearest_distance` or `TrainingWaveforms.nearest_correlation` of generated textures.
        real_values (`np.ndarray`): (m,) the same of real textures outside of the training set.
        quantile (`float`): between 0 and 1.
        higher_is_closer (`bool`): true for correlations, false for distances.

    Returns:
        `tuple[float, float]`: share, 0 to 1, and threshold, in the unit of the values.

    Raises:
        ValueError: if an argument is empty, of another rank, not finite, or `quantile` is out of range.
    """
    if not 0 < quantile < 1:
        raise ValueError(f"`quantile` must be between 0 and 1, got {quantile}.")
    values = check_textures("values", values, rank=1).astype(np.float64)
    real_values = check_textures("real_values", real_values, rank=1).astype(np.float64)
    sign = -1.0 if higher_is_closer else 1.0
    # Weibull's positions k / (n + 1): a new draw falls below the k-th of n others with that probability
    threshold = np.quantile(sign * real_values, quantile, method="weibull")
    return float((sign * values < threshold).mean()), float(sign * threshold)
