"""Measures of control: gain is not shape, noise held fixed is compared with itself."""

import numpy as np
import pytest
from report.sampling import generate, noise_seeds

from tactile_diffusers.evaluation.metrics.rating_effects import (
    latent_shift_percent,
    shape_change_db,
    texture_measures,
)
from tactile_diffusers.signal import DEVICE_RATE, band_edges, level


def _measures(textures):
    count = len(textures)
    return texture_measures(textures, level(textures), np.full(count, 0.5), DEVICE_RATE, band_edges())


def test_gain_moves_level_and_nothing_of_the_shape(held_out):
    quiet, loud = _measures(held_out), _measures(2 * held_out)
    assert (loud["level_db"] - quiet["level_db"]).mean() == pytest.approx(6.02, abs=0.001)
    change = shape_change_db(loud["shape_db"].mean(0), quiet["shape_db"].mean(0))
    assert change == pytest.approx(0, abs=1e-9)  # the paper's failure has this number near 0
    assert np.allclose(loud["log_friction"], np.log(0.5))


def test_tilt_moves_the_shape_and_not_the_level(held_out):
    frequencies = np.fft.rfftfreq(held_out.shape[-1], 1 / DEVICE_RATE)
    tilted = np.fft.irfft(np.fft.rfft(held_out) * np.sqrt(np.maximum(frequencies, 1.0)), held_out.shape[-1])
    tilted *= (np.exp(level(held_out)) / np.exp(level(tilted)))[:, None]
    before, after = _measures(held_out), _measures(tilted)
    assert np.allclose(before["level_db"], after["level_db"])
    # 3 dB an octave over 5.6 octaves: bands move by -8.5 to 8.5 dB about their middle, 4 dB on average
    assert shape_change_db(after["shape_db"].mean(0), before["shape_db"].mean(0)) == pytest.approx(4.7, abs=1.0)


def test_latent_shift_is_relative_to_the_baseline():
    baseline = np.random.default_rng(1).normal(size=(5, 4, 8))
    assert latent_shift_percent(baseline, baseline) == pytest.approx(0)
    assert latent_shift_percent(1.02 * baseline, baseline) == pytest.approx(2.0)


def test_batches_and_order_do_not_change_what_is_generated(pipe):
    ratings, seeds = np.array([[1.0, np.nan, 0.0], [-1.0, 0.5, np.nan], [0.0, 0.0, 0.0]]), noise_seeds(3, 3)
    whole = generate(pipe, ratings, seeds, 10_000, 2000, steps=2)
    assert whole.textures.shape == (3, 2000) and whole.latents.shape[0] == 3
    single = generate(pipe, ratings[::-1], seeds[::-1], 10_000, 2000, steps=2, batch=1)
    assert np.abs(whole.textures - single.textures[::-1]).max() < 1e-4 * np.abs(whole.textures).max()
    latents = generate(pipe, ratings, seeds, 10_000, 2000, steps=2, decode=False)
    assert latents.textures.shape == (3, 0) and np.allclose(latents.latents, whole.latents)
