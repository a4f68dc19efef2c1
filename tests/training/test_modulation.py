"""Modulation that a decoder leaves out: what is measured is what is restored."""

import numpy as np
import pytest
import torch

from tactile_diffusers import TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.training.fitting import LIMITS, fit_modulation_gains

LAYERED = {"feature_channels": 28, "latent_channels": 6, "detail_channels": 2, "level_bands": 1}
EXTRACTOR = {"feature_size": 28, "detail_samples": 2, "level_bands": 1}


@pytest.fixture
def pipe(make_lctg, make_dale, make_extractor):
    pipe = TactileTexturePipeline(
        lctg=make_lctg(0, **LAYERED),
        feature_extractor=make_extractor(**EXTRACTOR),
        scheduler=VDDIMScheduler(),
        dale=make_dale(1),
        dale_scheduler=VDDIMScheduler(),
    )
    pipe.set_progress_bar_config(disable=True)
    return pipe


def _fluttering(textures, depth, rate=4.0):
    time = np.arange(textures.shape[-1]) / 10_000
    return textures * (1 + depth * np.sin(2 * np.pi * rate * time))


def _shortfall(pipe, textures):
    """Fast modulation of recordings over that of what is decoded without their detail, first band."""
    powers = []
    made = pipe.encode(textures, 10_000)
    base = pipe.lctg.pad_detail(made.latents[:, : pipe.lctg.base_channels])
    out = pipe.decode(base, made.level, generator=torch.Generator().manual_seed(5))
    for rows in (textures, out.textures):
        waveform = pipe.feature_extractor.normalize(rows, 10_000)[0]
        powers.append(np.square(pipe.feature_extractor.fast_modulation(waveform))[:, 0].mean())
    return np.sqrt(powers[0] / powers[1])


def test_what_is_missing_is_restored(pipe, pink_noise):
    textures = _fluttering(pink_noise(16_384, 10_000, count=12), 0.15)
    before = _shortfall(pipe, textures)
    modulation_gain = fit_modulation_gains(pipe, pipe.dale, textures, 10_000, quiet=True, batch_size=5)
    assert modulation_gain == pipe.lctg.config.modulation_gains and len(modulation_gain) == 2
    assert LIMITS[0] <= min(modulation_gain) and max(modulation_gain) <= LIMITS[1]
    assert before > 1.1 and modulation_gain[0] > 1.1  # an untrained decoder does not flutter
    assert abs(np.log(_shortfall(pipe, textures))) < 0.6 * np.log(before)  # other noise, few textures


def test_without_band_levels_there_is_none(make_pipeline, pink_noise):
    pipe = make_pipeline()
    assert fit_modulation_gains(pipe, pipe.dale, pink_noise(8192, 10_000), 10_000, quiet=True) is None
    assert pipe.lctg.config.modulation_gains is None
