"""What textures do over time: all alike, all equal to real ones, and unrelated to the surface are told apart."""

from types import SimpleNamespace

import numpy as np
import pytest
from report.sections.variation import MEASURES, measure_variation

SURFACES, TAKES, SAMPLES = 12, 2, 8192


@pytest.fixture(scope="module")
def measured():
    """Real bursts, deeper from surface to surface, in place of each of: themselves, their mean depth, a wrong depth."""
    rng = np.random.default_rng(0)
    surfaces = np.repeat(np.arange(SURFACES), TAKES)

    def bursts(depths):
        rise = np.sin(2 * np.pi * 5 * np.arange(SAMPLES) / 10_000)
        return np.exp(depths[:, None] * rise) * rng.standard_normal((len(depths), SAMPLES)) * 0.01

    depths = np.linspace(0.1, 1.5, SURFACES)[surfaces]
    real = bursts(depths)
    context = SimpleNamespace(
        data=SimpleNamespace(real=real, rate=10_000, surfaces=surfaces),
        requests=(None, surfaces),
        generated={1.0: SimpleNamespace(textures=bursts(np.full(len(surfaces), 0.8)))},
        default_guidance=1.0,
        baseline_textures={"other_take": bursts(depths), "ridge": bursts(depths[::-1])},
    )
    return measure_variation(context)


def _means(measured, source, key):
    return {name: leaves[key]["mean"] for name, leaves in measured[source].items()}


def test_textures_that_are_all_alike_have_no_spread(measured):
    assert set(measured) == {"model", "other_take", "ridge"} and set(measured["model"]) == set(MEASURES)
    spread = _means(measured, "model", "spread")
    assert spread["envelope_variation"] < 0.3 and spread["kurtosis"] < 0.6  # of so few and short textures


def test_another_take_has_the_spread_and_the_order_of_real_ones(measured):
    assert _means(measured, "other_take", "spread")["envelope_variation"] == pytest.approx(1, abs=0.1)
    leaf = measured["other_take"]["envelope_variation"]["r"]
    assert leaf["mean"] > 0.95 and leaf["interval"][1] <= 1


def test_the_wrong_surfaces_have_the_spread_alone(measured):
    assert _means(measured, "ridge", "spread")["envelope_variation"] == pytest.approx(1, abs=0.1)
    assert _means(measured, "ridge", "r")["envelope_variation"] < -0.9
