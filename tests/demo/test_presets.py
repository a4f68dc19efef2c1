"""Presets: what a visitor gets who only picks a name."""

import numpy as np
import pytest
from settings import Settings

from tactile_diffusers.pipelines import PRESETS


@pytest.fixture(scope="module")
def answers(studio):
    """(presets, axes): asked and estimated z-scores, with the page's own settings."""
    result = studio.generate(list(PRESETS.values()), Settings(duration_s=1.0))
    return tuple(
        np.array([getattr(texture, name) for texture in result.textures], float) for name in ("ratings", "estimated")
    )


def test_an_answer_is_near_what_a_preset_asks(answers):
    asked, estimated = answers
    # estimates shrink towards the middle, and two takes of one request differ by 0.2 to 0.4
    assert np.nanmax(np.abs(estimated - 0.75 * asked)) < 0.6
    assert np.nanmean(np.abs(estimated - 0.75 * asked)) < 0.25


def test_presets_differ_on_each_axis(answers):
    asked, estimated = answers
    for axis in range(asked.shape[1]):
        given = np.isfinite(asked[:, axis])
        assert np.corrcoef(asked[given, axis], estimated[given, axis])[0, 1] > 0.85
