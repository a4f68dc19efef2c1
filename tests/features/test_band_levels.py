"""Band levels over time: what is measured, what is given back, and what is left alone."""

import numpy as np
import pytest

from tactile_diffusers.features.band_levels import (
    LARGEST_GAIN_DB,
    impose_band_levels,
    measure_band_levels,
    measure_fast_modulation,
)
from tactile_diffusers.signal import band_edges, rms

COUNT, FRAMES, HOP = 8, 64, 64
GRID = {"sampling_rate": 2500, "band": (20.0, 1000.0), "window": 512, "hop": HOP}
EDGES = band_edges(COUNT, GRID["band"])
DB = 10 / np.log(10)  # from natural logarithms of power
#: added to `tests/conftest.py`'s: three bands and what lies above, 16 samples per frame
THREE = {"level_bands": 3}


def _noise(rows=32, samples=FRAMES * HOP, seed=0):
    return np.random.default_rng(seed).normal(size=(rows, samples))


def _filtered(waveform, gain):
    """`gain` is a function of frequency in Hz."""
    samples = waveform.shape[-1]
    spectrum = np.fft.rfft(waveform) * gain(np.fft.rfftfreq(samples, 1 / GRID["sampling_rate"]))
    return np.fft.irfft(spectrum, n=samples)


def _wrong_equaliser(frequencies):
    """A slow wave of +-3 dB over the logarithm of frequency, as a decoder that is slightly off has it."""
    return 10 ** (3 * np.sin(2 * np.pi * np.log2(np.maximum(frequencies, 10) / 20) / 2.5) / 20)


def _measure(waveform):
    return measure_band_levels(waveform, count=COUNT, **GRID)


def _impose(waveform, levels):
    return impose_band_levels(waveform, levels, **GRID)


# --- measuring


def test_white_noise_is_near_zero_in_every_band():
    levels = _measure(_noise(64))
    assert levels.shape == (64, COUNT + 1, FRAMES) and levels.dtype == np.float64
    # 64 x 1.6 s of a band of 12 Hz: its mean power is known to 2 %
    np.testing.assert_allclose(np.exp(levels).mean((0, 2)), 1, rtol=0, atol=0.08)
    # a mean of logarithms lies below the logarithm of the mean, by up to 0.1 in the narrowest band
    assert np.abs(levels.mean((0, 2))).max() < 0.2


@pytest.mark.parametrize("index", range(COUNT + 1))
def test_a_band_twice_as_large_is_1_386_louder(index):
    low, high = [0.0, *EDGES[1:]][index], [*EDGES[1:], np.inf][index]
    noise = _noise()
    louder = _filtered(noise, lambda f: np.where((f >= low) & (f < high), 2.0, 1.0))
    difference = (_measure(louder) - _measure(noise)).mean((0, 2))
    # the window smears 5 Hz over a band's edge: the narrowest, of four bins, loses 0.1 and gives its neighbours 0.25
    assert difference[index] == pytest.approx(2 * np.log(2), abs=0.12)
    others = np.delete(difference, index)
    assert np.abs(others).max() < 0.3
    assert np.abs(difference[np.abs(np.arange(COUNT + 1) - index) > 1]).max() < 0.02


# --- imposing


def test_a_wrong_equaliser_is_undone():
    noise = _noise()
    wanted, wrong = _measure(noise), _filtered(noise, _wrong_equaliser)
    restored = _impose(wrong, wanted)
    before, after = (np.abs(_measure(made) - wanted).mean((0, 2)) * DB for made in (wrong, restored))
    assert before.max() > 2
    # one gain for a whole band: what leaks between the lowest bands, of four bins, is not undone
    assert after.max() < 0.5 and after[4:].max() < 0.15
    # and the waveform itself comes nearer, since phases are kept
    power = [np.square(made - noise).mean() for made in (wrong, restored)]
    assert power[1] < power[0] / 4


def test_a_waveform_with_the_right_levels_is_left_alone():
    noise = _noise(3)
    np.testing.assert_allclose(_impose(noise, _measure(noise)), noise, rtol=0, atol=5e-6)  # float32, up to 4


def test_silence_stays_silent():
    silent = np.zeros((1, 10 * HOP))
    levels = _measure(silent)
    np.testing.assert_allclose(levels, np.log(1e-6), rtol=1e-12)
    assert not _impose(silent, np.zeros_like(levels)).any()
    faded = _noise(1)
    faded[:, 2048:] = 0
    assert np.isfinite(_impose(faded, np.zeros((1, COUNT + 1, FRAMES)))).all()


@pytest.mark.parametrize("asked", [-30.0, -3.0, 3.0, 30.0])
def test_gains_are_limited(asked):
    noise = _noise(1)
    made = _impose(noise, _measure(noise) + asked)
    limit = LARGEST_GAIN_DB * np.log(10) / 20
    # 1e-6 of power, the floor, makes later passes correct a little
    np.testing.assert_allclose(made, np.exp(np.clip(asked / 2, -limit, limit)) * noise, rtol=0, atol=2e-5)


def test_bands_without_a_bin_are_refused():
    with pytest.raises(ValueError, match=r"`level_bands` of 60 leaves a band .* without a bin of 4.88 Hz"):
        measure_band_levels(_noise(1), count=60, **GRID)


# --- in the feature extractor


def test_features_begin_with_levels_once_for_each_frame_of_latents(make_extractor):
    extractor, plain, noise = make_extractor(**THREE), make_extractor(), _noise(2, 512)
    features, levels = extractor.features(noise), extractor.band_levels(noise)
    assert features.shape == (2, 28, 64) and levels.shape == (2, 4, 32)
    np.testing.assert_array_equal(features[:, :4, ::2], levels)
    np.testing.assert_array_equal(features[:, :4, 1::2], levels)
    np.testing.assert_array_equal(features[:, 4:], plain.features(noise))  # the others are as without


@pytest.mark.parametrize("rate", [2500, 10_000])
def test_denormalize_restores_band_levels(make_extractor, pink_noise, rate):
    extractor = make_extractor(delivery_rate=rate, **THREE)
    texture = pink_noise(rate * 2, rate, count=4)
    waveform, level = extractor.normalize(texture, rate)
    wanted = extractor.band_levels(waveform)
    wrong = _filtered(waveform, lambda f: np.maximum(f, 20) ** 0.3)  # tilted by 10 dB over the band
    errors = []
    for levels in (None, wanted):
        made = extractor.denormalize(wrong, level, texture.shape[-1], levels)
        assert made.shape == texture.shape and made.dtype == np.float32
        # exactly the level that was asked for, whatever the bands did (float32)
        np.testing.assert_allclose(np.log(rms(made)), level, rtol=0, atol=1e-5)
        heard = extractor.band_levels(extractor.normalize(made, rate)[0])
        errors.append(np.abs(heard - wanted)[:, :3].mean() * DB)  # nothing of this texture lies above the band
    assert errors[0] > 1 and errors[1] < 0.3 * errors[0]  # one gain for each of only three bands leaves a step between


# --- fast modulation


def _fast(waveform):
    return np.sqrt(np.square(measure_fast_modulation(waveform, count=COUNT, **GRID)).mean(axis=(0, 2)))


def test_modulation_gain_deepens_fast_modulation_band_by_band_and_keeps_levels():
    noise, modulation_gain = _noise(64), np.ones(COUNT + 1)
    modulation_gain[3], modulation_gain[5] = 1.5, 0.6
    made = impose_band_levels(noise, _measure(noise), **GRID, modulation_gain=np.tile(modulation_gain, (64, 1)))
    ratio = _fast(made) / _fast(noise)
    # gains change within the window that measures them, so a part of what is asked for is reached; bands lean over
    assert ratio[3] > 1.15 and ratio[5] < 0.9
    np.testing.assert_allclose(np.delete(ratio, [2, 3, 4, 5, 6]), 1, atol=0.06)
    assert np.abs(_measure(made) - _measure(noise)).mean() * DB < 0.2


def test_a_modulation_gain_of_another_shape_is_refused(make_extractor, pink_noise):
    extractor = make_extractor(**THREE)
    waveform, level = extractor.normalize(pink_noise(4096, 10_000), 10_000)
    with pytest.raises(ValueError, match=r"`modulation_gain` must be \(1, 4\)"):
        extractor.denormalize(waveform, level, None, extractor.band_levels(waveform), np.ones(4))
