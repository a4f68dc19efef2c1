"""The judge on planted laws, and response matrices whose answer is known."""

import numpy as np
import pytest

from tactile_diffusers.evaluation.judge import Judge, explained, response_matrix
from tactile_diffusers.evaluation.metrics.statistics import jackknife

FEATURES = 12


def planted(law, surfaces=80, per_surface=4, noise=0.2, seed=0):
    """Textures of surfaces that differ by `FEATURES` numbers and log friction; takes of a surface differ a little.

    Args:
        law: (surface features (S, 12), log friction (S,)) -> ratings (S, 3).

    Returns:
        points, log friction, ratings, surface_ids.
    """
    rng = np.random.default_rng(seed)
    centres, friction = rng.standard_normal((surfaces, FEATURES)), 0.4 * rng.standard_normal(surfaces)
    ratings = law(centres, friction) + noise * rng.standard_normal((surfaces, 3))
    ids = np.repeat(np.arange(surfaces), per_surface)
    points = centres[ids] + 0.1 * rng.standard_normal((len(ids), FEATURES))
    return points, friction[ids] + 0.02 * rng.standard_normal(len(ids)) - 0.5, ratings[ids], ids


def linear(centres, friction):
    return np.stack([0.7 * centres[:, 0], 0.5 * centres[:, 1] - 0.5 * centres[:, 2], -1.75 * friction], axis=-1)


def curved(centres, friction):
    radius = (centres[:, :2] ** 2).sum(1)
    return np.stack([radius - 2, 0.8 * centres[:, 2], 0.7 * np.abs(centres[:, 3])], axis=-1)


def noise_only(centres, friction):
    return np.random.default_rng(70).standard_normal((len(centres), 3))


def _r2(judge, points, friction, ratings):
    return explained(judge.predict(points, friction), ratings)


def test_linear_law_is_recovered():
    judge = Judge.fit(*planted(linear))
    points, friction, ratings, ids = planted(linear, seed=1)
    r2 = _r2(judge, points, friction, ratings)
    # planted: signal variance 0.49, noise 0.04, so at most 0.92; 80 training surfaces cost a few percent
    assert (r2 > 0.8).all() and (r2 < 0.97).all()
    predicted = judge.predict(points, friction)
    assert predicted.shape == (len(points), 3)
    np.testing.assert_allclose(r2, 1 - ((predicted - ratings) ** 2).sum(0) / ((ratings - ratings.mean(0)) ** 2).sum(0))
    np.testing.assert_allclose(response_matrix(predicted, ratings), np.diag(r2), atol=0.15)


def test_curved_law_needs_the_kernel():
    training, held_out = planted(curved, 200, 3), planted(curved, 200, 3, seed=1)
    judge = Judge.fit(*training)
    assert judge.choices[0]["width"] is not None
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tactile_diffusers.evaluation.judge.KERNEL_WIDTHS", (None,))
        ridge = Judge.fit(*training)
    assert [choice["width"] for choice in ridge.choices] == [None] * 3
    # a parabola is uncorrelated with its argument: plain ridge explains nothing of it
    assert _r2(judge, *held_out[:3])[0] > 0.6 and _r2(ridge, *held_out[:3])[0] < 0.1
    assert _r2(judge, *held_out[:3])[1] > _r2(ridge, *held_out[:3])[1] - 0.02


def test_noise_is_not_explained():
    training = planted(noise_only)
    judge = Judge.fit(*training)
    points, friction, _, ids = planted(noise_only, seed=1)
    other = np.random.default_rng(8).standard_normal((80, 3))[ids]
    assert (_r2(judge, points, friction, other) < 0.1).all()
    # takes of a surface stay in one fold: else the nearest take would give its rating away
    # (chance among 80 surfaces and 18 settings: 0.07 in one of 20)
    assert all(choice["r2"] < 0.1 for choice in judge.choices)


def test_unknown_friction_is_left_out():
    points, friction, ratings, ids = planted(linear)
    judge = Judge.fit(points, np.full(len(points), np.nan), ratings, ids)
    assert judge.friction is None and judge.inputs.shape[1] == FEATURES
    np.testing.assert_array_equal(judge.predict(points, friction), judge.predict(points, friction * np.nan))
    assert judge.choices[2]["r2"] < 0.2  # the axis that friction alone carries
    with_friction = Judge.fit(points, friction, ratings, ids)
    assert with_friction.friction == pytest.approx((friction.mean(), friction.std()))
    assert with_friction.inputs.shape[1] == FEATURES + 1
    constant = Judge.fit(points, np.full(len(points), -0.7), ratings, ids)
    assert np.isfinite(constant.predict(points, friction)).all()


def requests(count=60, takes=5, seed=0):
    rng = np.random.default_rng(seed)
    ids = np.repeat(np.arange(count), takes)
    return (rng.standard_normal((count, 3)) @ [[0.8, 0.3, 0], [0, 0.6, 0], [0, 0, 0.7]])[ids], ids


def test_leakage_is_found_where_it_is():
    requested, ids = requests()
    planted_slopes = np.array([[0.8, 0.4, 0.0], [0.0, 0.5, 0.0], [-0.3, 0.0, 0.6]])  # [recovered, requested]
    rng = np.random.default_rng(2)
    recovered = requested @ planted_slopes.T + 0.3 * rng.standard_normal(requested.shape)
    slopes, (low, high) = jackknife(lambda mask: response_matrix(recovered[mask], requested[mask]), ids)
    np.testing.assert_allclose(slopes, planted_slopes, atol=0.12)  # four standard errors of 0.03
    assert low[0, 1] > 0.2 and high[2, 0] < -0.1  # found, and not by correlation of the requests
    assert np.mean((low < planted_slopes) & (planted_slopes < high)) >= 7 / 9


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda p, f, r, i: (p, f, r[:-1], i), "inconsistent numbers of samples"),
        (lambda p, f, r, i: (p[:, 0], f, r, i), "Expected 2D array"),
        (lambda p, f, r, i: (np.where(p == p[7, 0], np.inf, p), f, r, i), "points contains infinity"),
        (lambda p, f, r, i: (p, np.where(i == 1, np.nan, f), r, i), "log_friction contains NaN"),
        (lambda p, f, r, i: (p, f, np.where(i[:, None] < 71, np.nan, r), i), "of 9 surfaces .* at least 10"),
    ],
)
def test_bad_training_data_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        Judge.fit(*change(*planted(linear)))


def test_requests_that_settle_no_slopes_are_refused():
    requested, groups = requests(6)
    with pytest.raises(ValueError, match="must vary along all axes"):
        response_matrix(requested, requested * [1, 1, 0])
