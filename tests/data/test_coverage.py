"""Where in the space of ratings surfaces lie, and how far other ratings are from them."""

import numpy as np
import pytest
from scipy.spatial.distance import mahalanobis

from tactile_diffusers.data.ratings import rating_coverage
from tactile_diffusers.signal import coverage_distance


@pytest.fixture
def surfaces():
    """Ratings of 40 surfaces, correlated, unequally spread and off the middle."""
    mixing = np.array([[1.0, 0.0, 0.0], [0.8, 0.3, 0.0], [-0.2, 0.1, 2.0]])
    return np.random.default_rng(0).standard_normal((40, 3)) @ mixing.T + [0.5, -1.0, 2.0]


def test_centre_and_covariance_are_those_of_the_surfaces(surfaces):
    centre, covariance, _ = rating_coverage(surfaces)
    np.testing.assert_allclose(centre, surfaces.mean(0))
    np.testing.assert_allclose(covariance, np.cov(surfaces.T), atol=2e-6)  # 1e-6 is added to the diagonal


def test_distances_are_those_of_mahalanobis(surfaces):
    centre, covariance, reach = rating_coverage(surfaces)
    others = np.random.default_rng(1).standard_normal((10, 3)) * 3
    for rows in (surfaces, others):
        expected = [mahalanobis(row, centre, np.linalg.inv(covariance)) for row in rows]
        np.testing.assert_allclose(coverage_distance(rows, centre, covariance), expected, rtol=1e-10)
    assert reach == coverage_distance(surfaces, centre, covariance).max()
    # squares average to what a covariance over n - 1 leaves of three axes
    squares = coverage_distance(surfaces, centre, covariance) ** 2
    assert squares.mean() == pytest.approx(3 * 39 / 40, rel=1e-3)


@pytest.mark.parametrize("axes", [[0], [2], [0, 1], [1, 2]])
def test_axes_that_are_not_specified_are_left_out(surfaces, axes):
    centre, covariance, _ = rating_coverage(surfaces)
    rows = np.full((5, 3), np.nan)
    rows[:, axes] = np.random.default_rng(2).standard_normal((5, len(axes)))
    inverse = np.linalg.inv(covariance[np.ix_(axes, axes)])
    expected = [mahalanobis(row[axes], centre[axes], inverse) for row in rows]
    np.testing.assert_allclose(coverage_distance(rows, centre, covariance), expected, rtol=1e-10)


def test_rows_without_any_rating_have_no_distance(surfaces):
    centre, covariance, _ = rating_coverage(surfaces)
    distances = coverage_distance([[np.nan] * 3, centre.tolist(), [np.nan, centre[1], np.nan]], centre, covariance)
    assert np.isnan(distances[0]) and distances[1:].tolist() == [0.0, 0.0]


def test_lists_and_single_precision_give_the_same(surfaces):
    centre, covariance, _ = rating_coverage(surfaces)
    expected = coverage_distance(surfaces, centre, covariance)
    made = coverage_distance(surfaces.tolist(), centre.tolist(), covariance.tolist())
    np.testing.assert_array_equal(made, expected)
    single = coverage_distance(surfaces.astype(np.float32), centre, covariance)
    np.testing.assert_allclose(single, expected, rtol=1e-5)  # ratings to 6e-8 of a few, distances near 1


def test_surfaces_that_are_not_rated_on_all_axes_do_not_count(surfaces):
    expected = rating_coverage(surfaces[5:])
    surfaces[:5, [0, 1, 2, 0, 1]] = np.nan
    for made, wanted in zip(rating_coverage(surfaces), expected, strict=True):
        np.testing.assert_array_equal(made, wanted)


@pytest.mark.parametrize(("count", "enough"), [(0, False), (5, False), (6, True)])
def test_too_few_surfaces_settle_nothing(surfaces, count, enough):
    surfaces[count:, 1] = np.nan
    assert (rating_coverage(surfaces) is not None) == enough


def test_axes_that_are_always_rated_alike_stay_solvable(surfaces):
    surfaces[:, 1] = surfaces[:, 0]
    centre, covariance, reach = rating_coverage(surfaces)
    assert np.isfinite(reach) and reach < 10
    apart = coverage_distance([centre + [1.0, -1.0, 0.0]], centre, covariance)
    assert apart > 10 * reach  # where the two axes differ no surface has ever been
