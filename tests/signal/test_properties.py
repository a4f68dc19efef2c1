"""Filters, resampling and spectra on signals of any length, size and form."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_diffusers.signal import (
    band_levels_db,
    band_pass,
    coverage_distance,
    level,
    nine_band_error_db,
    power_spectral_density,
    resample,
    rms,
)

RATES = (2500, 8000, 10_000, 10_007, 44_100)
common_rates = st.sampled_from([2500, 8000, 10_000, 12_000])  # others take filters of a million taps
lengths = st.one_of(st.integers(1, 12), st.integers(1, 6000))
sizes = st.floats(-9, 9).map(lambda power: 10.0**power)
leading = st.sampled_from([(), (1,), (3,), (2, 2)])


def _noise(shape, seed=0):
    return np.random.default_rng(seed).standard_normal(shape)


@settings.get_profile("many")
@given(samples=lengths, rate=st.sampled_from(RATES), before=leading, passes=st.sampled_from([1, 2]), size=sizes)
def test_the_band_pass_is_linear_and_keeps_shapes(samples, rate, before, passes, size):
    first, second = _noise((2, *before, samples))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = band_pass(size * first, rate, passes=passes)
        both = band_pass(size * (first + second), rate, passes=passes)
    assert made.shape == (*before, samples) and made.dtype == np.float64 and np.isfinite(made).all()
    # padding turns the ends about themselves, which is linear too
    other = band_pass(size * second, rate, passes=passes)
    np.testing.assert_allclose(both, made + other, atol=1e-7 * size)
    np.testing.assert_array_equal(band_pass(np.zeros(samples), rate, passes=passes), 0)


@settings.get_profile("many")
@given(samples=lengths, rate_in=common_rates, rate_out=common_rates, before=leading, size=sizes)
def test_resampling_has_the_documented_length(samples, rate_in, rate_out, before, size):
    texture = size * _noise((*before, samples))
    made = resample(texture, rate_in, rate_out)
    assert made.shape == (*before, -(-samples * rate_out // rate_in)) and np.isfinite(made).all()
    assert np.abs(made).max() <= 3 * np.abs(texture).max()
    np.testing.assert_allclose(resample(2 * texture, rate_in, rate_out), 2 * made, rtol=1e-9, atol=1e-9 * size)
    if rate_in == rate_out:
        np.testing.assert_array_equal(made, texture)


@settings.get_profile("few")
@given(seconds=st.floats(0.3, 0.6), there=st.sampled_from([(2500, 10_000), (8000, 12_000)]))
def test_resampling_there_and_back_keeps_the_band(seconds, there):
    slow, fast = there
    texture = band_pass(_noise(round(seconds * slow)), slow)
    fade = np.hanning(len(texture))  # nothing at the ends, where the signal is cut
    back = resample(resample(fade * texture, slow, fast), fast, slow)[: len(texture)]
    assert rms(back - fade * texture) < 1e-3 * rms(fade * texture)


@settings.get_profile("many")
@given(samples=st.integers(1, 9000), rate=st.sampled_from(RATES), before=leading, size=sizes)
def test_nine_bands_are_there_or_refused(samples, rate, before, size):
    texture = size * _noise((*before, samples))
    # every band needs a bin: the narrowest one, from 20 Hz on, is 10.9 Hz wide
    try:
        found = band_levels_db(texture, rate)
    except ValueError as error:
        assert "`texture`" in str(error) and rate / samples > 5
        return
    assert found.shape == (*before, 9) and np.isfinite(found).all()
    # a gain is a shift of every level, as long as no floor of 1e-30 N^2 is near
    np.testing.assert_allclose(band_levels_db(10 * texture, rate), found + 20, atol=1e-6)
    np.testing.assert_array_equal(nine_band_error_db(texture, texture, rate), 0)
    other = _noise((*before, samples), 1)
    forth, back = nine_band_error_db(texture, other, rate), nine_band_error_db(other, texture, rate)
    np.testing.assert_allclose(forth, back)
    assert (forth >= 0).all()


@settings.get_profile("many")
@given(samples=lengths, rate=st.sampled_from(RATES), before=leading, size=sizes)
def test_levels_and_densities(samples, rate, before, size):
    texture = size * _noise((*before, samples))
    np.testing.assert_allclose(level(texture), np.log(rms(texture)), atol=1e-9)
    np.testing.assert_allclose(level(3 * texture), level(texture) + np.log(3), atol=1e-9)
    assert np.isfinite(level(np.zeros((*before, samples)))).all()
    frequencies, density = power_spectral_density(texture, rate)
    assert density.shape == (*before, len(frequencies)) and (density >= 0).all() and np.isfinite(density).all()
    assert frequencies[0] == 0 and frequencies[-1] <= rate / 2 * (1 + 1e-9)


@settings.get_profile("many")
@given(
    points=st.lists(st.lists(st.one_of(st.just(np.nan), st.floats(-9, 9)), min_size=3, max_size=3), max_size=5),
    seed=st.integers(0, 99),
)
def test_coverage_distance_is_a_distance(points, seed):
    root = _noise((3, 3), seed)
    centre, covariance = _noise(3, seed + 1), root @ root.T + 0.1 * np.eye(3)
    points = np.array(points).reshape(-1, 3)
    found = coverage_distance(points, centre, covariance)
    assert found.shape == (len(points),)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(points).all(1))
    assert (found[~np.isnan(found)] >= 0).all()
    np.testing.assert_allclose(coverage_distance(centre[None], centre, covariance), 0, atol=1e-12)
    # twice as far away is twice the distance
    np.testing.assert_allclose(coverage_distance(2 * points - centre, centre, covariance), 2 * found, atol=1e-6)


@pytest.mark.parametrize("rate", [0, -1, 2.5, float("nan"), float("inf")])
def test_impossible_rates_are_refused_by_name(rate):
    for rates in ((rate, 1000), (1000, rate)):
        with pytest.raises(ValueError, match="`rate_"):
            resample(np.zeros(10), *rates)


@pytest.mark.parametrize("passes", [1, 2])
@pytest.mark.parametrize("shape", [(0,), (3, 0)])
def test_no_samples_are_refused_by_name(shape, passes):
    with pytest.raises(ValueError, match="`texture`"):
        band_pass(np.zeros(shape), 10_000, passes=passes)
