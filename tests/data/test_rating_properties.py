"""Pooling and agreement of any answers: what does not matter changes nothing, and what is defined is finite."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from tactile_diffusers.data.ratings import (
    pool_ratings,
    rating_quantiles,
    rating_reliability,
)
from tactile_diffusers.data.recordings import RaterScores
from tactile_diffusers.signal import RATING_AXES
from tactile_diffusers.signal.rating_scales import from_percentile

answer = st.one_of(st.just(np.nan), st.floats(0, 8, width=32), st.integers(0, 8).map(float))
shapes = st.tuples(st.integers(1, 5), st.integers(1, 8), st.just(3))
all_answers = shapes.flatmap(lambda shape: arrays.arrays(np.float32, shape, elements=answer))


def _scores(values):
    raters, surfaces, _ = values.shape
    return RaterScores(
        values, tuple(f"r{i}" for i in range(raters)), tuple(f"s{i}" for i in range(surfaces)), RATING_AXES
    )


def _pooled(values, training=None):
    scores = _scores(values)
    training = np.ones(len(scores.surfaces), bool) if training is None else training
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of NumPy: correlations of constant answers are NaN
        try:
            return pool_ratings(scores, list(scores.surfaces), training)
        except ValueError as error:
            assert "No rater differs between training surfaces" in str(error)
            return None


@settings.get_profile("many")
@given(values=all_answers, data=st.data())
def test_pooling(values, data):
    training = np.array(data.draw(st.lists(st.booleans(), min_size=values.shape[1], max_size=values.shape[1])))
    found = _pooled(values, training)
    # a rater counts on an axis whose answers on training surfaces differ
    usable = np.zeros((len(values), 3), bool)
    for r, a in np.ndindex(usable.shape):
        known = values[r, training, a].astype(float)
        known = known[~np.isnan(known)]
        usable[r, a] = len(known) > 1 and known.std() > 1e-6
    assert (found is not None) == usable.any(0).all()
    if found is None:
        return
    assert len(found.left_out) == (~usable).sum()
    for s, a in np.ndindex(values.shape[1:]):
        z = []
        for r in np.flatnonzero(usable[:, a]):
            known = values[r, training, a].astype(float)
            known = known[~np.isnan(known)]
            if not np.isnan(values[r, s, a]):
                z.append((values[r, s, a] - known.mean()) / known.std())
        assert found.count[s, a] == len(z)
        np.testing.assert_allclose(found.mean[s, a], np.mean(z) if z else np.nan, rtol=1e-3, atol=1e-4)
        np.testing.assert_allclose(found.std[s, a], np.std(z) if z else np.nan, rtol=1e-3, atol=1e-3)
    assert np.isfinite(found.raw_mean).all() and (found.raw_scale > 0).all()


@settings.get_profile("many")
@given(values=all_answers)
def test_reliability(values):
    found = rating_reliability(_scores(values))
    str(found)
    known = ~np.isnan(found.mean_correlation)
    assert (np.abs(found.mean_correlation[known]) <= 1 + 1e-9).all() and (
        found.alpha[~np.isnan(found.alpha)] <= 1 + 1e-9
    ).all()
    np.testing.assert_array_equal(known, found.pairs > 0)
    for axis in range(3):
        pairs = []
        for i in range(len(values)):
            for j in range(i):
                x, y = values[[i, j], :, axis].astype(float)
                both = ~np.isnan(x) & ~np.isnan(y)
                if both.sum() >= 3 and np.ptp(x[both]) > 1e-3 and np.ptp(y[both]) > 1e-3:
                    pairs.append(np.corrcoef(x[both], y[both])[0, 1])
        if len(pairs) == found.pairs[axis] and pairs:  # others are constant but for rounding
            assert found.mean_correlation[axis] == pytest.approx(np.mean(pairs), abs=1e-4)


means = st.integers(1, 12).flatmap(
    lambda n: arrays.arrays(np.float32, (n, 3), elements=st.one_of(st.just(np.nan), st.floats(-3, 3, width=16)))
)


@settings.get_profile("many")
@given(mean=means, shares=st.lists(st.floats(0, 100), min_size=1, max_size=5))
def test_percentiles_rise_and_end_where_ratings_do(mean, shares):
    table = rating_quantiles(mean)
    assert table.shape == (3, 21)
    asked = np.sort(shares)[:, None] * np.ones(3)
    found = from_percentile(asked, table)
    assert np.isnan(from_percentile(np.full((1, 3), np.nan), table)).all()
    for axis in range(3):
        known = mean[~np.isnan(mean[:, axis]), axis]
        assert np.isnan(table[axis]).all() == (len(known) == 0)
        if len(known):
            assert (np.diff(table[axis]) >= 0).all() and (np.diff(found[:, axis]) >= -1e-12).all()
            assert table[axis, 0] == known.min() and table[axis, -1] == known.max()
            assert from_percentile(np.full((1, 3), 100.0), table)[0, axis] == known.max()
