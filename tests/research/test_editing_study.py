"""The study of edits: what it compares, and that its page is what it measured."""

import json
from pathlib import Path

import editing
import numpy as np
import pytest

RESULTS = Path(__file__).parents[2] / "examples" / "results"


def test_envelopes_of_the_same_course_are_correlated():
    rng, rate = np.random.default_rng(0), 10_000
    course = np.repeat(np.exp(rng.standard_normal((3, 100))), 100, axis=1)
    first, second = (course * rng.standard_normal(course.shape) for _ in range(2))
    envelopes = [editing._envelope(textures, rate) for textures in (first, second)]
    assert envelopes[0].shape == (3, 100)
    assert editing._correlation(*envelopes).min() > 0.95  # of a hundred samples, an RMS is known to 7 %
    assert np.abs(editing._correlation(first, second)).max() < 0.1  # though the waveforms are strangers
    np.testing.assert_allclose(editing._correlation(first, -2 * first + 1), -1)


def test_the_page_is_what_was_measured():
    result = json.loads((RESULTS / "editing" / "editing.json").read_text())
    page = (RESULTS / "editing" / "editing.md").read_text(encoding="utf-8")
    assert page.startswith(editing.markdown(result) + "\n")  # conditions follow


@pytest.mark.parametrize("name", ["gap of 0.2 s", "continuation", "loop"])
def test_what_was_not_to_change_did_not(name):
    result = json.loads((RESULTS / "editing" / "editing.json").read_text())
    assert result["seams"][name]["same"] is True
