"""Resampling: by Fourier's series to any rate, and in single precision to a multiple of the rate."""

import numpy as np
import pytest
import torch

from tactile_diffusers.signal import resample
from tactile_diffusers.signal.resampling import KEPT_SHARE, num_samples


def resample_freely(*arguments):
    return resample(*arguments, method="fourier")


def _sine(frequency, rate, samples):
    return np.cos(2 * np.pi * frequency * np.arange(samples) / rate)


@pytest.mark.parametrize("rate_out", [8000, 8137.0, 533.3333, 10000, 44100, 100 * np.pi])
def test_what_lies_below_both_nyquist_frequencies_is_kept(rate_out):
    frequency = 0.8 * min(rate_out, 10000) / 2
    found = resample_freely(_sine(frequency, 10000, 8000), 10000, rate_out)
    assert len(found) == num_samples(8000, 10000, rate_out) == int(np.ceil(0.8 * rate_out - 1e-6))
    # a cosine does not go on as its image does, so near the Nyquist frequency its ends ring: 1 % a few periods away
    inner = slice(len(found) // 8, -len(found) // 8)
    np.testing.assert_allclose(found[inner], _sine(frequency, rate_out, len(found))[inner], atol=0.01)


def test_what_lies_above_is_left_out():
    for rate_out, share in ((500, 1.1), (500, 4.0)):
        found = resample_freely(_sine(share * rate_out / 2, 10000, 8000), 10000, rate_out)
        # rings at the end only; an alias would have the amplitude 1
        assert np.abs(found[20:-20]).max() < 0.02
    assert KEPT_SHARE < 1


def test_there_and_back_is_the_same(pink_noise):
    texture = pink_noise(16384, 10000)[0]
    for rate in (8000, 8137.0):
        back = resample_freely(resample_freely(texture, 10000, rate), rate, 10000, len(texture))
        error = back - texture
        # 900 Hz at 8 kHz: the cubic errs by some 2 (900/64000)^4 = 1e-7; at the ends by more
        assert len(back) == len(texture) and 10 * np.log10(np.mean(texture**2) / np.mean(error**2)) > 80


def test_one_sample_and_constants():
    np.testing.assert_allclose(resample_freely(np.ones(1), 10000, 8000), [1])
    np.testing.assert_allclose(resample_freely(np.full(300, 3.0), 10000, 777.7), 3, rtol=1e-9)


@pytest.mark.parametrize(
    ("rate_in", "rate_out"), [(2500, 5000), (2500, 7500), (2500, 10_000), (2000, 10_000), (2500, 8000), (10_000, 2500)]
)
@pytest.mark.parametrize("samples", [1, 7, 500, 4096])
def test_single_precision_gives_the_same_texture(rate_in, rate_out, samples):
    texture = np.random.default_rng(samples).standard_normal((3, samples))
    quick = resample(texture, rate_in, rate_out, dtype=np.float32)
    assert quick.dtype == np.float32
    # float32, sums of a hundred products near 1
    np.testing.assert_allclose(quick, resample(texture, rate_in, rate_out), rtol=0, atol=5e-6)


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_autocast_of_a_caller_changes_nothing(dtype):
    texture = np.random.default_rng(0).standard_normal(2500).astype(np.float32)
    plain = resample(texture, 2500, 10_000, dtype=np.float32)
    with torch.autocast("cpu", dtype=dtype):
        np.testing.assert_array_equal(resample(texture, 2500, 10_000, dtype=np.float32), plain)
