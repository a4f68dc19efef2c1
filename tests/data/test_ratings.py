"""Ratings: standardised on training surfaces only, pooled once; the scales in which they are given."""

import numpy as np
import pytest

from tactile_diffusers.data import RaterScores, pool_ratings
from tactile_diffusers.data.ratings import QUANTILES, axis_correlation, no_ratings, rating_quantiles
from tactile_diffusers.signal import RATING_AXES
from tactile_diffusers.signal.rating_scales import from_percentile, from_raw, to_raw

TRAINING = np.array([True] * 6 + [False] * 3)
SURFACES = [f"s{i}" for i in range(9)]


@pytest.fixture
def scores():
    values = np.random.default_rng(0).integers(0, 9, (4, 9, 3)).astype(np.float32)
    return RaterScores(values, ("a", "b", "c", "d"), tuple(SURFACES), RATING_AXES)


def test_equals_the_formula(scores):
    pooled = pool_ratings(scores, SURFACES, TRAINING)
    train = scores.values[:, :6].astype(np.float64)
    z = (scores.values - train.mean(1, keepdims=True)) / train.std(1, keepdims=True)
    np.testing.assert_allclose(pooled.mean, z.mean(0), atol=1e-6)  # float32
    np.testing.assert_allclose(pooled.std, z.std(0), atol=1e-6)
    np.testing.assert_allclose(pooled.raw_mean, train.mean((0, 1)), atol=1e-6)
    np.testing.assert_allclose(pooled.raw_scale, train.std(1).mean(0), atol=1e-6)
    assert (pooled.count == 4).all() and not pooled.left_out
    assert pooled.mean[:6].std(0).max() < 0.9  # never standardised again: raters disagree


def test_only_training_surfaces_set_the_scale(scores):
    before = pool_ratings(scores, SURFACES, TRAINING)
    scores.values[:, 6:] = 8 - scores.values[:, 6:]
    after = pool_ratings(scores, SURFACES, TRAINING)
    np.testing.assert_array_equal(after.mean[:6], before.mean[:6])
    np.testing.assert_array_equal(after.raw_scale, before.raw_scale)
    assert not np.allclose(after.mean[6:], before.mean[6:])


def test_rater_with_one_answer_is_left_out_of_that_axis(scores):
    scores.values[2, :6, 1] = 5
    pooled = pool_ratings(scores, SURFACES, TRAINING)
    assert pooled.left_out == ["c on bumpiness: the same answer on all training surfaces"]
    assert pooled.count[0].tolist() == [4, 3, 4] and np.isfinite(pooled.mean).all()
    others = RaterScores(scores.values[[0, 1, 3]], ("a", "b", "d"), scores.surfaces, RATING_AXES)
    np.testing.assert_allclose(pooled.mean[:, 1], pool_ratings(others, SURFACES, TRAINING).mean[:, 1], atol=1e-6)


def test_raters_without_two_answers_in_training_are_reported_and_left_out(scores):
    scores.values[0, 1:6, 0] = np.nan  # "a" gave one answer on roughness in training, and others elsewhere
    scores.values[1, :6] = np.nan  # "b" rated only surfaces outside training
    pooled = pool_ratings(scores, SURFACES, TRAINING)
    assert pooled.left_out == [
        "a on roughness: one answer on training surfaces",
        *(f"b on {axis}: no answer on training surfaces" for axis in RATING_AXES),
    ]
    assert pooled.count[7].tolist() == [2, 3, 3]
    others = RaterScores(scores.values[2:], ("c", "d"), scores.surfaces, RATING_AXES)
    alone = pool_ratings(others, SURFACES, TRAINING)
    np.testing.assert_array_equal(pooled.mean[:, 0], alone.mean[:, 0])
    np.testing.assert_array_equal(pooled.raw_mean[0], alone.raw_mean[0])


def test_rounding_does_not_make_a_constant_rater_differ(scores):
    answers = np.full(9, 0.1)  # of a scale that is not whole: in float64 the mean of six of them is not 0.1
    assert np.mean(answers[:6]) != 0.1 and np.std(answers[:6]) > 0
    values = scores.values.astype(np.float64)
    values[3, :, 2] = answers
    pooled = pool_ratings(RaterScores(values, scores.raters, scores.surfaces, RATING_AXES), SURFACES, TRAINING)
    assert pooled.left_out == ["d on slipperiness: the same answer on all training surfaces"]


def test_missing_answers_and_unrated_surfaces(scores):
    scores.values[0, 0] = np.nan
    scores.values[:, 8, 2] = np.nan
    pooled = pool_ratings(scores, [*SURFACES, "unrated"], np.append(TRAINING, True))
    assert pooled.count[:, 0].tolist() == [3, 4, 4, 4, 4, 4, 4, 4, 4, 0]
    assert np.isnan(pooled.mean[9]).all() and np.isnan(pooled.mean[8, 2]) and np.isfinite(pooled.mean[8, :2]).all()


def test_order_of_surfaces_and_axes_is_by_name(scores):
    shuffled = RaterScores(scores.values[:, ::-1, ::-1], scores.raters, scores.surfaces[::-1], RATING_AXES[::-1])
    np.testing.assert_array_equal(
        pool_ratings(shuffled, SURFACES, TRAINING).mean, pool_ratings(scores, SURFACES, TRAINING).mean
    )


def test_z_scores_of_each_rater_are_kept_and_average_to_the_pooled_mean(scores):
    scores.values[0, 0] = scores.values[3, 7, 1] = np.nan  # no answer
    scores.values[2, :6, 1] = 5  # left out of this axis
    pooled = pool_ratings(scores, SURFACES, TRAINING)
    assert pooled.single.shape == (4, 9, 3) and pooled.single.dtype == np.float32
    np.testing.assert_allclose(np.nanmean(pooled.single, axis=0), pooled.mean, atol=1e-6)  # float32
    np.testing.assert_allclose(np.nanstd(pooled.single, axis=0), pooled.std, atol=1e-6)
    expected = np.isnan(scores.values)
    expected[2, :, 1] = True
    np.testing.assert_array_equal(np.isnan(pooled.single), expected)
    # every rater's own scale, on training surfaces
    np.testing.assert_allclose(np.nanmean(pooled.single[:, :6, [0, 2]], axis=1), 0, atol=1e-6)
    np.testing.assert_allclose(np.nanstd(pooled.single[:, :6, [0, 2]], axis=1), 1, atol=1e-6)
    shuffled = [SURFACES[i] for i in (8, 0, 4)]
    few = pool_ratings(scores, [*shuffled, *SURFACES[1:4]], np.ones(6, dtype=bool))
    assert np.isnan(few.single[0, 1]).all() and np.isfinite(few.single[1]).all()  # in the order of the surfaces


def test_nobody_has_no_single_ratings():
    assert no_ratings(4).single is None


def test_impossible_ratings_are_errors(scores):
    scores.values[:, :, 0] = 4
    with pytest.raises(ValueError, match="No rater differs between training surfaces on roughness"):
        pool_ratings(scores, SURFACES, TRAINING)
    renamed = RaterScores(scores.values, scores.raters, scores.surfaces, ("rough", *RATING_AXES[1:]))
    with pytest.raises(ValueError, match="lacks the axes \\['roughness'\\]"):
        pool_ratings(renamed, SURFACES, TRAINING)
    twice = RaterScores(scores.values, scores.raters, (*SURFACES[:8], "s2"), RATING_AXES)
    with pytest.raises(ValueError, match="surface 's2' more than once"):
        pool_ratings(twice, SURFACES, TRAINING)


def test_raw_and_back():
    mean, scale, ratings = np.array([4.0, 3, 5]), np.array([2.0, 1, 0.5]), np.array([[1.0, -1, 2]])
    np.testing.assert_allclose(to_raw(ratings, mean, scale), [[6, 2, 6]])
    np.testing.assert_allclose(from_raw(to_raw(ratings, mean, scale), mean, scale), ratings)


def test_quantiles_of_the_known_ratings():
    rng = np.random.default_rng(0)
    mean = np.full((201, 3), np.nan, np.float32)
    mean[:, 0] = rng.permutation(np.linspace(-1, 3, 201))
    mean[:40, 1] = rng.standard_normal(40)
    table = rating_quantiles(mean)
    assert table.shape == (3, QUANTILES)
    # the 201 ratings are themselves the quantiles at 0, 0.5, ... 100 %
    np.testing.assert_allclose(table[0], np.linspace(-1, 3, QUANTILES), atol=1e-6)  # float32
    assert (np.diff(table[:2]) >= 0).all()
    assert table[1, [0, -1]].tolist() == [mean[:40, 1].min(), mean[:40, 1].max()]
    assert np.isnan(table[2]).all()


def test_percentiles_run_straight_between_quantiles():
    table = np.array([[-1.0, 0.0, 4.0], [-2.0, -2.0, 2.0]])
    percentiles = [[0, 0], [25, 25], [50, 50], [75, 75], [100, 100], [np.nan, 50]]
    ratings = from_percentile(percentiles, table)
    np.testing.assert_allclose(ratings, [[-1, -2], [-0.5, -2], [0, -2], [2, 0], [4, 2], [np.nan, -2]])


def test_a_share_of_surfaces_lies_below_its_percentile():
    mean = np.random.default_rng(1).gamma(2.0, size=(480, 1))  # skewed, as ratings may be
    for percentile in (2, 33, 50, 88, 99):
        below = np.mean(mean < from_percentile([percentile], rating_quantiles(mean)))
        # within one of the table's steps of 5 % a skewed distribution is up to 2 % from straight
        assert below == pytest.approx(percentile / 100, abs=0.02)


def test_correlation_of_axes_over_surfaces_rated_on_both():
    mean = np.random.default_rng(2).standard_normal((30, 3))
    mean[:, 1] += mean[:, 0]
    mean[3:9, 1] = mean[5:20, 0] = mean[2:, 2] = np.nan
    matrix = axis_correlation(mean)
    both = [i for i in range(30) if not np.isnan(mean[i, :2]).any()]
    assert len(both) == 13
    expected = np.corrcoef(mean[both, 0], mean[both, 1])[0, 1]
    np.testing.assert_allclose(matrix[:2, :2], [[1, expected], [expected, 1]], atol=1e-12)
    assert np.isnan(matrix[2]).all()  # two surfaces are too few
