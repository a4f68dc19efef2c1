"""Measures of control: gain is not shape, chance is no shift, noise held fixed is compared with itself."""

import numpy as np
import pytest

from tactile_diffusers.evaluation.metrics.rating_effects import (
    d_prime,
    latent_shift_percent,
    shape_change_db,
    texture_measures,
)
from tactile_diffusers.evaluation.sampling import generate, noise_seeds
from tactile_diffusers.signal import DEVICE_RATE, band_edges, level


def _measures(textures):
    count = len(textures)
    return texture_measures(
        textures, level(textures), np.full(count, 0.5), DEVICE_RATE, band_edges(), np.zeros((count, 4))
    )


def test_gain_moves_level_and_nothing_of_the_shape(held_out):
    quiet, loud = _measures(held_out), _measures(2 * held_out)
    assert (loud["level_db"] - quiet["level_db"]).mean() == pytest.approx(6.02, abs=0.001)
    change = shape_change_db(loud["shape_db"].mean(0), quiet["shape_db"].mean(0))
    assert change == pytest.approx(0, abs=1e-9)  # the paper's failure has this number near 0
    assert np.allclose(loud["log_friction"], np.log(0.5))
    assert quiet["latent"].shape == (len(held_out), 6)  # four of the summary, level and friction


def test_tilt_moves_the_shape_and_not_the_level(held_out):
    frequencies = np.fft.rfftfreq(held_out.shape[-1], 1 / DEVICE_RATE)
    tilted = np.fft.irfft(np.fft.rfft(held_out) * np.sqrt(np.maximum(frequencies, 1.0)), held_out.shape[-1])
    tilted *= (np.exp(level(held_out)) / np.exp(level(tilted)))[:, None]
    before, after = _measures(held_out), _measures(tilted)
    assert np.allclose(before["level_db"], after["level_db"])
    # 3 dB an octave over 5.6 octaves: bands move by -8.5 to 8.5 dB about their middle, 4 dB on average
    assert shape_change_db(after["shape_db"].mean(0), before["shape_db"].mean(0)) == pytest.approx(4.7, abs=1.0)


def test_d_prime_of_chance_is_zero_and_of_a_shift_is_the_shift():
    rng, found, shifted = np.random.default_rng(0), [], []
    for _ in range(200):
        a, b = rng.normal(size=(50, 10)), rng.normal(size=(50, 10))
        ends = [(x.mean(0), x.std(0, ddof=1), 50) for x in (a, b)]
        found.append(d_prime(*ends[0], *ends[1]))
        shift = np.zeros(10)
        shift[0] = 2.0
        shifted.append(d_prime((b + shift).mean(0), ends[1][1], 50, *ends[0]))
    # without the correction chance would give sqrt(10 * 2 / 50) = 0.63
    assert np.median(found) < 0.35
    assert np.mean(shifted) == pytest.approx(2.0, abs=0.1)  # 200 repeats of a figure that scatters by 0.2


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
