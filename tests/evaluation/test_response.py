"""The response over the whole accepted range: planted responses, and that of the bundled checkpoint."""

import numpy as np
import pytest
from report.sampling import generate, noise_seeds
from report.sections.response import RATINGS, centroid_hz, rating_requests, reversal_leaf

from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint
from tactile_diffusers.evaluation.metrics.rating_effects import reversal
from tactile_diffusers.pipelines.inputs import LARGEST_RATING
from tactile_diffusers.signal import RATING_AXES

#: A response may turn back by this share of its change within ±2: it is the mean of few takes.
ALLOWED = 0.1
TAKES = 8


def test_the_curve_reaches_the_ends_of_what_is_accepted():
    assert RATINGS[0] == -LARGEST_RATING and RATINGS[-1] == LARGEST_RATING and list(RATINGS) == sorted(RATINGS)
    requests = rating_requests(1, 2)
    assert np.isnan(requests[:, [0, 2]]).all() and requests[:4, 1].tolist() == [-6.0, -6.0, -4.0, -4.0]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("far", ["monotone", "held"])
def test_what_goes_on_or_is_held_does_not_turn_back(far, sign):
    values = np.array(RATINGS)
    assert reversal(values, sign * (values if far == "monotone" else np.clip(values, -2, 2))) == 0


@pytest.mark.parametrize(("side", "expected"), [(1, 0.25), (-1, 0.25), (0, 0.5)])
def test_a_response_that_turns_back_beyond_2_is_seen(side, expected):
    """Held at ±2 but for 1 of 4 on one side; or on both, 2 of 4, where it recovers later."""
    values = np.array(RATINGS)
    response = np.clip(values, -2, 2)
    if side:
        response[side * values > 2] -= side
    else:
        response[np.abs(values) == 3] = 0.0
    for sign in (1, -1):
        assert reversal(values, sign * response) == pytest.approx(expected)
    found = reversal_leaf(response[:, None] + np.random.default_rng(0).normal(size=12))  # the same for all ratings
    assert found["mean"] == pytest.approx(expected) and found["interval"] == pytest.approx([expected, expected])


def test_centroid_is_the_mean_frequency():
    time = np.arange(10_000) / 10_000
    tones = [np.sin(2 * np.pi * 100 * time), np.sin(2 * np.pi * 100 * time) + np.sin(2 * np.pi * 400 * time)]
    assert centroid_hz(np.stack(tones), 10_000) == pytest.approx([100, 250], rel=0.01)


@pytest.fixture(scope="module")
def bundled():
    pipe = TactileTexturePipeline.from_pretrained(bundled_checkpoint())
    pipe.set_progress_bar_config(disable=True)
    return pipe


@pytest.mark.parametrize("axis", RATING_AXES)
def test_the_bundled_checkpoint_goes_on_or_holds_beyond_2(bundled, axis):
    """Level, and of slipperiness friction; no decoding, which they do not need."""
    requests = rating_requests(RATING_AXES.index(axis), TAKES)
    seeds = np.tile(noise_seeds(0, TAKES), len(RATINGS))
    made = generate(bundled, requests, seeds, 10_000, 16_384, steps=bundled.resolve_steps()[1], decode=False)
    measured = np.log(made.friction_coefficients) if axis == "slipperiness" else made.levels
    assert reversal(RATINGS, measured.reshape(len(RATINGS), TAKES).mean(1)) <= ALLOWED
