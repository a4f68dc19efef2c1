"""A warning of ratings that lie outside of what training covered, alone or together."""

import numpy as np
import pytest

from tactile_diffusers.data.ratings import rating_coverage, rating_quantiles
from tactile_diffusers.pipelines.inputs import parse_ratings, warn_of_novel_ratings

NAN = float("nan")


def _surfaces():
    """Ratings of 60 surfaces: bumpiness follows roughness, slipperiness is its own."""
    ratings = np.random.default_rng(0).uniform(-1.5, 1.5, (60, 3))
    ratings[:, 1] = ratings[:, 0] + 0.1 * ratings[:, 1]
    return ratings.astype(np.float32)


def _coverage(ratings):
    """What training keeps of them in DALE's config."""
    centre, covariance, reach = rating_coverage(ratings)
    return {
        "range": rating_quantiles(ratings)[:, [0, -1]].tolist(),
        "centre": centre.tolist(),
        "covariance": covariance.tolist(),
        "reach": reach,
    }


@pytest.fixture
def pipe(make_pipeline):
    return make_pipeline(dale_config={"rating_statistics": _coverage(_surfaces())})


@pytest.fixture
def warned(recorded_warnings, pipe):
    """`warned(ratings)` is the list of warnings that these ratings raise."""

    def make(ratings, config=pipe.dale.config, **options):
        with recorded_warnings() as found:
            warn_of_novel_ratings(parse_ratings(ratings, config, **options), config)
        return found

    return make


def test_the_warning_names_axis_value_and_range(pipe, warned):
    low, high = pipe.dale.config.rating_statistics["range"][2]
    (message,) = warned([[0.0, 0.0, 0.0], [0.0, 0.0, -2.5], [0.0, 0.0, 1.6]])
    assert f"slipperiness -2.50 is held at the training surfaces' {low:+.2f} to {high:+.2f}" in message
    assert "`ratings` lie outside" in message
    assert "roughness" not in message and "combination" not in message


def test_a_combination_that_no_surface_is_near_to_warns_though_each_axis_is_inside(warned):
    for alone in ([1.2, NAN, NAN], [NAN, -1.2, NAN], [NAN, NAN, 0.3]):
        assert warned(alone) == []
    (message,) = warned([[0.0, 0.0, 0.0], [1.2, -1.2, 0.3]])
    assert "the combination [1.2, -1.2, 0.3] is extrapolated: no surface is near it" in message
    (message,) = warned([1.2, -1.2, NAN])  # of two axes too
    assert "combination" in message


def test_training_surfaces_are_inside(warned):
    assert warned(_surfaces()) == []  # the outermost too, at the very end of a range and of the reach
    assert warned([[0.5, 0.5, 0.0], [-1.0, -0.9, 1.0]]) == []


@pytest.mark.parametrize("ratings", [None, [NAN] * 3, {"roughness": 0.3}, [[NAN, None, 1.0]]], ids=str)
def test_axes_that_are_not_specified_are_ignored(warned, ratings):
    assert warned(ratings) == []


@pytest.mark.parametrize("kept", [(), ("range",), ("centre", "covariance", "reach")])
def test_what_a_config_lacks_is_not_checked(make_pipeline, warned, kept):
    entries = _coverage(_surfaces())
    config = make_pipeline(dale_config={"rating_statistics": {name: entries[name] for name in kept}}).dale.config
    assert bool(warned([0.0, 0.0, 5.0], config)) == bool(kept)
    assert bool(warned([1.2, -1.2, 0.3], config)) == ("reach" in kept)


def test_the_pipeline_warns_once_and_generates_all_the_same(pipe, recorded_warnings, seeded):
    options = {"num_inference_steps": 2, "num_textures_per_rating": 3}
    with recorded_warnings() as found:
        outside = pipe([[3.0, 0.0, 0.0]], generator=seeded(0), **options)
    assert len(found) == 1 and "roughness +3.00" in found[0] and np.isfinite(outside.textures).all()
    with recorded_warnings() as found:
        pipe([[1.0, 1.0, 0.0]], generator=seeded(0), **options)
    assert found == []
