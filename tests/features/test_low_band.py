"""The low end of the waveform as fewer samples: what is kept, what is left out, both ends, and the detail features."""

import numpy as np
import pytest
import torch

from tactile_diffusers.features.low_band import REACH, pulse, sample_low_band, synthesize

RATE, STRIDE = 2500, 4  # 16 samples of each 64, up to 312 Hz


def _noise(samples, rows=3, seed=0):
    return np.random.default_rng(seed).normal(size=(rows, samples))


def _back(waveform, stride=STRIDE, dtype=torch.float64):
    """Sampling and synthesis: (rows, samples) float64."""
    return synthesize(torch.from_numpy(sample_low_band(waveform, stride)).to(dtype), stride)[:, 0].double().numpy()


def _tone(frequency, samples=4096):
    return np.cos(2 * np.pi * frequency * np.arange(samples) / RATE + 0.3)[None]


def _decibel(part, whole):
    return 10 * np.log10(np.square(part).mean() / np.square(whole).mean())


@pytest.mark.parametrize("stride", [2, 4, 8, 64])
def test_pulses_are_orthonormal(stride):
    made = pulse(stride)
    assert made.shape == (2 * REACH * stride,) and made.dtype == torch.float32 and made.isfinite().all()
    torch.testing.assert_close(made, made.flip(0), rtol=0, atol=1e-5)  # float32
    made = made.double()
    assert made.square().sum().item() == pytest.approx(1, abs=1e-6)
    overlaps = [(made[k * stride :] @ made[: -k * stride]).item() for k in range(1, 2 * REACH)]
    assert np.abs(overlaps).max() < 5e-4  # cut off where its tails are 1e-3: 2e-4 was measured


@pytest.mark.parametrize("stride", [2, 4, 8, 16])
@pytest.mark.parametrize("count", [1, 2, 5, 200])
def test_the_projection_is_one_up_to_both_ends(stride, count):
    waveform = _noise(count * stride)
    low_band = sample_low_band(waveform, stride)
    assert low_band.shape == (3, count) and low_band.dtype == np.float64
    once = _back(waveform, stride)
    assert once.shape == waveform.shape
    # sampled again it gives the same samples, of about 1; overlaps of up to 62 pulses by 2e-4 at most
    np.testing.assert_allclose(sample_low_band(once, stride), low_band, rtol=0, atol=0.01)


def test_samples_of_white_noise_have_unit_variance_and_a_quarter_of_its_power():
    waveform = _noise(40_000)
    low_band = sample_low_band(waveform, STRIDE)
    # 30,000 samples: their variance is known to 0.8 %, all of it in the waveform (Parseval)
    assert low_band.var() == pytest.approx(1, abs=0.04)
    assert np.square(_back(waveform)).sum() == pytest.approx(np.square(low_band).sum(), rel=0.01)


@pytest.mark.parametrize("frequency", [0, 20, 100, 200])
def test_low_tones_survive(frequency):
    tone = _tone(frequency)
    error, inside = _back(tone) - tone, slice(REACH * STRIDE, -REACH * STRIDE)
    assert _decibel(error[:, inside], tone) < -40  # by the cut-off tails; 52 to 75 dB were measured
    assert _decibel(error, tone) < -25  # mirrored ends have a kink, of one pulse's length in 1.6 s


@pytest.mark.parametrize("frequency", [420, 600, 1200])
def test_high_tones_vanish(frequency):
    tone = _tone(frequency)
    assert _decibel(_back(tone)[:, REACH * STRIDE : -REACH * STRIDE], tone) < -40


# --- in the feature extractor


def _extractor(make_extractor, count, **changes):
    return make_extractor(**{"detail_samples": count} | changes)


def test_features_end_with_the_samples_of_each_latent_frame(make_extractor):
    waveform = _noise(512)
    features = _extractor(make_extractor, 4).features(waveform)
    assert features.shape == (3, 28, 64)
    for phase in (0, 1):  # two feature frames for each of the latents
        heard = features[:, 24:, phase::2].transpose(0, 2, 1).reshape(3, -1)
        np.testing.assert_allclose(heard, sample_low_band(waveform, 4), rtol=0, atol=1e-6)  # float32
    np.testing.assert_array_equal(features[:, :24], make_extractor().features(waveform))  # the others are as without
    levelled = _extractor(make_extractor, 4, level_bands=1).features(waveform)
    np.testing.assert_array_equal(levelled[:, 2:], features)


@pytest.mark.parametrize("count", [-1, 3, 5, 16, 17, 32])
def test_counts_that_do_not_divide_half_a_frame_are_refused(make_extractor, count):
    with pytest.raises(
        ValueError, match=rf"`detail_samples` must be .*\(none\) or .*divide half of the 16 .* got {count}\b"
    ):
        _extractor(make_extractor, count)
