"""What the skin may take from a texture: statistics of four channels of touch, far simpler than models of afferents.

Each channel filters the texture as its afferents are tuned (Johansson, Landström and Lundström 1982,
10.1016/0006-8993(82)90899-x), rectifies it and compresses it; its activity up to 100 Hz is described. The four channels
are those of Bolanowski et al. 1988 (10.1121/1.397184), the exact curves ours. There are no skin mechanics, thresholds
or spikes: TouchSim (Saal et al. 2017) has them, but comes without a licence.
"""

from itertools import combinations, pairwise

import numpy as np
from scipy import signal

from tactile_diffusers.evaluation.metrics.embedding import DB_SCALE_FLOOR, SCALE_FLOOR, modulation_db, standardised
from tactile_diffusers.evaluation.metrics.texture_checks import check_textures, in_blocks
from tactile_diffusers.signal import BAND_HZ, DEVICE_RATE, rms

#: Sampling rate of the activity, Hz.
ACTIVITY_RATE = 200.0
#: Edges of the rates of its modulation, Hz.
RATE_EDGES_HZ = (0.6, 2.0, 8.0, 16.0, 50.0)
#: channel -> centre of its tuning in Hz, and width: standard deviation in log frequency; sa1: a low-pass.
TUNING = {"sa1": (25.0, None), "ra1": (40.0, 0.7), "sa2": (120.0, 1.0), "pc": (250.0, 0.75)}
# s at each end that is left out of the activity
_TRIM = 0.04
_PARTS = ("level_db", "variation", "skew", *(f"{low:g}_{high:g}_db" for low, high in pairwise(RATE_EDGES_HZ)))

AFFERENT_NAMES = (
    *(f"{channel}_{part}" for channel in TUNING for part in _PARTS),
    *(f"correlation_{a}_{b}" for a, b in combinations(TUNING, 2)),
)
#: Least spread of each feature that counts.
AFFERENT_FLOORS = np.where([name.endswith("_db") for name in AFFERENT_NAMES], DB_SCALE_FLOOR, SCALE_FLOOR)


def afferent_features(textures, sampling_rate=DEVICE_RATE):
    """The 34 features of each texture (n, samples), at least 0.6 s: (n, 34) float64, named by `AFFERENT_NAMES`.

    Of each channel the level (dB), then of its activity over its mean the standard deviation, the skew and the power of
    the modulation at four ranges of rates (dB, not below -40); the correlations of all pairs of channels.
    """
    textures = check_textures("textures", textures, rank=2)
    return np.concatenate([_features(block.astype(np.float64), sampling_rate) for block in in_blocks(textures, 64)])


def _features(textures, sampling_rate):
    samples = textures.shape[-1]
    frequencies = np.fft.rfftfreq(samples, 1 / sampling_rate)
    band = (frequencies >= BAND_HZ[0]) & (frequencies < BAND_HZ[1])
    spectra = np.fft.rfft(textures * signal.windows.tukey(samples, _TRIM * sampling_rate / samples), axis=-1) * band
    columns, activities, edge = [], [], round(_TRIM * ACTIVITY_RATE)
    for centre, width in TUNING.values():
        octaves = np.log(np.maximum(frequencies, 1) / centre)
        weights = 1 / np.sqrt(1 + np.exp(4 * octaves)) if width is None else np.exp(-0.5 * (octaves / width) ** 2)
        filtered = np.fft.irfft(spectra * weights, samples, axis=-1)
        level = np.maximum(rms(filtered), 1e-10)[:, None]
        activity = np.log1p(3 * np.maximum(filtered / level, 0))
        activity = signal.resample(activity, round(ACTIVITY_RATE * samples / sampling_rate), axis=-1)[:, edge:-edge]
        activity = activity / np.maximum(activity.mean(-1, keepdims=True), 1e-10)
        activities.append(standardised(activity))
        moments = [20 * np.log10(level[:, 0]), activity.std(-1), (activities[-1] ** 3).mean(-1)]
        columns += [*moments, *modulation_db(activity, ACTIVITY_RATE, RATE_EDGES_HZ).T]
    return np.stack([*columns, *((a * b).mean(-1) for a, b in combinations(activities, 2))], -1)
