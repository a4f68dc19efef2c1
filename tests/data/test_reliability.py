"""How far raters agree: mean correlation of pairs and Cronbach's alpha, against slow references."""

import numpy as np
import pytest

from tactile_diffusers.data import RaterScores, pool_ratings
from tactile_diffusers.data.ratings import no_ratings, rating_reliability
from tactile_diffusers.signal import RATING_AXES

SURFACES = tuple(f"s{i}" for i in range(20))


def _scores(values, axes=RATING_AXES):
    return RaterScores(values, tuple(f"r{i}" for i in range(len(values))), SURFACES[: values.shape[1]], axes)


@pytest.fixture
def values():
    """(6, 20, 3): six raters who hear the same surface, less and less well from axis to axis."""
    rng = np.random.default_rng(0)
    truth = rng.standard_normal((20, 3))
    noise = rng.standard_normal((6, 20, 3)) * [0.4, 0.9, 2.0]
    gain = rng.uniform(0.5, 1.5, (6, 1, 1))
    return np.clip(np.round(4 + gain * (truth + noise)), 0, 8).astype(np.float32)


def _pairs(answers):
    """Correlation of every pair of raters over the surfaces that both rated, if 3 or more and different."""
    found = {}
    for i in range(len(answers)):
        for j in range(i):
            both = ~np.isnan(answers[i]) & ~np.isnan(answers[j])
            a, b = answers[i, both].astype(np.float64), answers[j, both].astype(np.float64)
            if both.sum() >= 3 and np.ptp(a) and np.ptp(b):
                found[i, j] = np.corrcoef(a, b)[0, 1]
    return found


def _cronbach(scores):
    """Cronbach's alpha by its definition: (raters, surfaces), nothing missing."""
    k = len(scores)
    return k / (k - 1) * (1 - scores.var(axis=1, ddof=1).sum() / scores.sum(axis=0).var(ddof=1))


def test_complete_answers_give_cronbachs_alpha_of_the_z_scores(values):
    found = rating_reliability(_scores(values))
    z = (values - values.mean(1, keepdims=True)) / values.std(1, keepdims=True)
    for axis in range(3):
        pairs = list(_pairs(values[:, :, axis]).values())
        assert found.mean_correlation[axis] == pytest.approx(np.mean(pairs), abs=1e-6)  # float32 answers
        assert found.alpha[axis] == pytest.approx(_cronbach(z[:, :, axis]), abs=1e-5)
    assert found.axes == RATING_AXES
    assert found.pairs.tolist() == [15] * 3 and found.raters.tolist() == [6] * 3
    assert found.raters_per_surface.tolist() == [6] * 3
    assert found.alpha[0] > found.alpha[1] > found.alpha[2] > 0


@pytest.mark.parametrize("seed", range(20))
def test_missing_answers_against_a_slow_reference(values, seed):
    rng = np.random.default_rng(seed)
    values[rng.random(values.shape) < 0.6] = np.nan
    values[4, :, 1] = np.where(np.isnan(values[4, :, 1]), np.nan, 3)  # constant: in no pair
    values[5, 1:, 2] = np.nan  # a single answer: in no pair
    found = rating_reliability(_scores(values))
    for axis in range(3):
        answers = values[:, :, axis]
        pairs = _pairs(answers)
        paired = sorted({rater for pair in pairs for rater in pair})
        counts = [n for n in (~np.isnan(answers[paired])).sum(0) if n]
        r, k = np.mean(list(pairs.values())), np.mean(counts)
        assert found.mean_correlation[axis] == pytest.approx(r, abs=1e-6)
        assert found.raters_per_surface[axis] == pytest.approx(k, abs=1e-12)
        assert found.alpha[axis] == pytest.approx(k * r / (1 + (k - 1) * r), abs=1e-5)
        assert (found.pairs[axis], found.raters[axis]) == (len(pairs), len(paired))
    assert found.raters[1] <= 5 and found.raters[2] <= 5


def test_units_of_a_rater_do_not_matter(values):
    before = rating_reliability(_scores(values))
    values[2] = 8 - 0.5 * (8 - values[2])  # another mean and scale
    after = rating_reliability(_scores(values))
    np.testing.assert_allclose(after.alpha, before.alpha, atol=1e-6)  # float32


def test_alpha_foretells_how_well_the_mean_over_raters_repeats():
    rng = np.random.default_rng(1)
    truth = rng.standard_normal((1, 4000, 3))
    first, second = (truth + 1.5 * rng.standard_normal((8, 4000, 3)) for _ in range(2))
    names = tuple(map(str, range(4000)))
    found = rating_reliability(RaterScores(first, tuple("abcdefgh"), names, RATING_AXES))
    # two panels of eight raters; a correlation over 4000 surfaces has a standard error of 0.006
    repeated = [np.corrcoef(first[..., a].mean(0), second[..., a].mean(0))[0, 1] for a in range(3)]
    np.testing.assert_allclose(found.alpha, repeated, atol=0.03)


def test_nothing_to_compare_is_nan():
    answers = np.full((3, 6, 3), np.nan, np.float32)
    answers[0, :3, 0], answers[1, 1:4, 0] = [1, 2, 3], [4, 5, 7]  # two surfaces in common
    answers[:, :, 1] = 4  # all alike
    answers[0, :, 2] = range(6)  # one rater
    found = rating_reliability(_scores(answers))
    assert np.isnan([found.mean_correlation, found.alpha, found.raters_per_surface]).all()
    assert not found.pairs.any() and not found.raters.any()
    assert "roughness: mean inter-rater correlation nan (0 pairs of 0 raters)" in str(found)


def test_raters_who_contradict_each_other_have_no_alpha():
    line = np.arange(6, dtype=np.float32)
    answers = np.repeat(np.stack([line, 5 - line])[..., None], 3, axis=2)
    found = rating_reliability(_scores(answers))
    np.testing.assert_allclose(found.mean_correlation, -1, atol=1e-6)
    assert np.isnan(found.alpha).all()


def test_any_axes_of_the_answers(values):
    scores = _scores(values, ("hardness", "roughness", "warmth"))
    found = rating_reliability(scores, scores.axes)
    assert found.axes == ("hardness", "roughness", "warmth")
    one = rating_reliability(scores, ("roughness",))
    assert one.alpha.shape == (1,) and one.alpha[0] == found.alpha[1] != found.alpha[0]
    with pytest.raises(ValueError, match=r"lacks the axes \['bumpiness', 'slipperiness'\]"):
        rating_reliability(scores)


def test_pooled_ratings_carry_it(values):
    training = np.arange(20) < 12
    pooled = pool_ratings(_scores(values), list(SURFACES), training)
    expected = rating_reliability(_scores(values))
    np.testing.assert_array_equal(pooled.reliability.alpha, expected.alpha)
    lines = str(pooled.reliability).splitlines()
    assert [line.split(":")[0] for line in lines] == list(RATING_AXES)
    assert f"correlation {expected.mean_correlation[0]:.2f} (15 pairs of 6 raters)" in lines[0]
    assert f"alpha {expected.alpha[0]:.2f} (6.0 raters a surface)" in lines[0]
    assert no_ratings(4).reliability is None
