"""The two distances against closed forms."""

import numpy as np
import pytest
from scipy.linalg import sqrtm

from tactile_diffusers.evaluation import frechet_tactile_distance, kernel_tactile_distance


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


@pytest.mark.parametrize("distance", [frechet_tactile_distance, lambda a, b: kernel_tactile_distance(a, b, 1.0)])
def test_sets_that_do_not_fit_are_refused(distance):
    good = np.random.default_rng(6).normal(size=(20, 3))
    bad = good.copy()
    bad[4, 1] = np.nan
    with pytest.raises(ValueError, match="same features"):
        distance(good, good[:, :2])
    with pytest.raises(ValueError, match=r"`b` must be finite, got nan at index \[4, 1\]"):
        distance(good, bad)
    with pytest.raises(ValueError, match="must have the shape"):
        distance(good[0], good)


def test_too_few_members_are_refused():
    a = np.random.default_rng(7).normal(size=(53, 53))
    with pytest.raises(ValueError, match="more than 53 members for a covariance.*got 53.*kernel_tactile_distance"):
        frechet_tactile_distance(a, a)
    with pytest.raises(ValueError, match="at least 2 members"):
        kernel_tactile_distance(a[:1], a, 1.0)
    with pytest.raises(ValueError, match="`width` must be above zero"):
        kernel_tactile_distance(a, a, 0.0)


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
