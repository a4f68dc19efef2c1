"""What the nine bands of textures of some ratings are expected to hold, by what the checkpoint knows; nothing decoded.

A checkpoint does not bring its training textures. It has the mean and spread of their band levels (DALE's config), and
DALE, which learned how these hang on ratings: draws of both are turned into levels in newtons here.
"""

from dataclasses import dataclass

import numpy as np
import torch

from tactile_diffusers.pipelines import TactileLatents
from tactile_diffusers.signal import band_edges
from tactile_diffusers.signal.spectra import POWER_FLOOR

#: Draws behind a range: enough to shade it, few enough not to keep a visitor waiting.
DRAWS = 32
PERCENTILES = (10, 50, 90)


@dataclass(frozen=True)
class BandRange:
    """Nine-band levels of many textures: `low`, `middle`, `high`, each (9,) float64, dB re 1 N²."""

    low: np.ndarray
    middle: np.ndarray
    high: np.ndarray


def training_range(pipe, seed=0):
    """Of the training textures, whatever their ratings: mean and spread of each number, taken as independent.

    Args:
        pipe (`TactileTexturePipeline`): with `dale`.
        seed (`int`, *optional*): of the draws.

    Returns:
        [`BandRange`], or `None` for a checkpoint without band levels.
    """
    config = pipe.dale.config
    shape = (DRAWS, config.in_channels, config.latent_frames)
    # DALE's state has unit variance in every number, so noise that is unpacked has their means and spreads
    with torch.no_grad():
        made = pipe.dale.unpack(torch.randn(shape, generator=torch.Generator().manual_seed(seed)))
    return _range(pipe, TactileLatents(*made))


def draw_latents(pipe, ratings, latent_steps, guidance, seed=0):
    """Textures of some ratings, as DALE learned them, not decoded.

    Args:
        pipe (`TactileTexturePipeline`): with `dale`.
        ratings (`Sequence[float]`): (axes,) z-scores, NaN = not specified.
        latent_steps (`int`), guidance (`float`): as the texture is made with.
        seed (`int`, *optional*): of the draws.

    Returns:
        [`TactileLatents`]: `DRAWS` of one segment.
    """
    generator = torch.Generator().manual_seed(seed)
    options = {"num_textures_per_rating": DRAWS, "generator": generator, "output_type": "latent"}
    return pipe(list(ratings), num_latent_inference_steps=latent_steps, guidance_scale=guidance, **options)


def rating_range(pipe, drawn):
    """Of textures of some ratings, `drawn` by `draw_latents`.

    Returns:
        [`BandRange`], or `None` for a checkpoint without band levels.
    """
    return _range(pipe, drawn) if pipe.lctg.config.level_bands else None


@torch.no_grad()
def estimated_range(pipe, drawn):
    """Ratings that textures of some ratings, `drawn` by `draw_latents`, are estimated with: see `estimate_ratings`.

    Returns:
        `np.ndarray`: (2, axes) z-scores, lowest and highest of `PERCENTILES`; `None` without an estimator.
    """
    if pipe.rating_estimator is None:
        return None
    friction = drawn.friction_coefficient
    latents = drawn.latents[:, : pipe.lctg.base_channels]
    pooled = pipe.dale.pool_state(pipe.dale.pack(latents, drawn.level, friction)).to(pipe.rating_estimator.dtype)
    estimated = pipe.rating_estimator(pooled, torch.isfinite(friction)).double().numpy()
    return np.percentile(estimated, [PERCENTILES[0], PERCENTILES[-1]], axis=0)


def _range(pipe, made):
    levels = pipe.lctg.band_levels(made.latents)
    if levels is None:
        return None
    bands = nine_bands(levels.double().numpy(), made.level.double().numpy(), pipe.feature_extractor)
    return BandRange(*np.percentile(bands, PERCENTILES, axis=0))


def nine_bands(band_levels, level, extractor):
    """Nine-band levels that a texture of these band levels has.

    Args:
        band_levels (`np.ndarray`): (batch, level_bands + 1, frames), as `TactileFeatureExtractor.band_levels`.
        level (`np.ndarray`): (batch,), natural log of the RMS in N.
        extractor (`TactileFeatureExtractor`): whose pre-emphasis is undone.

    Returns:
        `np.ndarray`: (batch, 9) dB re 1 N².
    """
    edges = band_edges(extractor.level_bands, extractor.band)
    top = extractor.sampling_rate / 2
    # power of a band is its density, relative to white noise's, times its width; the lowest band begins at 0 Hz
    widths = np.diff([0.0, *edges[1:], top])
    centres = np.sqrt(edges * [*edges[1:], top])
    power = np.exp(band_levels).mean(-1) * widths * 10 ** (-_preemphasis_db(extractor, centres) / 10)
    power *= np.exp(2 * level)[:, None] / power.sum(-1, keepdims=True)
    below = np.concatenate([np.zeros((len(power), 1)), np.cumsum(power[:, :-1], axis=-1)], axis=-1)
    nine = np.log(band_edges())
    made = np.stack([np.diff(np.interp(nine, np.log(edges), row)) for row in below])
    return 10 * np.log10(np.maximum(made, POWER_FLOOR))


def _preemphasis_db(extractor, frequencies):
    if extractor.preemphasis_db is None:
        return np.zeros(len(frequencies))
    return np.interp(np.log(frequencies), np.log(extractor.preemphasis_frequencies), extractor.preemphasis_db)
