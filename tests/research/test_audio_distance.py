"""The Fréchet audio distance: the closed form, and the log-mel embedding."""

import numpy as np
import pytest
from audio_distance import frechet_audio_distance, log_mel_embedding

from tactile_diffusers.signal import DEVICE_RATE, band_pass, rms


def _textures(count, seed):
    rng = np.random.default_rng(seed)
    noise = band_pass(np.cumsum(rng.standard_normal((count, 2**14)), -1), DEVICE_RATE)
    return noise / rms(noise)[:, None] * rng.lognormal(-4.8, 0.4, size=(count, 1))


@pytest.fixture(scope="module")
def reference():
    return _textures(150, 1)


@pytest.fixture(scope="module")
def held_out():
    return _textures(100, 2)


def _as_is(textures, sampling_rate):
    return textures


def test_gaussian_embeddings_give_the_closed_form():
    rng = np.random.default_rng(0)
    samples = rng.normal(size=(200, 5))
    samples = (samples - samples.mean(0)) @ np.linalg.inv(np.linalg.cholesky(np.cov(samples, rowvar=False))).T
    # exactly standard normal; the other is shifted by 1 and three times as wide: 5 * 1^2 + 5 * (3 - 1)^2
    assert frechet_audio_distance(samples, 1 + 3 * samples, 1, embedding=_as_is) == pytest.approx(25, rel=1e-9)
    assert frechet_audio_distance(samples, samples[::-1], 1, embedding=_as_is) == pytest.approx(0, abs=1e-9)


def test_default_embedding_tells_gain_and_colour(reference, held_out):
    def distance(textures):
        return frechet_audio_distance(textures, reference, DEVICE_RATE)

    good = distance(held_out)
    # draws of one distribution: 500 and 750 rows of 32 features, which five to a texture are not all independent
    assert 0 < good < 1.5
    # all 32 logarithms shift by ln 4, up to the offset and to chance: 32 * 1.386^2 = 61
    assert distance(2 * held_out) == pytest.approx(61, abs=15)
    white = np.random.default_rng(1).normal(size=held_out.shape) * held_out.std(-1, keepdims=True)
    assert distance(white) > 20


def test_rows_are_band_powers_in_newtons(held_out):
    time = np.arange(2**14) / DEVICE_RATE
    tone = 0.01 * np.sqrt(2) * np.sin(2 * np.pi * 200 * time)
    rows = log_mel_embedding(np.stack([tone, 0 * tone]), DEVICE_RATE)
    assert rows.shape == (10, 32)
    # powers of neighbouring filters add up to that of the tone, 1e-4 N^2; 32 offsets of 1e-10 are nothing to it
    np.testing.assert_allclose(np.exp(rows[:5]).sum(-1), 1e-4, rtol=1e-3)
    np.testing.assert_allclose(rows[5:], np.log(1e-10))
    # 500 textures make 2500 rows, 78 for each feature
    assert log_mel_embedding(held_out, DEVICE_RATE).shape == (500, 32)
    # the tone lies between the centres of the eighth and the ninth filter on HTK's scale, 187 and 210 Hz
    assert set(np.argsort(rows[0])[-2:]) == {7, 8}
