"""Section "regression": polynomials of ratings find what is planted, and no more than there is."""

from types import SimpleNamespace

import numpy as np
import pytest
from report.sections import regression


def _planted(surfaces, curve, seed, noise=0.5):
    """Ratings (surfaces, 3) and nine band levels that follow them, with noise."""
    rng = np.random.default_rng(seed)
    ratings = rng.normal(0, 0.8, (surfaces, 3))
    bands = ratings[:, :1] * np.linspace(3, 1, 9) + curve * ratings[:, 1:2] ** 2
    return ratings, bands + rng.normal(0, noise, (surfaces, 9))


def _data(ratings, bands):
    return SimpleNamespace(seed=0, surfaces=np.arange(len(ratings)), ratings=ratings, bands=bands)


@pytest.mark.parametrize(("curve", "degree"), [(0.0, 1), (1.5, 2)])
def test_the_degree_is_that_of_what_is_planted(curve, degree):
    data = _data(*_planted(200, curve, seed=1))
    ratings, bands = _planted(400, curve, seed=0)
    twice = np.repeat(np.arange(400), 2)  # two textures a surface count as one
    found = regression._fitted(data, np.full(200, 0.1), bands[twice], ratings[twice], twice)
    assert found["degree"]["mean"] == degree and found["surfaces"]["mean"] == 400
    # what is left is the noise: 0.5 dB times sqrt(2 / pi), and a few per cent for what 400 surfaces cannot settle
    assert found["nine_band_over_model_db"]["mean"] == pytest.approx(found["nine_band_db"]["mean"] - 0.1)
    assert found["nine_band_db"]["mean"] == pytest.approx(0.5 * np.sqrt(2 / np.pi), rel=0.06)


def test_wrong_ratings_predict_nothing():
    ratings, bands = _planted(300, 1.5, seed=0)
    data = _data(*_planted(200, 1.5, seed=1))
    shuffled = np.random.default_rng(0).permutation(ratings)
    right, wrong = (
        regression._fitted(data, np.full(200, 0.1), bands, used, np.arange(300)) for used in (ratings, shuffled)
    )
    assert wrong["nine_band_db"]["mean"] > 2 * right["nine_band_db"]["mean"]
