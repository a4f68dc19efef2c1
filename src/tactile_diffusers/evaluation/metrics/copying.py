"""Does a generator copy its training segments, does it cover the real ones, and do its takes differ?"""

import numpy as np
import torch
from scipy.fft import next_fast_len
from scipy.spatial.distance import cdist

from .texture_checks import check_textures

#: Band in which waveforms are compared, Hz. A low upper edge keeps lags resolved at a low rate, which makes this fast.
COPY_BAND_HZ = (20.0, 400.0)
#: Standard deviation over all three ratings of the kernel by which real surfaces count as alike, z-scores.
RATING_WIDTH = 0.3
#: Fewest effective real surfaces near a rating for its spread to be known.
FEWEST_NEAR = 20
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
# rows of a distance matrix that are held at once
_ROWS = 256


class TrainingWaveforms:
    """The training segments as whitened spectra, to find out whether a texture is a copy of one of them.

    Each segment is brought to unit energy in the band and divided by the smoothed mean amplitude spectrum of the set:
    otherwise slow components, which are strong and look alike in all textures, would rule the correlation. Only the
    bins of the band are kept, as complex64: 157 MB for 21,000 segments of 1.64 s in 20-400 Hz. The result does not
    depend on the order or the chunks of the segments.

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
        from tqdm.auto import tqdm

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
        """1 / root of the energy of the part that overlaps at each lag, 0 for lags beyond half a segment: (n, size).

        Ordered as the correlations from the transform: lags 0, 1, ..., then the negative ones up to -1. At a positive
        lag the end of the signal overlaps, at a negative one its beginning.
        """
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
        of its whole. A copy gives 1, also if it is scaled or inverted, and above 0.95 if it is shifted and its lag
        falls between two steps. Independent noise of 1.64 s stays near 0.2; periodic surfaces resemble each other
        more, so judge the values by those of real test segments (`closer_share`). A texture takes about half a second
        against 21,000 segments on one core.

        Args:
            textures (`np.ndarray`): (n, samples), of the length and sampling rate of the training segments, any unit.

        Returns:
            `np.ndarray`: (n,) float64, 0 to 1; 0 for silence.

        Raises:
            ValueError: if `textures` is not (n, samples), not finite or of another length.
        """
        from tqdm.auto import tqdm

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
    """Euclidean distance of each point to the nearest point of a reference: embeddings, or flattened latents.

    Args:
        points (`np.ndarray`): (n, features).
        reference (`np.ndarray`): (m, features), the training set.

    Returns:
        `np.ndarray`: (n,) float64, exactly 0 for a point of the reference.

    Raises:
        ValueError: if the sets do not fit together, are empty, or hold NaN or infinity.
    """
    points, reference = _check_sets("points", points, "reference", reference)
    centre = reference.mean(0)  # large offsets would cost digits below
    centred = reference - centre
    norms = (centred**2).sum(-1)
    distances = []
    for block in _blocks(points):
        # |r|^2 - 2 p.r orders the reference as the distance does, and is one matrix product: fast, but it loses digits
        nearest = (norms - 2 * (block - centre) @ centred.T).argmin(-1)
        distances.append(np.linalg.norm(block - reference[nearest], axis=-1))
    return np.concatenate(distances)


def closer_share(values, real_values, quantile=0.01, higher_is_closer=False):
    """Share of textures that are closer to the training set than nearly all real ones are.

    The threshold is the `quantile` of the values of real textures that the generator has not seen. An honest
    generator gives about `quantile`, one that copies gives up to 1. From `n` independent real values the share that
    an honest generator gets scatters by `sqrt(quantile / n)`: a first percentile needs at least 100 of them to exist
    (with fewer the threshold is the smallest), and 1000 to be good to a third of itself.

    Args:
        values (`np.ndarray`): (n,) `nearest_distance` or `TrainingWaveforms.nearest_correlation` of generated textures.
        real_values (`np.ndarray`): (m,) the same of real textures outside of the training set.
        quantile (`float`): between 0 and 1.
        higher_is_closer (`bool`): true for correlations, false for distances.

    Returns:
        `tuple[float, float]`: share, 0 to 1, and threshold, in the unit of the values.

    Raises:
        ValueError: if an argument is empty, of another rank, or holds NaN or infinity, or `quantile` is out of range.
    """
    if not 0 < quantile < 1:
        raise ValueError(f"`quantile` must be between 0 and 1, got {quantile}.")
    values = check_textures("values", values, rank=1).astype(np.float64)
    real_values = check_textures("real_values", real_values, rank=1).astype(np.float64)
    sign = -1.0 if higher_is_closer else 1.0
    # Weibull's positions k / (n + 1): a new draw falls below the k-th of n others with that probability
    threshold = np.quantile(sign * real_values, quantile, method="weibull")
    return float((sign * values < threshold).mean()), float(sign * threshold)


def precision_recall(generated, real, k=5):
    """Improved precision and recall of two sets of embeddings (Kynkäänniemi et al. 2019, arXiv 1904.06991).

    Around each member of a set lies a ball that reaches to its k-th nearest other member. Precision is the share of
    generated members inside a ball of a real one (are they plausible?), recall the share of real members inside a ball
    of a generated one (does the generator cover them?). Both depend on the sizes of the sets, and two sets of one
    distribution do not reach 1: compare with two real sets of the same sizes.

    Args:
        generated, real (`np.ndarray`): (n, features), (m, features); more than `k` members each.
        k (`int`): neighbours.

    Returns:
        `tuple[float, float]`: precision and recall, 0 to 1.

    Raises:
        ValueError: if the sets do not fit together, hold NaN or infinity or too few members, or `k` is below 1.
    """
    generated, real = _check_sets("generated", generated, "real", real)
    if not 1 <= k < min(len(generated), len(real)):
        raise ValueError(
            f"`k` must be at least 1 and below the size of both sets, {len(generated)} and {len(real)}, got {k}."
        )
    return _covered(generated, real, k), _covered(real, generated, k)


def _covered(points, members, k):
    """Share of points that lie in a ball of a member."""
    # the nearest member to a member is itself
    radii = np.concatenate([np.partition(cdist(block, members), k, axis=-1)[:, k] for block in _blocks(members)])
    return float(np.mean(np.concatenate([(cdist(block, members) <= radii).any(-1) for block in _blocks(points)])))


def take_spread_db(band_levels, groups):
    """How much takes of one surface, or of one rating, differ: standard deviation of their band levels, dB.

    For each band the unbiased variance inside the groups, pooled over the groups of two takes and more; the mean over
    bands of its root.

    Args:
        band_levels (`np.ndarray`): (n, bands), dB (`tactile_diffusers.signal.band_levels_db`).
        groups (`np.ndarray`): (n,) the surface or rating of each take.

    Returns:
        `float`: dB.

    Raises:
        ValueError: if the arguments do not fit together, hold NaN or infinity, or no group has two takes.
    """
    band_levels = check_textures("band_levels", band_levels, rank=2).astype(np.float64)
    groups = np.asarray(groups)
    if groups.shape != band_levels.shape[:1]:
        raise ValueError(
            f"`groups` must name the group of each of the {len(band_levels)} rows of `band_levels`, "
            f"got the shape {groups.shape}."
        )
    _, group, takes = np.unique(groups, return_inverse=True, return_counts=True)
    freedom = (takes - 1).sum()
    if freedom == 0:
        raise ValueError(f"`groups` must hold a group of at least 2 takes, got {len(takes)} groups of one.")
    means = np.zeros((len(takes), band_levels.shape[-1]))
    np.add.at(means, group, band_levels)
    deviations = band_levels - (means / takes[:, None])[group]
    return float(np.sqrt((deviations**2).sum(0) / freedom).mean())


def diversity(generated_levels, generated_groups, real_levels, real_groups):
    """Spread of generated takes over that of real ones: 1 = takes differ as much as real takes, 0 = all the same.

    Args:
        generated_levels, real_levels (`np.ndarray`): (n, bands), (m, bands), dB.
        generated_groups, real_groups (`np.ndarray`): (n,), (m,) the rating or surface of each take.

    Returns:
        `float`

    Raises:
        ValueError: as `take_spread_db`, or if the real takes do not differ.
    """
    real = take_spread_db(real_levels, real_groups)
    if real == 0:
        raise ValueError("`real_levels` must differ within a group, got identical takes.")
    return take_spread_db(generated_levels, generated_groups) / real


def rating_diversity(generated_levels, generated_groups, group_ratings, real_levels, real_ratings, real_groups):
    """Spread of generated takes of one rating over that of real textures with such ratings: 1 = as diverse as the data.

    Ratings do not settle a surface, so takes of a rating should differ by more than takes of a surface do. Real
    surfaces count by a Gaussian kernel over all three ratings; ratings with fewer than 20 of them near are left out.

    Args:
        generated_levels (`np.ndarray`): (n, bands) dB.
        generated_groups (`np.ndarray`): (n,) row of `group_ratings` that a take was made for.
        group_ratings (`np.ndarray`): (groups, 3) z-scores.
        real_levels (`np.ndarray`): (m, bands) dB.
        real_ratings (`np.ndarray`): (m, 3) z-scores of each texture's surface; rows with NaN are left out.
        real_groups (`np.ndarray`): (m,) which textures belong together.

    Returns:
        `float`: NaN where no rating has enough real surfaces near it.
    """
    rated = ~np.isnan(real_ratings).any(1)
    real_levels, real_ratings = np.asarray(real_levels)[rated], np.asarray(real_ratings)[rated]
    _, surface, textures = np.unique(np.asarray(real_groups)[rated], return_inverse=True, return_counts=True)
    made, real = [], []
    for group in np.unique(generated_groups):
        own = generated_levels[generated_groups == group]
        squares = np.square((real_ratings - group_ratings[group]) / RATING_WIDTH).sum(1)
        weights = np.exp(-0.5 * squares) / textures[surface]
        total = np.bincount(surface, weights)
        size = total.sum() ** 2 / max(np.square(total).sum(), np.finfo(np.float64).tiny)
        if len(own) < 2 or not size >= FEWEST_NEAR:  # NaN where an axis is not rated
            continue
        # what a straight line over ratings explains is no spread of one rating
        lines = np.concatenate([np.ones((len(real_ratings), 1)), real_ratings - group_ratings[group]], axis=1)
        weights = (weights / weights.sum())[:, None]
        left = real_levels - lines @ np.linalg.lstsq(np.sqrt(weights) * lines, np.sqrt(weights) * real_levels)[0]
        made.append(own.var(0, ddof=1).mean())
        real.append((weights * np.square(left)).sum(0).mean() / (1 - lines.shape[1] / size))
    return float(np.sqrt(np.mean(made) / np.mean(real))) if made else float("nan")


def _blocks(points):
    return (points[start : start + _ROWS] for start in range(0, len(points), _ROWS))


def _check_sets(first_name, first, second_name, second):
    first, second = check_textures(first_name, first, rank=2), check_textures(second_name, second, rank=2)
    if first.shape[1] != second.shape[1]:
        raise ValueError(
            f"`{first_name}` and `{second_name}` must have the same features, "
            f"got {first.shape[1]} and {second.shape[1]}."
        )
    return first.astype(np.float64), second.astype(np.float64)
