"""Controls: what is refused of their values, and whether they still ask for what is shown."""

from types import SimpleNamespace

import numpy as np
import pytest
from controls import agree, read_ratings
from page import _asked, _outdated_blend
from settings import Settings, from_z, slider_ranges, to_z
from texture_tab import _compare

NAN = float("nan")
CLOSED = (False, False, False)
HOW = (2, 5, 2, 1.0, Settings().seed, 1.6, 1)


@pytest.mark.parametrize("value", [150, -1, None, NAN, "50", True, [1]])
def test_a_refused_rating_names_its_axis(studio, value):
    left_open = (False, value is None, False)
    if value is None:  # an axis that is open needs no number
        assert np.isnan(read_ratings(studio, "percentile", (50, value, 50, *left_open))[1])
    with pytest.raises(ValueError, match=r"bumpiness must be between 0 and 100 \(percentile"):
        read_ratings(studio, "percentile", (50, "" if value is None else value, 50, *CLOSED))


@pytest.mark.parametrize("scale", ["percentile", "raw", "z"])
@pytest.mark.parametrize("percentiles", [(0, 0, 0), (84, 80, 64), (100, 100, 100), (3, 51, 99)])
def test_another_scale_alone_changes_nothing(studio, scale, percentiles):
    config = studio.config
    made = to_z(percentiles, "percentile", config)
    decimals = 0 if scale == "percentile" else 2
    shown = [
        round(min(max(value, low), high), decimals)
        for value, (low, high) in zip(from_z(made, scale, config), slider_ranges(scale, config), strict=True)
    ]
    assert agree(to_z(shown, scale, config), made, scale, config)
    shown[1] += -2 if scale == "percentile" and shown[1] > 2 else 2 if scale == "percentile" else 0
    if scale == "percentile":
        assert not agree(to_z(shown, scale, config), made, scale, config)
    assert not agree((made[0], NAN, made[2]), made, scale, config)


def test_what_is_shown_is_told_from_what_is_asked(studio):
    ratings = to_z((84, 80, 64), "percentile", studio.config)
    made = SimpleNamespace(settings=Settings(), textures=[SimpleNamespace(ratings=ratings)])
    asked = ("percentile", 84, 80, 64, *CLOSED)
    assert _compare(studio, made, *asked, *HOW) == "" == _compare(studio, None, *asked, *HOW)
    for values in (("percentile", 85, 80, 64, *CLOSED, *HOW), (*asked, 2, 5, 2, 1.0, 2, 1.6, 1)):
        told = _compare(studio, made, *values)
        assert "have changed since" in told and "is the earlier texture" in told
    told = _compare(studio, made, *asked, 2, 5, 2, 1.0, 1, 10.0, 3)
    assert "Not made" in told and "may last 20 s" in told and "is the earlier texture" in told
    assert "<b>" not in _compare(studio, made, "percentile", "<b>", 80, 64, *CLOSED, *HOW)


def test_a_blend_is_told_from_what_it_would_be_now():
    given = [("glass", (-1.0, 0.0, 1.0)), ("denim", (1.0, None, 0.0)), 50, *HOW]
    asked = _asked(given)
    assert _outdated_blend(asked, *given) == "" == _outdated_blend(None, *given)
    assert _outdated_blend(asked, ("kept", (-1.0, 0.0, 1.0)), *given[1:-1], 8) == ""
    for number, other in ((0, ("kept", (-1.0, 0.0, 0.9))), (2, 55), (3, 9)):
        changed = [*given[:number], other, *given[number + 1 :]]
        assert "is the earlier comparison" in _outdated_blend(asked, *changed)
