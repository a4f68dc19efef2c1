"""Limits of what may be asked for, the sliders' scale, blends, links and the history."""

import numpy as np
import pytest
from make_tab import from_link, link_of, remember, title_of
from settings import LIMITS, Scale, Settings, blend

from tactile_diffusers.pipelines import PRESETS

NAN = float("nan")
ENTRY = (84, 80, 63, False, True, False, "denim", 2, 7, 1.5, 2.0, 2)


@pytest.mark.parametrize("name", LIMITS)
@pytest.mark.parametrize("end", [0, 1])
def test_a_value_outside_is_refused_whoever_asks(name, end):
    with pytest.raises(ValueError, match=f"`{name}`"):
        Settings(**{name: LIMITS[name][end] + (-1, 1)[end]})
    assert getattr(Settings(**{name: LIMITS[name][end]}), name) == LIMITS[name][end]


@pytest.mark.parametrize("value", ["2", None, NAN, True, [2], 2.5])
def test_what_is_no_whole_number_is_refused(value):
    with pytest.raises(ValueError, match="`seed`"):
        Settings(seed=value)


def test_sliders_stand_where_ratings_are(studio):
    scale = studio.scale
    assert scale.from_z(scale.to_z([3, None, 99])) == [3, None, 99]
    for value in (150, -1, "50", True, NAN):
        with pytest.raises(ValueError, match="bumpiness must be between 0 and 100"):
            scale.to_z([50, value, 50])
    assert scale.describe((NAN, 0.0, 0.0)).startswith("roughness any · bumpiness ")
    assert "extrapolated" in scale.novelty((-2.0, 1.8, 1.6)) and not scale.novelty((0.0, 0.0, 0.0))


def test_what_the_package_only_logs_is_a_sentence_of_the_page(studio):
    assert "beyond 3" in studio.scale.strong(3.5) and not studio.scale.strong(3.0)
    usual = np.exp(studio.scale.config.level_mean)
    assert "28 times" in studio.scale.loud(28 * usual)[0] and studio.scale.loud(usual) == studio.scale.loud(0.0) == []


def test_a_checkpoint_without_percentiles_is_refused(make_pipeline):
    with pytest.raises(ValueError, match="`quantiles`"):
        Scale(make_pipeline().dale.config)


@pytest.mark.parametrize("name", PRESETS)
def test_presets_lie_among_the_training_surfaces(studio, name):
    scale, ratings = studio.scale, studio.scale.preset(name)
    assert scale.novelty(ratings) == ""
    shown = scale.from_z(ratings)
    entry = (
        *(50 if value is None else value for value in shown),
        *(value is None for value in shown),
        name,
        *ENTRY[7:],
    )
    assert title_of(scale, entry) == name and title_of(scale, (*entry[:6], "x", *entry[7:])) == "x"
    assert title_of(scale, (1, *entry[1:3], False, *entry[4:])) == f"{name}, edited"


def test_blend_is_straight_in_z_and_exact_at_its_ends():
    first, second = (0.0, NAN, -1.0), (1.0, 0.5, 1.0)
    np.testing.assert_equal(blend(first, second, 0), first)
    np.testing.assert_equal(blend(first, second, 1), second)
    np.testing.assert_allclose(blend(first, second, 0.25), (0.25, NAN, -0.5))


def test_a_link_holds_a_texture(studio):
    from urllib.parse import parse_qsl

    entry = (*ENTRY, studio.own)
    other = (1, 2, 3, False, False, False, "glass", 1, 1, 1, 1.6, 2, studio.own)
    found = from_link(studio.scale, dict(parse_qsl(link_of(studio.scale, entry))), other)
    assert found[3:] == entry[3:] and (found[0], found[2]) == (84, 63)
    own = (*entry[:6], None, *entry[7:])
    assert from_link(studio.scale, dict(parse_qsl(link_of(studio.scale, own))), other)[3:] == own[3:]
    assert from_link(studio.scale, {"seed": "9", "else": "x"}, other) == (*other[:8], 9, *other[9:])


@pytest.mark.parametrize(
    "query", [{"seed": "x"}, {"preset": "<b>"}, {"steps": "nan"}, {"roughness": "rough"}, {"take": "9"}]
)
def test_a_link_that_is_none_is_refused(studio, query):
    with pytest.raises(ValueError):
        from_link(studio.scale, query, (*ENTRY, studio.own))


def test_moves_of_one_control_are_one_entry_of_the_history():
    log = remember({"entries": [], "at": -1, "time": 0.0, "moved": set()}, (1, 1), apart=True)
    for entry in ((2, 1), (3, 1), (4, 1), (4, 2), (4, 3), (5, 3)):
        log = remember(log, entry)
    assert log["entries"] == [(1, 1), (4, 1), (4, 3), (5, 3)]
    log = remember(log, (9, 9), apart=True)
    log = remember(log, (8, 9))
    assert log["entries"][-2:] == [(9, 9), (8, 9)], "what is chosen stands apart from what is moved after it"
    assert remember(log, log["entries"][-1]) == log
    undone = {**log, "at": 0}
    assert remember(undone, (9, 9))["entries"] == [(1, 1), (9, 9)]
