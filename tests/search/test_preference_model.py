"""The model of a taste: what it believes after which answers."""

import numpy as np
import pytest

from tactile_diffusers.search.preference_model import AMPLITUDES, PreferenceModel, _covariance, _likelihood, _prior_mean


def _compared(count=40, seed=0, noise=0.0, dimensions=2):
    """Pairs, answers of somebody who likes (0.8, -0.5), and that point."""
    rng, taste = np.random.default_rng(seed), np.array([0.8, -0.5])[:dimensions]
    first, second = rng.uniform(-2, 2, (2, count, dimensions))
    away = [np.linalg.norm(side - taste, axis=1) + noise * rng.standard_normal(count) for side in (first, second)]
    return first, second, ["first" if near < far else "second" for near, far in zip(*away, strict=True)], taste


def test_the_taste_is_found():
    first, second, answers, taste = _compared()
    places = np.stack(np.meshgrid(*[np.linspace(-2, 2, 41)] * 2), -1).reshape(-1, 2)
    best = places[PreferenceModel.fit(first, second, answers).mean(places).argmax()]
    assert np.linalg.norm(best - taste) < 0.35  # forty bits about an area of 16


def test_answers_at_random_leave_the_lowest_amplitude():
    first, second, answers, _ = _compared()
    contradicted = [(first, second, answers), (first, second, [_other(answer) for answer in answers])]
    both = [sum((list(part[k]) for part in contradicted), []) for k in range(3)]
    assert PreferenceModel.fit(np.array(both[0]), np.array(both[1]), both[2]).amplitude == AMPLITUDES[0]
    assert PreferenceModel.fit(first, second, answers).amplitude > AMPLITUDES[1]


def _other(answer):
    return {"first": "second", "second": "first"}[answer]


def test_sides_do_not_matter():
    first, second, answers, _ = _compared(noise=0.5)
    places = np.random.default_rng(1).uniform(-2, 2, (20, 2))
    one = PreferenceModel.fit(first, second, answers)
    other = PreferenceModel.fit(second, first, [_other(answer) for answer in answers])
    for found, wanted in zip(other.posterior(places), one.posterior(places), strict=True):
        np.testing.assert_allclose(found, wanted, atol=1e-6)  # Newton's last step


def test_variance_shrinks_where_was_compared_and_nothing_is_known_before():
    places = np.array([[0.5, 0.0], [-1.5, 1.0]])
    mean, covariance = PreferenceModel.fit(np.empty((0, 2)), np.empty((0, 2)), []).posterior(places)
    np.testing.assert_allclose(mean, _prior_mean(places, 1.0))
    np.testing.assert_allclose(covariance, _covariance(places, places, 1.0))
    told = PreferenceModel.fit(places[:1], places[1:], ["first"])
    apart = np.array([1.0, -1.0])
    before = apart @ _covariance(places, places, told.amplitude) @ apart
    mean, after = told.posterior(places)
    assert apart @ mean > apart @ _prior_mean(places, told.amplitude) and apart @ after @ apart < before


@pytest.mark.parametrize("code", [0, 1, 2])
def test_slopes_of_the_likelihood_are_those_of_its_values(code):
    place, step = np.linspace(-6, 6, 25), 1e-5
    codes = np.full(len(place), code)
    value, slope, curvature = _likelihood(place, codes)
    ahead, behind = _likelihood(place + step, codes), _likelihood(place - step, codes)
    np.testing.assert_allclose(slope, (ahead[0] - behind[0]) / (2 * step), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(curvature, -(ahead[1] - behind[1]) / (2 * step), rtol=1e-3, atol=1e-5)


def test_probabilities_of_the_three_answers_add_up():
    place = np.linspace(-4, 4, 9)
    total = sum(np.exp(_likelihood(place, np.full(9, code))[0]) for code in range(3))
    np.testing.assert_allclose(total, 1)
