"""Section "long_textures": whether a texture longer than a segment is as even and as unlike itself as it should be."""

import numpy as np
import torch
from scipy.signal import fftconvolve

from ...pipelines.windows import Windows
from ...signal import band_edges, band_levels_db
from ..metrics.statistics import leaf, number


def run(context):
    """The section: `{"long_textures": ...}`."""
    settings = context.settings
    ratings = [[None] * 3] * settings.long_textures
    found = long_texture_study(context.pipe, ratings, settings.long_seconds, context.seed)
    count = settings.long_textures
    return {
        "long_textures": {
            "seconds": number(settings.long_seconds, count),
            "overlap_level_db": number(found["overlap_rms_db"], count),
            "overlap_bands_db": leaf(found["overlap_bands_db"]),
            "largest_correlation": number(found["largest_correlation"], count),
        }
    }


def long_texture_study(pipe, ratings, duration_s=30.0, seed=0):
    """Whether a long texture is as even and as unlike itself as it should be.

    Args:
        pipe (`TactileTexturePipeline`): with a DALE.
        ratings: any form that the pipeline takes; figures are means over the textures.
        duration_s (`float`): seconds.
        seed (`int`): of the noise.

    Returns:
        `dict`: "overlap_rms_db" and "overlap_bands_db" (the upper seven of the nine bands): level where generated
        windows overlap over level elsewhere; "largest_correlation": see `largest_correlation`.
    """
    generator = torch.Generator("cpu").manual_seed(seed)
    out = pipe(ratings, duration_s=duration_s, generator=generator)
    rate = out.sampling_rate
    # frames of 0.1 s that lie wholly inside or wholly outside the overlaps; they resolve all but the two lowest bands
    frame = int(0.1 * rate)
    count = out.textures.shape[-1] // frame
    share = overlap_mask(pipe, out.textures.shape[-1], rate)[: count * frame].reshape(count, frame).mean(1)
    frames = out.textures[:, : count * frame].reshape(len(out.textures), count, frame)
    power = 10 ** (band_levels_db(frames, rate, band_edges()[2:]) / 10)

    def ratio_db(values):
        return 10 * np.log10(values[:, share == 1].mean(1) / values[:, share == 0].mean(1)).mean(0)

    correlations = [largest_correlation(texture, rate) for texture in out.textures]
    return {
        "overlap_rms_db": float(ratio_db(np.square(frames.astype(np.float64)).mean(-1))),
        "overlap_bands_db": [round(float(value), 3) for value in ratio_db(power)],
        "largest_correlation": float(max(correlations)),
    }


def overlap_mask(pipe, samples, sampling_rate):
    """Which samples of a long texture come from more than one window: (samples,) bool."""
    seconds = pipe.lctg.config.latent_hop / pipe.feature_extractor.sampling_rate
    size = pipe.dale.config.latent_frames
    frames = max(size, int(np.ceil(samples / sampling_rate / seconds)))
    covered = np.zeros(frames, dtype=np.int64)
    for start in Windows(frames, size).starts:
        covered[start : start + size] += 1
    positions = np.minimum((np.arange(samples) / sampling_rate / seconds).astype(np.int64), frames - 1)
    return covered[positions] > 1


def largest_correlation(texture, sampling_rate):
    """Largest normalised correlation of any whole second with a place at least a second away; a repeat gives 1."""
    texture = np.asarray(texture, dtype=np.float64)
    second, largest = int(sampling_rate), 0.0
    energy = np.convolve(np.square(texture), np.ones(second), mode="valid")
    for start in range(0, len(texture) - second + 1, second):
        piece = texture[start : start + second]
        correlation = fftconvolve(texture, piece[::-1], mode="valid") / np.sqrt(energy * np.sum(piece**2) + 1e-30)
        correlation[max(0, start - second) : start + second] = 0.0
        largest = max(largest, float(np.abs(correlation).max()))
    return largest
