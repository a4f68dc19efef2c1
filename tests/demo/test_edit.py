"""The tab that edits: every action on a generated texture, and what is refused."""

import numpy as np
import pytest
from answers import edit_answer
from edit_tab import ACTIONS, run_edit

HOW = (1, 1, 2, 1.0, 0, 1.6, 1)  # steps, steps of DALE, order, guidance, seed, seconds, takes


@pytest.fixture(scope="module")
def texture(studio):
    return studio.generate([(0.5, 0.0, 0.0)]).textures[0]


@pytest.mark.parametrize("action", ACTIONS)
def test_every_action_gives_a_texture_beside_the_one_before(studio, texture, action):
    deltas = dict.fromkeys(studio.config.rating_axes, 0.0) | {"roughness": 1.0}
    options = ACTIONS[action](deltas, 0.8, 0.5, 0.6)
    before, after = made = studio.edit(texture.samples, texture.sampling_rate, **options)
    assert np.array_equal(before.samples, texture.samples) and before.sampling_rate == after.sampling_rate
    assert len(after.samples) == len(before.samples) + 10_000 * ("continue_s" in options)
    assert not np.array_equal(after.samples[: len(before.samples)], before.samples) or "continue_s" in options
    if "ratings" in options:
        assert after.estimated[0] > before.estimated[0] + 0.3
    picture, sound, numbers = edit_answer(made, "z", studio.config)
    assert "before" in numbers and sound.count("<audio") == 2 and "<img" in picture or "<svg" in picture


def test_an_impossible_stretch_is_refused(studio, texture):
    options = ACTIONS["make a stretch anew"]({}, 0.5, 3.0, 4.0)
    with pytest.raises(ValueError):
        studio.edit(texture.samples, texture.sampling_rate, **options)


@pytest.mark.parametrize("stretch", [(0.8, 0.9), (0.9, 0.8)])
def test_the_button_edits_the_texture_of_the_first_tab_or_says_why_not(studio, stretch):
    gradio = pytest.importorskip("gradio")
    values = (0.5, 0.0, 0.0, "z", 1.0, 0.0, 0.0, False, False, True, *HOW)
    answers = run_edit(gradio, studio, None, 10_000, "change its ratings", *stretch, 0.6, *values)
    picture, sound, numbers = next(answers)
    if stretch == (0.8, 0.9):
        assert "after" in numbers and "<audio" in sound
    else:
        assert "stretch" in picture and not numbers
        with pytest.raises(gradio.Error, match="stretch"):
            next(answers)
