"""`TactileFeatureExtractor` and `fit_preemphasis` at their edges: short, constant, loud, out of order."""

import numpy as np
import pytest
import torch

from tactile_diffusers.signal import DEVICE_RATE
from tactile_diffusers.training.fitting import fit_preemphasis


@pytest.mark.parametrize("value", [0.0, 1e-30, 1e-3, 0.3, -1e6])
@pytest.mark.parametrize(("samples", "rate"), [(1, 10_000), (2, 10_000), (777, 44_100), (4096, 2500), (4096, 10_000)])
def test_a_constant_is_silence(make_extractor, value, samples, rate):
    extractor = make_extractor(level_bands=1, detail_samples=2)
    waveform, levels = extractor.normalize(np.full((1, samples), value), rate)
    assert not waveform.any() and levels == pytest.approx(0.5 * np.log(1e-30), rel=1e-6)
    assert not extractor.features(waveform)[:, 26:].any()  # nothing in the detail
    assert not extractor.denormalize(waveform, levels).any()


def test_a_mean_is_taken_away_before_anything_is_measured(make_extractor, pink_noise):
    extractor, texture = make_extractor(), pink_noise(8192, DEVICE_RATE, count=2)
    shape, levels = extractor.normalize(texture, DEVICE_RATE)
    shifted, shifted_levels = extractor.normalize(texture + np.array([[0.5], [-100.0]]), DEVICE_RATE)
    np.testing.assert_allclose(shifted, shape, rtol=0, atol=1e-5)  # float32 up to 5; 1e-16 of 100 N beside 0.01 N
    np.testing.assert_allclose(shifted_levels, levels, rtol=0, atol=1e-6)


def test_features_are_local_in_time(make_extractor, pink_noise):
    extractor, waveform = make_extractor(), np.random.default_rng(0).normal(size=(1, 2048))
    changed = waveform.copy()
    changed[:, 1024:1032] += 3.0
    difference = np.abs(extractor.features(changed) - extractor.features(waveform)).max((0, 1))
    reach = max(extractor.window_lengths) // 2 // extractor.hop_length + 1
    assert difference[128] > 0.1 and not difference[: 128 - reach].any() and not difference[128 + reach + 1 :].any()


# --- fit_preemphasis


@pytest.mark.parametrize("textures", [np.zeros((3, 8192)), np.zeros((0, 8192))], ids=["silence", "none"])
def test_a_fit_of_nothing_is_refused(textures):
    # NaN gains would be written into the config and make every feature NaN
    with pytest.raises(ValueError, match="`textures`"):
        fit_preemphasis(textures, DEVICE_RATE)


# --- band levels


@pytest.mark.parametrize("windows", [[16, 30], [64, 65]], ids=["short", "odd"])
def test_windows_that_cannot_restore_band_levels_are_refused(make_extractor, windows):
    message = rf"`level_bands` need an even window of at least two latent frames \(2 x 16 samples\), got {windows[-1]}"
    with pytest.raises(ValueError, match=message):
        make_extractor(level_bands=1, window_lengths=windows)
    make_extractor(window_lengths=windows)  # without levels any window will do


def test_an_extractor_without_level_bands_measures_none(make_extractor):
    with pytest.raises(ValueError, match="`level_bands` is 0: this feature extractor measures no levels of bands"):
        make_extractor().band_levels(np.zeros((1, 64)))


@pytest.mark.parametrize(
    ("bands", "shape"),
    [(1, (2, 3, 8)), (1, (2, 2, 7)), (1, (1, 2, 8)), (1, (2, 8)), (0, (2, 2, 8)), (0, (2, 1, 8))],
    ids=["bands", "frames", "rows", "rank", "none measured", "none measured, one"],
)
def test_band_levels_of_another_shape_are_refused(make_extractor, bands, shape):
    extractor = make_extractor(level_bands=bands)
    fits = r"\(2, 2, 8\)" if bands else "None"
    message = rf"`band_levels` must be {fits} for a waveform of \(2, 128\)"
    waveform, levels = np.random.default_rng(0).normal(size=(2, 128)), np.zeros(2)
    for kind in (np.zeros, torch.zeros):
        with pytest.raises(ValueError, match=message):
            extractor.denormalize(waveform, levels, band_levels=kind(shape))
    assert extractor.denormalize(waveform, levels).shape == (2, 512)
