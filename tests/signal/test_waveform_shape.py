"""Shapes of waveforms whose statistics are known."""

import numpy as np
import pytest
from scipy import signal

from tactile_diffusers.signal.waveform_shape import waveform_shape

TIME = np.arange(16_000) / 10_000


@pytest.mark.parametrize(
    "waveform, expected",
    [
        (np.sin(2 * np.pi * 100 * TIME), {"kurtosis": 1.5, "crest_factor": np.sqrt(2), "skew": 0, "slope_skew": 0}),
        (np.random.default_rng(0).standard_normal(len(TIME)), {"kurtosis": 3, "envelope_variation": 0.523, "skew": 0}),
        # a triangle that rises for 85 % of its period: slopes 1 / 0.85 and -1 / 0.15
        (signal.sawtooth(2 * np.pi * 50 * TIME, 0.85), {"skew": 0, "slope_skew": -0.7 / np.sqrt(0.85 * 0.15)}),
        (np.eye(1, len(TIME), 50)[0], {"kurtosis": len(TIME), "crest_factor": np.sqrt(len(TIME))}),
        (np.zeros(len(TIME)), {"kurtosis": 0, "crest_factor": 0, "skew": 0, "slope_skew": 0, "envelope_variation": 0}),
    ],
    ids=["sine", "noise", "sawtooth", "impulse", "silence"],
)
def test_known_waveforms(waveform, expected):
    shape = waveform_shape(waveform)
    for name, value in expected.items():
        assert shape[name] == pytest.approx(value, rel=0.03, abs=0.06), name


def test_scale_and_offset_do_not_matter_and_the_sign_turns_the_skews():
    textures = np.random.default_rng(1).gamma(2.0, size=(2, 3, 4000))
    shape, other, turned = map(waveform_shape, (textures, 3 * textures + 5, -textures))
    for name, value in shape.items():
        assert value.shape == (2, 3) and value.dtype == np.float64
        np.testing.assert_allclose(other[name], value, rtol=1e-9)
        np.testing.assert_allclose(turned[name], -value if "skew" in name else value, rtol=1e-9)
