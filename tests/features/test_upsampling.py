"""The quick way to a multiple of the sampling rate against the ordinary one."""

import numpy as np
import pytest

from tactile_diffusers.features.upsampling import resample_quickly
from tactile_diffusers.signal import resample


@pytest.mark.parametrize(("rate_in", "rate_out"), [(2500, 5000), (2500, 7500), (2500, 10_000), (2000, 10_000)])
@pytest.mark.parametrize("samples", [1, 7, 500, 4096])
def test_a_multiple_of_the_rate_is_what_resample_makes(rate_in, rate_out, samples):
    texture = np.random.default_rng(samples).standard_normal((3, samples))
    made = resample_quickly(texture, rate_in, rate_out)
    assert made.dtype == np.float64
    # float32, sums of a hundred products near 1
    np.testing.assert_allclose(made, resample(texture, rate_in, rate_out), rtol=0, atol=5e-6)


@pytest.mark.parametrize(("rate_in", "rate_out"), [(2500, 2500), (2500, 8000), (10_000, 2500)])
def test_other_rates_are_left_to_resample(rate_in, rate_out):
    texture = np.random.default_rng(0).standard_normal((2, 1000))
    assert np.array_equal(resample_quickly(texture, rate_in, rate_out), resample(texture, rate_in, rate_out))
