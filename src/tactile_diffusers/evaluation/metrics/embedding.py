"""A transparent embedding of textures for distances between sets: 53 features with names.

Embeddings of audio networks do not fit: VGGish, for example, covers 125 to 7500 Hz and so misses the lower half of the
octaves that a finger feels.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import signal
from scipy.spatial.distance import pdist

from ...signal import BAND_HZ, DEVICE_RATE, band_edges, band_levels_db, rms
from .errors import OUT_OF_BAND_HZ, out_of_band_ratio_db
from .texture_checks import check_textures, in_blocks

BANDS = 18
CARRIERS = 6
#: Edges of the modulation rates, Hz: from one period in a segment to where a modulation is itself a vibration.
RATE_EDGES_HZ = (0.6, 2.0, 6.0, 20.0, 60.0)
OUT_OF_BAND_EDGES_HZ = (OUT_OF_BAND_HZ, 2000.0, DEVICE_RATE / 2)
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
)
# segments that are embedded at once: bounds the memory at about 50 MB
_CHUNK = 64
# textures from which the kernel width is taken at most: 8 million distances
_WIDTH_TEXTURES = 4000


def tactile_features(textures, sampling_rate=DEVICE_RATE):
    """The 53 features of each texture, before z-scoring.

    18 logarithmic band levels over 20-1000 Hz (dB re 1 N^2); the shares of power in 1.05-2 and 2-5 kHz (dB, not below
    -40); for each of six logarithmic carrier bands the power of its envelope, divided by the envelope's mean, at the
    rates 0.6-2, 2-6, 6-20 and 20-60 Hz (dB, not below -40); the six coefficients of variation of these envelopes;
    kurtosis, skew and crest factor of the samples. `FEATURE_NAMES` names them in order.

    Args:
        textures (`np.ndarray`): (n, samples), N or a relative unit; at least 0.6 s. Statistics of envelopes depend
            on the length: compare textures of one length.
        sampling_rate (`float`): Hz, above 2000. What lies beyond half of it counts as empty.

    Returns:
        `np.ndarray`: (n, 53) float64. Silence gives finite numbers.

    Raises:
        ValueError: if `textures` is not (n, samples), not finite or too short, or the sampling rate too low.
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
    modulations, variations = _modulation(textures, sampling_rate)
    unit = textures - textures.mean(-1, keepdims=True)
    unit = unit / np.maximum(rms(unit), np.finfo(np.float64).tiny)[:, None]
    shape = [(unit**4).mean(-1), (unit**3).mean(-1), np.abs(unit).max(-1)]
    return np.concatenate([levels, np.stack(outside, -1), modulations, variations, np.stack(shape, -1)], axis=-1)


def _modulation(textures, sampling_rate):
    """Envelope power at each rate, dB (n, carriers * rates), and coefficients of variation (n, carriers)."""
    # without a taper the step from the last sample to the first would ring in every band
    taper, trim = 0.02, 0.04  # s at each end: faded, and left out of the envelopes
    samples = textures.shape[-1]
    seconds = samples / sampling_rate
    spectra = np.fft.rfft(textures * signal.windows.tukey(samples, 2 * taper / seconds), axis=-1)
    frequencies = np.fft.rfftfreq(samples, 1 / sampling_rate)
    modulations, variations = [], []
    for low, high in pairwise(band_edges(CARRIERS)):
        bins = spectra[:, (frequencies >= low) & (frequencies < high)]
        # the inverse transform of a band's bins alone is its complex envelope at a low rate, which keeps this fast;
        # four times as many samples as bins, because the magnitude has a wider spectrum than the envelope
        length = 4 * bins.shape[-1]
        rate = length / seconds
        envelope = np.abs(np.fft.ifft(bins, n=length, axis=-1))
        edge = int(np.ceil(trim * rate))
        envelope = envelope[:, edge : length - edge]
        envelope = envelope / np.maximum(envelope.mean(-1, keepdims=True), np.finfo(np.float64).tiny)
        variations.append(envelope.std(-1))
        rates, power = signal.periodogram(envelope, fs=rate, window="hann", axis=-1)
        for slow, fast in pairwise(RATE_EDGES_HZ):
            share = power[:, (rates >= slow) & (rates < fast)].sum(-1) * rates[1]
            modulations.append(10 * np.log10(np.maximum(share, 10 ** (RATIO_FLOOR_DB / 10))))
    return np.stack(modulations, -1), np.stack(variations, -1)


@dataclass(frozen=True)
class TactileEmbedding:
    """Features z-scored by a reference set, and the kernel width of that set: frozen, so that distances are comparable.

    Args:
        mean, scale (`np.ndarray`): (53,) mean and standard deviation of the reference's features, the latter not below
            1 dB for features in dB and 0.05 for the others.
        width (`float`): median distance between two textures of the reference, in z-scores.
        sampling_rate (`float`): of the reference, Hz.
    """

    mean: np.ndarray
    scale: np.ndarray
    width: float
    sampling_rate: float

    @classmethod
    def fit(cls, textures, sampling_rate=DEVICE_RATE):
        """Takes mean, scale and kernel width from textures (n, samples) of a reference: the training surfaces.

        The width is the median over all pairs of at most 4000 of them, evenly spaced.

        Raises:
            ValueError: as `tactile_features`, or if there are fewer than two textures.
        """
        features = tactile_features(textures, sampling_rate)
        if len(features) < 2:
            raise ValueError(f"`textures` must hold at least 2 textures to fit an embedding, got {len(features)}.")
        floor = np.where([name.endswith("_db") for name in FEATURE_NAMES], DB_SCALE_FLOOR, SCALE_FLOOR)
        mean, scale = features.mean(0), np.maximum(features.std(0, ddof=1), floor)
        spaced = np.linspace(0, len(features) - 1, min(len(features), _WIDTH_TEXTURES)).round().astype(int)
        width = float(np.median(pdist((features[spaced] - mean) / scale)))
        return cls(mean, scale, width, float(sampling_rate))

    def __call__(self, textures, sampling_rate=DEVICE_RATE):
        """Embeds textures (n, samples) of the length and unit of the reference: (n, 53) float64 z-scores.

        Raises:
            ValueError: as `tactile_features`, or if the sampling rate is not that of the reference.
        """
        if sampling_rate != self.sampling_rate:
            raise ValueError(
                f"`sampling_rate` must be that of the reference, {self.sampling_rate:g} Hz, got {sampling_rate:g}. "
                "Resample the textures (`tactile_diffusers.signal.resample`) or fit again."
            )
        return (tactile_features(textures, sampling_rate) - self.mean) / self.scale
