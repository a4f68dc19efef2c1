"""Ratings: standardised on training surfaces only, pooled once; how far raters agree; where surfaces lie."""

import numpy as np
import pytest
from scipy.spatial.distance import mahalanobis

from tactile_diffusers.data import RaterScores, pool_ratings
from tactile_diffusers.data.ratings import QUANTILES, axis_correlation, rating_coverage, rating_quantiles
from tactile_diffusers.data.ratings import rating_reliability as reliability_of
from tactile_diffusers.signal import RATING_AXES, coverage_distance
from tactile_diffusers.signal.rating_scales import from_percentile, from_raw

TRAINING = np.array([True] * 6 + [False] * 3)
SURFACES = [f"s{i}" for i in range(9)]


@pytest.fixture
def scores():
    values = np.random.default_rng(0).integers(0, 9, (4, 9, 3)).astype(np.float32)
    return RaterScores(values, ("a", "b", "c", "d"), tuple(SURFACES), RATING_AXES)


class TestPooling:
    def test_equals_the_formula(self, scores):
        pooled = pool_ratings(scores, SURFACES, TRAINING)
        train = scores.values[:, :6].astype(np.float64)
        z = (scores.values - train.mean(1, keepdims=True)) / train.std(1, keepdims=True)
        np.testing.assert_allclose(pooled.mean, z.mean(0), atol=1e-6)  # float32
        np.testing.assert_allclose(pooled.std, z.std(0), atol=1e-6)
        np.testing.assert_allclose(pooled.single, z, atol=1e-5)
        np.testing.assert_allclose(pooled.raw_mean, train.mean((0, 1)), atol=1e-6)
        np.testing.assert_allclose(pooled.raw_scale, train.std(1).mean(0), atol=1e-6)
        assert (pooled.count == 4).all() and not pooled.left_out
        assert pooled.mean[:6].std(0).max() < 0.9  # never standardised again: raters disagree

    def test_only_training_surfaces_set_the_scale(self, scores):
        before = pool_ratings(scores, SURFACES, TRAINING)
        scores.values[:, 6:] = 8 - scores.values[:, 6:]
        after = pool_ratings(scores, SURFACES, TRAINING)
        np.testing.assert_array_equal(after.mean[:6], before.mean[:6])
        np.testing.assert_array_equal(after.raw_scale, before.raw_scale)
        assert not np.allclose(after.mean[6:], before.mean[6:])

    def test_raters_without_two_answers_in_training_are_reported_and_left_out(self, scores):
        scores.values[0, 1:6, 0] = np.nan  # "a" gave one answer on roughness in training, and others elsewhere
        scores.values[1, :6] = np.nan  # "b" rated only surfaces outside training
        scores.values[2, :6, 1] = 5
        pooled = pool_ratings(scores, SURFACES, TRAINING)
        assert pooled.left_out == [
            "a on roughness: one answer on training surfaces",
            *(f"b on {axis}: no answer on training surfaces" for axis in RATING_AXES),
            "c on bumpiness: the same answer on all training surfaces",
        ]
        assert pooled.count[7].tolist() == [2, 2, 3]
        others = RaterScores(scores.values[2:], ("c", "d"), scores.surfaces, RATING_AXES)
        alone = pool_ratings(others, SURFACES, TRAINING)
        np.testing.assert_array_equal(pooled.mean[:, 0], alone.mean[:, 0])
        np.testing.assert_array_equal(pooled.raw_mean[0], alone.raw_mean[0])

    def test_rounding_does_not_make_a_constant_rater_differ(self, scores):
        answers = np.full(9, 0.1)  # of a scale that is not whole: in float64 the mean of six of them is not 0.1
        assert np.mean(answers[:6]) != 0.1 and np.std(answers[:6]) > 0
        values = scores.values.astype(np.float64)
        values[3, :, 2] = answers
        pooled = pool_ratings(RaterScores(values, scores.raters, scores.surfaces, RATING_AXES), SURFACES, TRAINING)
        assert pooled.left_out == ["d on slipperiness: the same answer on all training surfaces"]

    def test_missing_answers_and_unrated_surfaces(self, scores):
        scores.values[0, 0] = np.nan
        scores.values[:, 8, 2] = np.nan
        pooled = pool_ratings(scores, [*SURFACES, "unrated"], np.append(TRAINING, True))
        assert pooled.count[:, 0].tolist() == [3, 4, 4, 4, 4, 4, 4, 4, 4, 0]
        assert np.isnan(pooled.mean[9]).all() and np.isnan(pooled.mean[8, 2]) and np.isfinite(pooled.mean[8, :2]).all()

    def test_order_of_surfaces_and_axes_is_by_name(self, scores):
        shuffled = RaterScores(scores.values[:, ::-1, ::-1], scores.raters, scores.surfaces[::-1], RATING_AXES[::-1])
        first, second = (pool_ratings(one, SURFACES, TRAINING).mean for one in (shuffled, scores))
        np.testing.assert_array_equal(first, second)

    def test_impossible_ratings_are_errors(self, scores):
        renamed = RaterScores(scores.values, scores.raters, scores.surfaces, ("first", *RATING_AXES[1:]))
        twice = RaterScores(scores.values, scores.raters, (*SURFACES[:8], "s2"), RATING_AXES)
        alike = RaterScores(scores.values * [0, 1, 1], scores.raters, scores.surfaces, RATING_AXES)
        for bad, message in (
            (alike, "No rater differs between training surfaces on roughness"),
            (renamed, r"lacks the axes \['roughness'\]"),
            (twice, "surface 's2' more than once"),
        ):
            with pytest.raises(ValueError, match=message):
                pool_ratings(bad, SURFACES, TRAINING)


class TestReliability:
    @pytest.fixture
    def values(self):
        """(6, 20, 3): six raters of the same surfaces, who agree less and less from axis to axis."""
        rng = np.random.default_rng(0)
        noise = rng.standard_normal((6, 20, 3)) * [0.4, 0.9, 2.0]
        gain = rng.uniform(0.5, 1.5, (6, 1, 1))
        return np.clip(np.round(4 + gain * (rng.standard_normal((20, 3)) + noise)), 0, 8).astype(np.float32)

    @staticmethod
    def scores(values, axes=RATING_AXES):
        names = tuple(f"s{i}" for i in range(values.shape[1]))
        return RaterScores(values, tuple(f"r{i}" for i in range(len(values))), names, axes)

    def test_complete_answers_give_cronbachs_alpha_of_the_z_scores(self, values):
        found = reliability_of(self.scores(values))
        z = (values - values.mean(1, keepdims=True)) / values.std(1, keepdims=True)
        for axis in range(3):
            answers = z[:, :, axis]
            by_definition = 6 / 5 * (1 - answers.var(axis=1, ddof=1).sum() / answers.sum(axis=0).var(ddof=1))
            assert found.alpha[axis] == pytest.approx(by_definition, abs=1e-5)
            pairs = np.corrcoef(answers)[np.triu_indices(6, 1)]
            assert found.mean_correlation[axis] == pytest.approx(pairs.mean(), abs=1e-6)  # float32 answers
        assert found.pairs.tolist() == [15] * 3 and found.raters.tolist() == [6] * 3
        assert found.alpha[0] > found.alpha[1] > found.alpha[2] > 0
        pooled = pool_ratings(self.scores(values), [f"s{i}" for i in range(20)], np.arange(20) < 12)
        np.testing.assert_array_equal(pooled.reliability.alpha, found.alpha)

    def test_alpha_predicts_how_well_the_mean_over_raters_repeats(self):
        rng = np.random.default_rng(1)
        truth = rng.standard_normal((1, 4000, 3))
        first, second = (truth + 1.5 * rng.standard_normal((8, 4000, 3)) for _ in range(2))
        # two panels of eight raters; a correlation over 4000 surfaces has a standard error of 0.006
        repeated = [np.corrcoef(first[..., a].mean(0), second[..., a].mean(0))[0, 1] for a in range(3)]
        np.testing.assert_allclose(reliability_of(self.scores(first)).alpha, repeated, atol=0.03)

    def test_nothing_to_compare_is_nan(self):
        answers = np.full((3, 6, 3), np.nan, np.float32)
        answers[0, :3, 0], answers[1, 1:4, 0] = [1, 2, 3], [4, 5, 7]  # two surfaces in common
        answers[:, :, 1] = 4  # all alike
        answers[0, :, 2] = range(6)  # one rater
        found = reliability_of(self.scores(answers))
        assert np.isnan([found.mean_correlation, found.alpha, found.raters_per_surface]).all()
        assert not found.pairs.any() and not found.raters.any()
        assert "roughness: mean inter-rater correlation nan (0 pairs of 0 raters)" in str(found)
        line = np.arange(6, dtype=np.float32)
        contrary = np.repeat(np.stack([line, 5 - line])[..., None], 3, axis=2)
        assert np.isnan(reliability_of(self.scores(contrary)).alpha).all()

    def test_any_axes_of_the_answers(self, values):
        scores = self.scores(values, ("hardness", "roughness", "warmth"))
        found, one = reliability_of(scores, scores.axes), reliability_of(scores, ("roughness",))
        assert one.alpha.shape == (1,) and one.alpha[0] == found.alpha[1] != found.alpha[0]
        with pytest.raises(ValueError, match=r"lacks the axes \['bumpiness', 'slipperiness'\]"):
            reliability_of(scores)


class TestCoverage:
    @pytest.fixture
    def surfaces(self):
        """Ratings of 40 surfaces, correlated, unequally spread and off the middle."""
        mixing = np.array([[1.0, 0.0, 0.0], [0.8, 0.3, 0.0], [-0.2, 0.1, 2.0]])
        return np.random.default_rng(0).standard_normal((40, 3)) @ mixing.T + [0.5, -1.0, 2.0]

    @pytest.mark.parametrize("axes", [[0], [2], [0, 1], [1, 2], [0, 1, 2]])
    def test_distances_are_those_of_mahalanobis(self, surfaces, axes):
        """Axes that are not specified are left out."""
        centre, covariance, reach = rating_coverage(surfaces)
        np.testing.assert_allclose(covariance, np.cov(surfaces.T), atol=2e-6)  # 1e-6 is added to the diagonal
        rows = np.full((5, 3), np.nan)
        rows[:, axes] = np.random.default_rng(2).standard_normal((5, len(axes)))
        inverse = np.linalg.inv(covariance[np.ix_(axes, axes)])
        expected = [mahalanobis(row[axes], centre[axes], inverse) for row in rows]
        np.testing.assert_allclose(coverage_distance(rows, centre, covariance), expected, rtol=1e-10)
        found = coverage_distance(rows.tolist(), centre.tolist(), covariance.tolist())
        np.testing.assert_allclose(found, expected, rtol=1e-10)
        assert reach == coverage_distance(surfaces, centre, covariance).max()

    def test_rows_without_any_rating_have_no_distance(self, surfaces):
        centre, covariance, _ = rating_coverage(surfaces)
        distances = coverage_distance([[np.nan] * 3, centre.tolist(), [np.nan, centre[1], np.nan]], centre, covariance)
        assert np.isnan(distances[0]) and distances[1:].tolist() == [0.0, 0.0]

    def test_surfaces_that_are_not_rated_on_all_axes_do_not_count(self, surfaces):
        expected = rating_coverage(surfaces[5:])
        surfaces[:5, [0, 1, 2, 0, 1]] = np.nan
        for found, wanted in zip(rating_coverage(surfaces), expected, strict=True):
            np.testing.assert_array_equal(found, wanted)
        assert rating_coverage(surfaces[:10]) is None

    def test_axes_that_are_always_rated_alike_stay_solvable(self, surfaces):
        surfaces[:, 1] = surfaces[:, 0]
        centre, covariance, reach = rating_coverage(surfaces)
        assert np.isfinite(reach) and reach < 10
        apart = coverage_distance([centre + [1.0, -1.0, 0.0]], centre, covariance)
        assert apart > 10 * reach  # where the two axes differ no surface has ever been


def test_raw_answers():
    mean, scale = np.array([4.0, 3, 5]), np.array([2.0, 1, 0.5])
    np.testing.assert_allclose(from_raw([[6, 2, 6]], mean, scale), [[1.0, -1, 2]])


def test_quantiles_of_the_known_ratings():
    rng = np.random.default_rng(0)
    mean = np.full((201, 3), np.nan, np.float32)
    mean[:, 0] = rng.permutation(np.linspace(-1, 3, 201))
    mean[:40, 1] = rng.standard_normal(40)
    table = rating_quantiles(mean)
    assert table.shape == (3, QUANTILES)
    # the 201 ratings are themselves the quantiles at 0, 0.5, ... 100 %
    np.testing.assert_allclose(table[0], np.linspace(-1, 3, QUANTILES), atol=1e-6)  # float32
    assert table[1, [0, -1]].tolist() == [mean[:40, 1].min(), mean[:40, 1].max()] and np.isnan(table[2]).all()
    skewed = rng.gamma(2.0, size=(480, 1))
    for percentile in (2, 33, 50, 88, 99):
        below = np.mean(skewed < from_percentile([percentile], rating_quantiles(skewed)))
        # within one of the table's steps of 5 % a skewed distribution is up to 2 % from straight
        assert below == pytest.approx(percentile / 100, abs=0.02)


def test_percentiles_run_straight_between_quantiles():
    table = np.array([[-1.0, 0.0, 4.0], [-2.0, -2.0, 2.0]])
    percentiles = [[0, 0], [25, 25], [50, 50], [75, 75], [100, 100], [np.nan, 50]]
    ratings = from_percentile(percentiles, table)
    np.testing.assert_allclose(ratings, [[-1, -2], [-0.5, -2], [0, -2], [2, 0], [4, 2], [np.nan, -2]])


def test_correlation_of_axes_over_surfaces_rated_on_both():
    mean = np.random.default_rng(2).standard_normal((30, 3))
    mean[:, 1] += mean[:, 0]
    mean[3:9, 1] = mean[5:20, 0] = mean[2:, 2] = np.nan
    matrix = axis_correlation(mean)
    both = [i for i in range(30) if not np.isnan(mean[i, :2]).any()]
    expected = np.corrcoef(mean[both, 0], mean[both, 1])[0, 1]
    np.testing.assert_allclose(matrix[:2, :2], [[1, expected], [expected, 1]], atol=1e-12)
    assert len(both) == 13 and np.isnan(matrix[2]).all()  # two surfaces are too few
