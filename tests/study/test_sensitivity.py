"""ABX: formula against tabulated values, against drawn observers, and back."""

import numpy as np
import pytest
from study import abx_dprime, abx_proportion_correct

#: Palamedes, PAL_SDT_2AFCmatchSample_DiffMod_PCtoDP (an independent implementation): proportion correct -> d'.
TABLE = {0.6: 1.1152, 0.7: 1.7153, 0.8: 2.3549, 0.9: 3.2631}


@pytest.mark.parametrize(("proportion", "dprime"), TABLE.items())
def test_values_of_another_implementation(proportion, dprime):
    assert abx_dprime(proportion) == pytest.approx(dprime, abs=6e-5)  # four decimals
    assert abx_proportion_correct(dprime) == pytest.approx(proportion, abs=2e-5)


@pytest.mark.parametrize("dprime", [0.0, 0.7, 2.0, 3.5])
def test_drawn_observers_are_right_as_often(dprime):
    rng, trials = np.random.default_rng(0), 200_000
    felt_a, felt_b = rng.standard_normal(trials), dprime + rng.standard_normal(trials)
    x_is_b = rng.random(trials) < 0.5
    x = dprime * x_is_b + rng.standard_normal(trials)
    says_b = (x > (felt_a + felt_b) / 2) == (felt_b > felt_a)
    assert np.mean(says_b == x_is_b) == pytest.approx(abx_proportion_correct(dprime), abs=0.005)


def test_below_chance_is_negative_and_certainty_is_finite_where_trials_are_known():
    assert abx_dprime(0.5) == 0
    assert abx_dprime(0.4) == pytest.approx(-abx_dprime(0.6))
    assert abx_dprime(1.0) == 10.0
    assert abx_dprime(1.0, trials=20) == pytest.approx(abx_dprime(1 - 1 / 40))
    assert abx_dprime(0.0, trials=20) == pytest.approx(-abx_dprime(1 - 1 / 40))
    assert np.isnan(abx_dprime(np.nan))
