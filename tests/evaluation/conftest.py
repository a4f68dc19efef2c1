"""Synthetic textures: band-passed 1/f noise of random slope and level, as friction of flat surfaces is."""

import numpy as np
import pytest

from tactile_diffusers.signal import DEVICE_RATE, SEGMENT_SAMPLES, band_pass, rms


def _noise_textures(count, seed):
    rng = np.random.default_rng(seed)
    frequencies = np.maximum(np.fft.rfftfreq(2 * SEGMENT_SAMPLES, 1 / DEVICE_RATE), 5.0)
    spectra = rng.normal(size=(count, len(frequencies), 2)).view(np.complex128)[..., 0]
    slopes = rng.uniform(0.5, 1.3, size=(count, 1))
    noise = np.fft.irfft(spectra * frequencies**-slopes, axis=-1)
    # the middle half, so that a segment is not periodic
    textures = band_pass(noise, DEVICE_RATE)[:, SEGMENT_SAMPLES // 2 : -SEGMENT_SAMPLES // 2]
    return textures / rms(textures)[:, None] * rng.lognormal(-4.8, 0.4, size=(count, 1))


@pytest.fixture(scope="session")
def noise_textures():
    """A function (count, seed) -> (count, SEGMENT_SAMPLES) textures in N at DEVICE_RATE."""
    return _noise_textures


@pytest.fixture(scope="session")
def reference():
    """150 textures that play the training set."""
    return _noise_textures(150, seed=1)


@pytest.fixture(scope="session")
def held_out():
    """100 textures of the same distribution."""
    return _noise_textures(100, seed=2)
