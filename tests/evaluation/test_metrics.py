"""Errors of textures, distances of sets and summaries: known answers, and laws that hold for any numbers."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import sqrtm

from tactile_diffusers.evaluation import (
    frechet_tactile_distance,
    goodness_of_fit,
    kernel_tactile_distance,
    level_error_db,
    log_spectral_distance_db,
    out_of_band_ratio_db,
    rmse,
    signed_band_error_db,
    snr_db,
)
from tactile_diffusers.evaluation.metrics.distances import Reference, within_similarity
from tactile_diffusers.evaluation.metrics.errors import power_difference
from tactile_diffusers.evaluation.metrics.statistics import is_leaf, leaf, number
from tactile_diffusers.signal import DEVICE_RATE, rms

BANDS = ((20, 60), (60, 150), (400, 650), (650, 1000), (1000, 1200))


def test_snr_and_rmse_of_noise_at_a_tenth(held_out):
    noise = np.random.default_rng(5).normal(size=held_out.shape)
    noise *= 0.1 * rms(held_out)[:, None] / rms(noise)[:, None]
    np.testing.assert_allclose(snr_db(held_out + noise, held_out), 20)
    np.testing.assert_allclose(rmse(held_out + noise, held_out), 0.1 * rms(held_out))


def test_goodness_of_fit_is_its_formula(held_out):
    from scipy.signal import welch

    first, second = (
        np.sqrt(welch(texture, fs=DEVICE_RATE, nperseg=2000)[1][4:201])
        for texture in held_out[:2]  # 20 to 1000 Hz
    )
    expected = abs(first @ second) / np.sqrt((first @ first) * (second @ second))
    assert goodness_of_fit(held_out[0], held_out[1], DEVICE_RATE) == pytest.approx(expected)


def test_textures_that_cannot_be_compared_are_refused(held_out):
    texture = held_out[0]
    bad = np.where(np.arange(len(texture)) == 3, np.nan, texture)
    for refused, message in (
        (lambda: snr_db(texture, bad), r"`reference` must be finite, got nan at index \[3\]"),
        (lambda: rmse(texture, texture[::4]), "same shape.*Bring both to one sampling rate"),
        (lambda: signed_band_error_db(texture, texture, 2500, [(1000, 1300)]), "`bands` must lie inside"),
        (lambda: log_spectral_distance_db(texture[:4], texture[:4], DEVICE_RATE, band=(20, 30)), "no frequency bin"),
        (lambda: rmse(texture * 1j, texture), "must hold real numbers, got dtype complex128"),
        (lambda: rmse(texture[:0], texture[:0]), "not be empty"),
    ):
        with pytest.raises(ValueError, match=message):
            refused()


def _exact_gaussian(mean, covariance, count, rng):
    """Samples whose sample mean and covariance are exactly the given ones."""
    samples = rng.normal(size=(count, len(mean)))
    samples -= samples.mean(0)
    whitened = samples @ np.linalg.inv(np.linalg.cholesky(np.cov(samples, rowvar=False))).T
    return mean + whitened @ np.linalg.cholesky(covariance).T


def test_ftd_of_general_gaussians_is_the_formula_with_a_matrix_root():
    rng = np.random.default_rng(1)
    roots = rng.normal(size=(2, 6, 6))
    covariance_a, covariance_b = (root @ root.T + np.eye(6) for root in roots)
    a = _exact_gaussian(np.zeros(6), covariance_a, 50, rng)
    b = _exact_gaussian(np.ones(6), covariance_b, 60, rng)
    expected = 6 + np.trace(covariance_a + covariance_b - 2 * sqrtm(covariance_a @ covariance_b).real)
    assert frechet_tactile_distance(a, b) == pytest.approx(expected, rel=1e-8)


def test_ktd_of_shifted_gaussians_is_the_closed_form():
    # x - y is normal with variance 2, so E exp(-|x - y|^2 / w^2) = (1 + 4 / w^2)^(-d/2) exp(-shift^2 / (w^2 + 4))
    rng = np.random.default_rng(4)
    dimension, width, shift = 5, 3.0, 1.5
    offset = np.full(dimension, shift / np.sqrt(dimension))
    same = (1 + 4 / width**2) ** (-dimension / 2)
    expected = 1000 * 2 * same * (1 - np.exp(-(shift**2) / (width**2 + 4)))
    values = [
        kernel_tactile_distance(rng.normal(size=(100, dimension)), rng.normal(size=(100, dimension)) + offset, width)
        for _ in range(100)
    ]
    standard_error = np.std(values, ddof=1) / np.sqrt(len(values))
    assert abs(np.mean(values) - expected) < 3 * standard_error
    assert standard_error < 0.05 * expected  # or the line above would show nothing


def test_ktd_of_clustered_sets_is_unbiased_only_without_pairs_of_one_cluster():
    """40 surfaces of 4 alike takes against 100: leaving out pairs of one surface gives zero on average, keeping them
    does not. The mean of 60 draws is known to its standard error."""
    rng, kept, left_out = np.random.default_rng(5), [], []

    def clustered(surfaces):
        groups = np.repeat(np.arange(surfaces), 4)
        return rng.normal(size=(surfaces, 6))[groups] + 0.3 * rng.normal(size=(4 * surfaces, 6)), groups

    for _ in range(60):
        (a, a_groups), (b, b_groups) = clustered(40), clustered(100)
        kept.append(kernel_tactile_distance(a, b, 3.0))
        left_out.append(kernel_tactile_distance(a, b, 3.0, a_groups, b_groups))
    error = np.std(left_out, ddof=1) / np.sqrt(60)
    assert abs(np.mean(left_out)) < 3 * error < np.mean(kept)
    with pytest.raises(ValueError, match="at least 2 groups"):
        kernel_tactile_distance(a, b, 3.0, np.zeros(len(a)))


def test_leaf_of_a_mean_has_the_textbook_interval():
    values = np.random.default_rng(0).normal(3.0, 2.0, 50)
    made = leaf(values)
    error = values.std(ddof=1) / np.sqrt(50)  # the jackknife of a mean is exactly its standard error
    assert made["mean"] == pytest.approx(values.mean()) and made["median"] == pytest.approx(np.median(values))
    assert (made["n"], made["min"], made["max"]) == (50, values.min(), values.max())
    reach = 2.0096 * error  # Student's t of 49 degrees of freedom
    assert made["interval"] == pytest.approx([values.mean() - reach, values.mean() + reach], rel=1e-4)
    assert is_leaf(made) and is_leaf(number()) and not is_leaf({"mean": 1.0})


def test_interval_counts_surfaces_not_segments():
    """Four copies of each of 20 values carry no more than the 20: the interval must not shrink."""
    values = np.random.default_rng(1).normal(size=20)
    once, copied = leaf(values), leaf(np.repeat(values, 4), np.repeat(np.arange(20), 4))
    assert copied["interval"] == pytest.approx(once["interval"])
    assert copied["n"] == 80


def test_missing_values_and_nothing():
    assert leaf([1.0, np.nan, 3.0])["mean"] == 2.0 and leaf([1.0, np.nan, 3.0])["n"] == 2
    assert leaf([])["mean"] is None and leaf(None)["n"] is None and leaf([np.nan])["interval"] is None
    assert leaf([1.0, 2.0])["interval"] is None  # two units say nothing about a spread over units
    assert number(np.inf)["mean"] is None


def test_reference_distances_are_those_of_the_functions(reference, held_out):
    frozen = Reference(reference, DEVICE_RATE)
    points, groups = frozen.embed(held_out), np.repeat(np.arange(25), 4)
    found = frozen.distances(points, groups)
    assert found["ktd"]["mean"] == pytest.approx(
        kernel_tactile_distance(points, frozen.points, frozen.embedding.width, groups)
    )
    assert found["ftd"]["mean"] == pytest.approx(frechet_tactile_distance(points, frozen.points))
    for name in ("ftd", "ktd"):
        low, high = found[name]["interval"]
        assert low < found[name]["mean"] < high
    few = frozen.distances(points[:40], groups[:40])
    assert few["ftd"]["mean"] is None and few["ktd"]["mean"] is not None  # 40 members have no covariance of 53


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


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        ((20, 3), (20, 2), "same features"),
        ((20,), (20, 3), "must have the shape"),
        ((53, 53), (53, 53), "more than 53 members for a covariance"),
    ],
)
def test_sets_that_do_not_fit_are_refused(a, b, message):
    with pytest.raises(ValueError, match=message):
        frechet_tactile_distance(np.ones(a), np.ones(b))
