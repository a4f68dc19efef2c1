"""Limits of what may be asked for, scales, blends and presets."""

from types import SimpleNamespace

import numpy as np
import pytest
from settings import LIMITS, Settings, available_scales, blend, describe, from_z, novelty, slider_ranges, to_z

from tactile_diffusers.pipelines import PRESETS
from tactile_diffusers.pipelines.inputs import parse_ratings

NAN = float("nan")


@pytest.mark.parametrize("name", LIMITS)
@pytest.mark.parametrize("end", [0, 1])
def test_a_value_outside_is_refused_whoever_asks(name, end):
    beyond = LIMITS[name][end] + (-1, 1)[end]
    with pytest.raises(ValueError, match=f"`{name}`"):
        Settings(**{name: beyond})
    assert getattr(Settings(**{name: LIMITS[name][end]}), name) == LIMITS[name][end]


@pytest.mark.parametrize("value", ["2", None, NAN, float("inf"), True, [2], 2.5])
def test_what_is_no_whole_number_is_refused(value):
    with pytest.raises(ValueError, match="`steps`"):
        Settings(steps=value)


def test_a_browser_may_send_whole_numbers_as_floats():
    assert isinstance(Settings(takes=2.0).takes, int)


@pytest.mark.parametrize("scale", ["percentile", "raw", "z"])
def test_scales_undo_each_other(studio, scale):
    ratings = (-1.1, NAN, 0.7)
    shown = [None if np.isnan(value) else value for value in from_z(ratings, scale, studio.config)]
    np.testing.assert_allclose(to_z(shown, scale, studio.config), ratings, atol=1e-5)


@pytest.mark.parametrize("scale", ["percentile", "raw", "z"])
def test_sliders_run_over_what_was_trained_on(studio, scale):
    for axis, (low, high) in enumerate(slider_ranges(scale, studio.config)):
        for end, wanted in zip((low, high), studio.config.rating_statistics["range"][axis], strict=True):
            asked = [None] * 3
            asked[axis] = end
            found = to_z(asked, scale, studio.config)[axis]
            # a mean of z-scores may lie beyond what the typical rater can answer, 8
            assert found == pytest.approx(wanted, abs=0.011) or (scale == "raw" and end in (0, 8))


def test_a_checkpoint_without_statistics_has_z_scores_alone():
    config = SimpleNamespace(rating_axes=["roughness", "bumpiness", "slipperiness"])
    assert available_scales(config) == ["z"]
    assert slider_ranges("z", config) == [(-2.0, 2.0)] * 3 and novelty((9, 9, 9), config) == ""


def test_blend_is_straight_in_z_and_exact_at_its_ends():
    first, second = (0.0, NAN, -1.0), (1.0, 0.5, 1.0)
    np.testing.assert_equal(blend(first, second, 0), first)
    np.testing.assert_equal(blend(first, second, 1), second)
    np.testing.assert_allclose(blend(first, second, 0.25), (0.25, NAN, -0.5))
    with pytest.raises(ValueError, match="`share`"):
        blend(first, second, 1.5)


@pytest.mark.parametrize("name", PRESETS)
def test_presets_lie_among_the_training_surfaces(studio, name):
    ratings = tuple(parse_ratings([list(PRESETS[name])], studio.config)[0].tolist())
    assert novelty(ratings, studio.config) == ""
    for value, (low, high) in zip(ratings, studio.config.rating_statistics["range"], strict=True):
        assert np.isnan(value) or low <= value <= high


def test_combinations_far_from_all_training_surfaces_are_said(studio):
    assert "extrapolated" in novelty((-2.0, 1.8, 1.6), studio.config)


def test_description_names_what_is_open(studio):
    assert (
        describe((0.5, NAN, -1.0), "z", studio.config) == "roughness 0.50, bumpiness not specified, slipperiness -1.00"
    )
