"""Laws of the metrics: of two alike nothing, the same both ways, and gains where they belong."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_diffusers.evaluation.metrics.distances import (
    frechet_tactile_distance,
    kernel_tactile_distance,
    within_similarity,
)
from tactile_diffusers.evaluation.metrics.errors import (
    goodness_of_fit,
    level_error_db,
    log_spectral_distance_db,
    out_of_band_ratio_db,
    power_difference,
    rmse,
    signed_band_error_db,
    snr_db,
)
from tactile_diffusers.evaluation.metrics.statistics import leaf

RATE = 2500
samples = st.integers(600, 1500)
gains = st.floats(-3, 3).map(lambda power: 10.0**power)


def _pair(count, seed, rows=2):
    return np.random.default_rng(seed).standard_normal((2, rows, count))


@settings.get_profile("many")
@given(count=st.integers(1, 1500), seed=st.integers(0, 99), gain=gains)
def test_waveform_errors(count, seed, gain):
    texture, reference = _pair(count, seed)
    np.testing.assert_allclose(rmse(texture, reference), rmse(reference, texture))
    np.testing.assert_array_equal(rmse(texture, texture), 0)
    np.testing.assert_allclose(rmse(gain * texture, gain * reference), gain * rmse(texture, reference))
    np.testing.assert_allclose(snr_db(np.zeros_like(reference), reference), 0, atol=1e-9)
    np.testing.assert_allclose(snr_db(gain * texture, gain * reference), snr_db(texture, reference), atol=1e-6)
    np.testing.assert_allclose(power_difference(texture, reference), -power_difference(reference, texture))
    np.testing.assert_allclose(level_error_db(gain * texture, texture), 20 * np.log10(gain), atol=1e-6)
    assert np.isfinite(snr_db(texture, texture)).all() and np.isfinite(level_error_db(0 * texture, reference)).all()


@settings.get_profile("few")
@given(count=samples, seed=st.integers(0, 99), gain=gains)
def test_spectral_errors(count, seed, gain):
    texture, reference = _pair(count, seed)
    for distance in (log_spectral_distance_db, goodness_of_fit):
        np.testing.assert_allclose(distance(texture, reference, RATE), distance(reference, texture, RATE))
    np.testing.assert_allclose(
        log_spectral_distance_db(gain * texture, texture, RATE), abs(20 * np.log10(gain)), atol=1e-6
    )
    fit = goodness_of_fit(texture, reference, RATE)
    assert ((fit >= 0) & (fit <= 1 + 1e-12)).all()
    np.testing.assert_allclose(goodness_of_fit(gain * texture, texture, RATE), 1)
    np.testing.assert_array_equal(goodness_of_fit(0 * texture, texture, RATE), 0)
    bands = [(20, 200), (200, 1200)]
    errors = signed_band_error_db(texture, reference, RATE, bands)
    np.testing.assert_allclose(errors, -signed_band_error_db(reference, texture, RATE, bands), atol=1e-9)
    np.testing.assert_allclose(
        signed_band_error_db(gain * texture, texture, RATE, bands), 20 * np.log10(gain), atol=1e-6
    )
    share = out_of_band_ratio_db(texture, RATE)
    np.testing.assert_allclose(out_of_band_ratio_db(gain * texture, RATE), share, atol=1e-6)
    assert (share <= 1e-9).all() and (out_of_band_ratio_db(0 * texture, RATE) == -120).all()


@st.composite
def sets(draw):
    features = draw(st.integers(1, 5))
    rng = np.random.default_rng(draw(st.integers(0, 999)))
    a, b = (rng.standard_normal((draw(st.integers(features + 1, 30)), features)) for _ in range(2))
    return a, b + draw(st.sampled_from([0.0, 1.0, 100.0])), rng


@settings.get_profile("many")
@given(drawn=sets(), gain=gains)
def test_distances_of_sets(drawn, gain):
    a, b, rng = drawn
    turn = np.linalg.qr(rng.standard_normal((a.shape[1], a.shape[1])))[0]
    far = frechet_tactile_distance(a, b)
    close = {"rel": 1e-4, "abs": 1e-5}
    assert far == pytest.approx(frechet_tactile_distance(b, a), **close) and far > -1e-5
    assert frechet_tactile_distance(a, a) == pytest.approx(0, abs=1e-5)
    assert frechet_tactile_distance(gain * a, gain * b) == pytest.approx(gain**2 * far, rel=1e-4, abs=1e-5 * gain**2)
    assert frechet_tactile_distance(a @ turn + 3, b @ turn + 3) == pytest.approx(far, **close)
    assert frechet_tactile_distance(a, a + 2) == pytest.approx(4 * a.shape[1], rel=1e-4, abs=1e-4)
    width = 1.5
    kernel = kernel_tactile_distance(a, b, width)
    assert kernel == pytest.approx(kernel_tactile_distance(b, a, width))
    assert kernel == pytest.approx(kernel_tactile_distance(gain * a, gain * b, gain * width), abs=1e-6)
    assert kernel == pytest.approx(kernel_tactile_distance(a[::-1], rng.permutation(b), width), abs=1e-6)
    assert -4000 <= kernel <= 4000 and 0 <= within_similarity(a, width) <= 1
    alone = np.arange(len(a))
    assert kernel_tactile_distance(a, b, width, alone, None) == pytest.approx(kernel, abs=1e-9)


@settings.get_profile("many")
@given(
    values=st.lists(st.one_of(st.just(np.nan), st.floats(-1e6, 1e6)), max_size=12),
    groups=st.integers(1, 5),
    shift=st.floats(-100, 100),
)
def test_leaves(values, groups, shift):
    values = np.array(values)
    names = np.arange(len(values)) % groups
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = leaf(values, names)
    known = values[~np.isnan(values)]
    assert found["n"] == (len(known) or None)
    if not len(known):
        assert found["mean"] is found["interval"] is None
        return
    assert found["mean"] == pytest.approx(known.mean()) and found["min"] <= found["median"] <= found["max"]
    enough = len(set(names[~np.isnan(values)])) >= 3
    assert (found["interval"] is not None) == enough
    if enough:
        low, high = found["interval"]
        assert low <= found["mean"] + 1e-6 and found["mean"] - 1e-6 <= high
        moved = leaf(values + shift, names)["interval"]
        np.testing.assert_allclose(moved, np.array([low, high]) + shift, rtol=1e-6, atol=1e-4)
