"""A transparent embedding of textures for distances between sets: 72 features with names.

Embeddings of audio networks miss the lower half of the octaves that a finger feels (VGGish: 125 to 7500 Hz). Power and
sparsity of each band do not make a texture: how the bands' envelopes move together does (McDermott and Simoncelli 2011,
10.1016/j.neuron.2011.06.032), and stick-slip has events and a polarity.
"""

from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
from scipy import ndimage, signal
from scipy.spatial.distance import pdist

from ...signal import BAND_HZ, DEVICE_RATE, band_edges, band_levels_db, rms
from ...signal.waveform_shape import waveform_shape
from .errors import OUT_OF_BAND_HZ, out_of_band_ratio_db
from .texture_checks import check_textures, in_blocks

#: Raise it with every change of the features: distances of one version are not comparable with those of another. 1 had
#: the first 53 features.
EMBEDDING_VERSION = 2
BANDS = 18
CARRIERS = 6
#: Edges of the modulation rates, Hz: from one period in a segment to where a modulation is itself a vibration.
RATE_EDGES_HZ = (0.6, 2.0, 6.0, 20.0, 60.0)
OUT_OF_BAND_EDGES_HZ = (OUT_OF_BAND_HZ, 2000.0, DEVICE_RATE / 2)
#: Rate at which envelopes of carriers are compared with each other, Hz: modulations up to half of it count.
CORRELATION_RATE = 120.0
#: An event is a peak of the broadband envelope, smoothed by a Gaussian of this standard deviation in s, ...
EVENT_SMOOTHING = 0.003
#: ... of at least so many times its median, and as prominent as the median.
EVENT_HEIGHT = 2.0
#: Least ratio in dB that counts: below it differences cannot be felt, but would rule a distance.
RATIO_FLOOR_DB = -40.0
#: Least standard deviations for the z-scores, of features in dB and of the others: the stop-band of real textures is
#: almost constant, and would otherwise rule every distance.
DB_SCALE_FLOOR = 1.0
SCALE_FLOOR = 0.05

FEATURE_NAMES = (
    *(f"band_{low:.0f}_{high:.0f}_db" for low, high in pairwise(band_edges(BANDS))),
    *(f"out_{low:.0f}_{high:.0f}_db" for low, high in pairwise(OUT_OF_BAND_EDGES_HZ)),
    *(f"modulation_{k}_{low:g}_{high:g}_db" for k in range(CARRIERS) for low, high in pairwise(RATE_EDGES_HZ)),
    *(f"envelope_variation_{k}" for k in range(CARRIERS)),
    "kurtosis",
    "skew",
    "crest",
    *(f"correlation_{a}_{b}" for a, b in combinations(range(CARRIERS), 2)),
    "slope_skew",
    "event_rate",
    "event_irregularity",
    "event_depth_db",
)
#: Least spread of each feature that counts.
SCALE_FLOORS = np.where([name.endswith("_db") for name in FEATURE_NAMES], DB_SCALE_FLOOR, SCALE_FLOOR)
# segments that are embedded at once: bounds the memory at about 50 MB
_CHUNK = 64
# textures from which the kernel width is taken at most: 8 million distances
_WIDTH_TEXTURES = 4000


def tactile_features(textures, sampling_rate=DEVICE_RATE):
    """The 72 features of each texture (n, samples), before z-scoring: (n, 72) float64, named by `FEATURE_NAMES` in
    order.

    18 logarithmic band levels over 20-1000 Hz (dB re 1 N^2); the shares of power in 1.05-2 and 2-5 kHz (dB, not below
    -40); for each of six logarithmic carrier bands the power of its envelope, divided by the envelope's mean, at the
    rates 0.6-2, 2-6, 6-20 and 20-60 Hz (dB, not below -40); the six coefficients of variation of these envelopes;
    kurtosis, skew and crest factor of the samples; the correlations of all pairs of the six envelopes below 60 Hz; the
    skew of the waveform's derivative, whose sign is the polarity of a sawtooth; and of events, peaks of the broadband
    envelope of twice its median or more: their number a second, the coefficient of variation of their intervals (1 = as
    irregular as chance, also where there are fewer than three) and their mean height over the median (dB; without any
    the least that counts).

    Textures, in N or a relative unit, last 0.6 s or more; statistics of envelopes depend on the length: compare
    textures of one length. What lies beyond half the sampling rate, above 2000 Hz, counts as empty. Silence gives
    finite numbers. Else a ValueError.
    """
    textures = check_textures("textures", textures, rank=2)
    if sampling_rate <= 2 * BAND_HZ[1]:
        raise ValueError(f"`sampling_rate` must be above {2 * BAND_HZ[1]:g} Hz, got {sampling_rate:g}.")
    if textures.shape[-1] < 0.6 * sampling_rate:
        raise ValueError(
            f"`textures` of {textures.shape[-1]} samples at {sampling_rate:g} Hz are too short for modulations down to "
            f"{RATE_EDGES_HZ[0]} Hz. Give at least 0.6 s, better one segment."
        )
    blocks = in_blocks(textures, _CHUNK)
    return np.concatenate([_features(block.astype(np.float64), sampling_rate) for block in blocks])


def _features(textures, sampling_rate):
    levels = band_levels_db(textures, sampling_rate, band_edges(BANDS))
    outside = [
        out_of_band_ratio_db(textures, sampling_rate, low, high, RATIO_FLOOR_DB)
        for low, high in pairwise(OUT_OF_BAND_EDGES_HZ)
    ]
    envelopes = _Envelopes(textures, sampling_rate)
    carriers = [envelopes.of(*edges) for edges in pairwise(band_edges(CARRIERS))]
    modulations, variations = zip(*(envelopes.modulation(*carrier) for carrier in carriers), strict=True)
    shape = waveform_shape(textures)
    moments = np.stack([shape[name] for name in ("kurtosis", "skew", "crest_factor")], -1)
    correlations, events = envelopes.correlations(carriers), envelopes.events(*envelopes.of(*BAND_HZ))
    first = (levels, np.stack(outside, -1), *modulations, np.stack(variations, -1), moments)
    return np.concatenate([*first, correlations, shape["slope_skew"][:, None], events], axis=-1)


def standardised(rows):
    """Rows (n, length) with zero mean and unit standard deviation; zeros where a row does not vary."""
    rows = rows - rows.mean(-1, keepdims=True)
    return rows / np.maximum(rms(rows), np.finfo(np.float64).tiny)[:, None]


def modulation_db(envelopes, rate, edges):
    """Power of envelopes (n, length) between edges in Hz, dB, not below -40: (n, len(edges) - 1)."""
    rates, power = signal.periodogram(envelopes, fs=rate, window="hann", axis=-1)
    shares = [power[:, (rates >= slow) & (rates < fast)].sum(-1) * rates[1] for slow, fast in pairwise(edges)]
    return 10 * np.log10(np.maximum(np.stack(shares, -1), 10 ** (RATIO_FLOOR_DB / 10)))


class _Envelopes:
    """Envelopes of bands of textures (n, samples), and what is measured on them."""

    # without a taper the step from the last sample to the first would ring in every band
    taper, trim = 0.02, 0.04  # s at each end: faded, and left out of the envelopes

    def __init__(self, textures, sampling_rate):
        samples = textures.shape[-1]
        self.seconds = samples / sampling_rate
        self._spectra = np.fft.rfft(textures * signal.windows.tukey(samples, 2 * self.taper / self.seconds), axis=-1)
        self._frequencies = np.fft.rfftfreq(samples, 1 / sampling_rate)

    def of(self, low, high):
        """Envelope (n, length) of a band, both ends still on, and its sampling rate, Hz."""
        bins = self._spectra[:, (self._frequencies >= low) & (self._frequencies < high)]
        # the inverse transform of a band's bins alone is its complex envelope at a low rate, which keeps this fast;
        # four times as many samples as bins, because the magnitude has a wider spectrum than the envelope
        length = 4 * bins.shape[-1]
        return np.abs(np.fft.ifft(bins, n=length, axis=-1)), length / self.seconds

    def _inside(self, envelope, rate):
        """Without the ends, divided by its mean."""
        edge = int(np.ceil(self.trim * rate))
        envelope = envelope[:, edge : envelope.shape[-1] - edge]
        return envelope / np.maximum(envelope.mean(-1, keepdims=True), np.finfo(np.float64).tiny)

    def modulation(self, envelope, rate):
        """Power at each range of rates, dB (n, rates), and coefficient of variation (n,)."""
        envelope = self._inside(envelope, rate)
        return modulation_db(envelope, rate, RATE_EDGES_HZ), envelope.std(-1)

    def correlations(self, carriers):
        """Pearson correlation of each pair of envelopes: (n, pairs); 0 where one does not vary."""
        length = round(CORRELATION_RATE * self.seconds)
        common = [signal.resample(envelope, length, axis=-1) for envelope, _ in carriers]
        unit = [standardised(self._inside(envelope, CORRELATION_RATE)) for envelope in common]
        return np.stack([(a * b).mean(-1) for a, b in combinations(unit, 2)], -1)

    def events(self, envelope, rate):
        """Number a second, coefficient of variation of the intervals, and mean height in dB: (n, 3)."""
        smooth = self._inside(ndimage.gaussian_filter1d(envelope, EVENT_SMOOTHING * rate, mode="nearest"), rate)
        return np.stack([self._events_of(row, rate) for row in smooth])

    @staticmethod
    def _events_of(row, rate):
        median = max(np.median(row), np.finfo(np.float64).tiny)
        peaks, found = signal.find_peaks(row, height=EVENT_HEIGHT * median, prominence=median)
        intervals = np.diff(peaks)
        irregularity = intervals.std() / intervals.mean() if len(peaks) > 2 else 1.0
        height = found["peak_heights"].mean() / median if len(peaks) else EVENT_HEIGHT
        return len(peaks) * rate / len(row), irregularity, 20 * np.log10(height)


@dataclass(frozen=True)
class TactileEmbedding:
    """Features z-scored by a reference set, and the kernel width of that set: frozen, so that distances are comparable.

    `mean` and `scale` (72,) are of the reference's features, the latter not below 1 dB for features in dB and 0.05 for
    the others; `width` is the median distance between two textures of the reference, in z-scores.
    """

    mean: np.ndarray
    scale: np.ndarray
    width: float
    sampling_rate: float
    version: int = EMBEDDING_VERSION

    @classmethod
    def fit(cls, textures, sampling_rate=DEVICE_RATE):
        """Takes mean, scale and width (the median over all pairs of at most 4000) from textures (n, samples) of the
        training surfaces.

        A ValueError as of `tactile_features`, or if there are fewer than two textures.
        """
        features = tactile_features(textures, sampling_rate)
        if len(features) < 2:
            raise ValueError(f"`textures` must hold at least 2 textures to fit an embedding, got {len(features)}.")
        mean, scale = features.mean(0), np.maximum(features.std(0, ddof=1), SCALE_FLOORS)
        spaced = np.linspace(0, len(features) - 1, min(len(features), _WIDTH_TEXTURES)).round().astype(int)
        width = float(np.median(pdist((features[spaced] - mean) / scale)))
        return cls(mean, scale, width, float(sampling_rate))

    def __call__(self, textures, sampling_rate=DEVICE_RATE):
        """Embeds textures (n, samples) of the length, unit and sampling rate of the reference: (n, 72) float64
        z-scores.

        A ValueError as of `tactile_features`, or if the sampling rate is another.
        """
        if sampling_rate != self.sampling_rate:
            raise ValueError(
                f"`sampling_rate` must be that of the reference, {self.sampling_rate:g} Hz, got {sampling_rate:g}. "
                "Resample the textures (`tactile_diffusers.signal.resample`) or fit again."
            )
        return (tactile_features(textures, sampling_rate) - self.mean) / self.scale
