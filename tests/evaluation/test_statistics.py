"""Summaries and intervals: each against a case whose answer is known."""

import numpy as np
import pytest

from tactile_diffusers.evaluation.metrics.reference import Reference
from tactile_diffusers.evaluation.metrics.statistics import is_leaf, leaf, number
from tactile_diffusers.signal import DEVICE_RATE


def test_leaf_of_a_mean_has_the_textbook_interval():
    values = np.random.default_rng(0).normal(3.0, 2.0, 50)
    made = leaf(values)
    error = values.std(ddof=1) / np.sqrt(50)  # the jackknife of a mean is exactly its standard error
    assert made["mean"] == pytest.approx(values.mean()) and made["median"] == pytest.approx(np.median(values))
    assert (made["n"], made["min"], made["max"]) == (50, values.min(), values.max())
    reach = 2.0096 * error  # Student's t of 49 degrees of freedom
    assert made["interval"] == pytest.approx([values.mean() - reach, values.mean() + reach], rel=1e-4)
    assert is_leaf(made) and is_leaf(number()) and not is_leaf({"mean": 1.0})


def test_interval_counts_surfaces_not_segments():
    """Four copies of each of 20 values carry no more than the 20: the interval must not shrink."""
    values = np.random.default_rng(1).normal(size=20)
    once, copied = leaf(values), leaf(np.repeat(values, 4), np.repeat(np.arange(20), 4))
    assert copied["interval"] == pytest.approx(once["interval"])
    assert copied["n"] == 80


def test_missing_values_and_nothing():
    assert leaf([1.0, np.nan, 3.0])["mean"] == 2.0 and leaf([1.0, np.nan, 3.0])["n"] == 2
    assert leaf([])["mean"] is None and leaf(None)["n"] is None and leaf([np.nan])["interval"] is None
    assert leaf([1.0, 2.0])["interval"] is None  # two units say nothing about a spread over units
    assert number(np.inf)["mean"] is None


def test_reference_distances_are_those_of_the_functions(reference, held_out):
    from tactile_diffusers.evaluation import frechet_tactile_distance, kernel_tactile_distance

    frozen = Reference(reference, DEVICE_RATE)
    points, groups = frozen.embed(held_out), np.repeat(np.arange(25), 4)
    found = frozen.distances(points, groups)
    assert found["ktd"]["mean"] == pytest.approx(
        kernel_tactile_distance(points, frozen.points, frozen.embedding.width, groups)
    )
    assert found["ftd"]["mean"] == pytest.approx(frechet_tactile_distance(points, frozen.points))
    for name in ("ftd", "ktd"):
        low, high = found[name]["interval"]
        assert low < found[name]["mean"] < high
    few = frozen.distances(points[:40], groups[:40])
    assert few["ftd"]["mean"] is None and few["ktd"]["mean"] is not None  # 40 members have no covariance of 53
