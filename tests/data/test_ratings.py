"""Ratings: standardised on training surfaces only, pooled once."""

import numpy as np
import pytest

from tactile_diffusers.data import RaterScores, from_raw, pool_ratings, to_raw
from tactile_diffusers.signal import RATING_AXES

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
    assert pooled.left_out == ["c on bumpiness: the same answer everywhere"]
    assert pooled.count[0].tolist() == [4, 3, 4] and np.isfinite(pooled.mean).all()
    others = RaterScores(scores.values[[0, 1, 3]], ("a", "b", "d"), scores.surfaces, RATING_AXES)
    np.testing.assert_allclose(pooled.mean[:, 1], pool_ratings(others, SURFACES, TRAINING).mean[:, 1], atol=1e-6)


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


def test_impossible_ratings_are_errors(scores):
    scores.values[:, :, 0] = 4
    with pytest.raises(ValueError, match="No rater differs between training surfaces on roughness"):
        pool_ratings(scores, SURFACES, TRAINING)
    renamed = RaterScores(scores.values, scores.raters, scores.surfaces, ("rough", *RATING_AXES[1:]))
    with pytest.raises(ValueError, match="lacks the axes \\['roughness'\\]"):
        pool_ratings(renamed, SURFACES, TRAINING)


def test_raw_and_back():
    mean, scale, ratings = np.array([4.0, 3, 5]), np.array([2.0, 1, 0.5]), np.array([[1.0, -1, 2]])
    np.testing.assert_allclose(to_raw(ratings, mean, scale), [[6, 2, 6]])
    np.testing.assert_allclose(from_raw(to_raw(ratings, mean, scale), mean, scale), ratings)
