"""The optional codec metrics: what they tell apart, what they cannot, and life without them."""

import sys
import warnings

import numpy as np
import pytest

from tactile_diffusers.evaluation.vibrotactile import vibromaf_metrics
from tactile_diffusers.signal import DEVICE_RATE, rms


@pytest.fixture
def vibromaf():
    return pytest.importorskip("vibromaf")


def test_without_the_package_the_error_names_the_extra(monkeypatch, held_out):
    for name in ("vibromaf", "vibromaf.metrics", "vibromaf.metrics.spqi", "vibromaf.metrics.stsim"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ImportError, match=r'pip install "tactile-diffusers\[vibromaf\]"'):
        vibromaf_metrics(held_out, held_out, DEVICE_RATE)


def test_an_identical_waveform_scores_one_and_noise_lowers_it(vibromaf, held_out):
    reference = held_out[:10]
    noise = np.random.default_rng(0).normal(size=reference.shape) * rms(reference)[:, None]
    perfect, good, bad = (vibromaf_metrics(reference + gain * noise, reference, DEVICE_RATE) for gain in (0, 0.1, 1))
    for name in ("spqi", "st_sim"):
        assert perfect[name].shape == (10,) and perfect[name].dtype == np.float64
        np.testing.assert_array_equal(perfect[name], 1)
        assert (perfect[name] > good[name]).all() and (good[name] > bad[name]).all()


def test_another_take_scores_as_noise_does(vibromaf, held_out, reference):
    other = reference[:20] / rms(reference[:20])[:, None] * rms(held_out[:20])[:, None]
    white = np.random.default_rng(1).normal(size=other.shape) * rms(held_out[:20])[:, None]
    for textures in (other, white):
        metrics = vibromaf_metrics(textures, held_out[:20], DEVICE_RATE)
        assert metrics["spqi"].max() < 0.05
        # independent textures correlate by about 1/30, to the power of 2/3
        assert abs(metrics["st_sim"]).max() < 0.25


def test_opposite_waveforms_have_a_real_negative_similarity(vibromaf, held_out):
    metrics = vibromaf_metrics(-held_out[:3], held_out[:3], DEVICE_RATE)
    # temporal similarity -1, spectral 1: the real part of (-1)^(2/3), a third of a turn
    np.testing.assert_allclose(metrics["st_sim"], -0.5, atol=1e-3)
    np.testing.assert_allclose(metrics["spqi"], 1, atol=1e-6)  # spectra have no sign


def test_silence_is_finite_and_quiet(vibromaf, held_out):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        metrics = vibromaf_metrics(np.zeros_like(held_out[:2]), held_out[:2], DEVICE_RATE)
        backwards = vibromaf_metrics(held_out[:2], np.zeros_like(held_out[:2]), DEVICE_RATE)
    for scores in (*metrics.values(), *backwards.values()):
        assert np.isfinite(scores).all() and (scores < 0.05).all()


def test_signals_are_resampled_to_eight_kilohertz(vibromaf, held_out, monkeypatch):
    seen = []
    monkeypatch.setattr("vibromaf.metrics.spqi.spqi", lambda a, b: seen.append((a.shape, b.shape)) or 1)
    vibromaf_metrics(held_out[:1], held_out[:1], DEVICE_RATE)
    assert seen == [((13108,), (13108,))]  # 16384 * 8 / 10, rounded up


def test_bad_input_is_refused(vibromaf, held_out):
    with pytest.raises(ValueError, match="must have the shape 2 axes"):
        vibromaf_metrics(held_out[0], held_out[0], DEVICE_RATE)
    with pytest.raises(ValueError, match="same shape"):
        vibromaf_metrics(held_out[:2], held_out[:3], DEVICE_RATE)
    with pytest.raises(ValueError, match="at least 64 ms.*got 62.5 ms"):
        vibromaf_metrics(held_out[:2, :625], held_out[:2, :625], DEVICE_RATE)
    with pytest.raises(ValueError, match="must be a positive whole number"):
        vibromaf_metrics(held_out[:2], held_out[:2], 0)
