"""The solvers that the benchmark compares, and the comparison itself, on cases whose answer is known."""

import numpy as np
import pytest
import solver_study
import torch
from solver_study import (
    TrainedStage,
    component_levels,
    mixture_errors,
    schedulers,
    settled_at,
    spectrum_levels,
    texture_deviations,
    trained_errors,
)
from solvers import RULES, run

from tactile_diffusers import VDDIMScheduler
from tactile_diffusers.evaluation.metrics.statistics import number
from tactile_diffusers.schedulers.scheduling_v_ddim import spaced_angles


@pytest.mark.parametrize("rule", RULES)
def test_every_rule_is_exact_for_one_point_of_data(rule):
    """Data and noise stay the same along the path: no extrapolation has anything to add. Adams-Bashforth alone errs,
    because it takes v, which rotates, for a polynomial: by a few hundredths at 12 steps."""
    noise, data = 0.7, -0.4
    made = run(RULES[rule], spaced_angles(12), lambda x, phi: np.cos(phi) * noise - np.sin(phi) * data, noise)
    assert made == pytest.approx(data, abs=0.01 if rule.startswith("adams") else 1e-12)


@pytest.mark.parametrize(
    ("rule", "order"),
    [("ddim", 1), ("rotation_2", 2), ("adams_bashforth_2", 2), ("rotation_3", 2), ("adams_bashforth_3", 2)],
)
def test_rules_have_their_order(rule, order):
    """One Gaussian component of 0.6: smooth, so that the order shows already between 80 and 160 steps.

    The first step of all is DDIM's, with an error of h^2: it holds the third-order rules at 2, a reason against them.
    """
    errors = [abs(10 ** (component_levels(rule, n, spreads=[0.6])[0] / 20) - 1) for n in (80, 160)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.15)


def test_rotation_is_what_the_scheduler_does():
    def velocity(x, phi):
        return np.tanh(1.3 * x) * np.cos(2 * phi)

    noise = np.random.default_rng(0).standard_normal(50)
    expected = run(RULES["rotation_2"], spaced_angles(9, "both_ends"), velocity, noise)
    scheduler, x = VDDIMScheduler(multistep_order=2, spacing="both_ends"), torch.from_numpy(noise)
    scheduler.set_timesteps(9)
    for t, phi in zip(scheduler.timesteps, spaced_angles(9, "both_ends"), strict=False):
        x = scheduler.step(torch.from_numpy(velocity(x.numpy(), phi)), t, x).prev_sample
    np.testing.assert_allclose(x.numpy(), expected, atol=1e-12)


def test_components_of_the_issue_are_reproduced():
    """Figures that others found for uniform steps: DDIM -5.8 dB at s = 0.1 and 10 steps, -14.7 at 0.03, and so on."""
    assert component_levels("ddim", 10, spreads=[0.1, 0.03]) == pytest.approx([-5.8, -14.7], abs=0.05)
    assert component_levels("adams_bashforth_2", 10, spreads=[0.1, 0.03]) == pytest.approx([-4.4, -14.3], abs=0.05)
    assert component_levels("adams_bashforth_2", 4, spreads=[0.01])[0] == pytest.approx(3.8, abs=0.05)  # amplified


def test_mixture_orders_and_the_gain_of_the_second():
    errors, orders = mixture_errors(("ddim", "rotation_2"), ("uniform", "both_ends"), (4, 10, 20, 160))
    assert orders["ddim"]["uniform"] > 0.9 and orders["rotation_2"]["uniform"] > 1.8
    # four steps of the second order against ten of DDIM: the aim of this project
    assert errors["rotation_2"]["both_ends"]["4"]["rms"] < errors["ddim"]["uniform"]["10"]["rms"]


def test_texture_components_have_unit_power_on_average(pipe, pink_noise):
    textures = pink_noise(16384, 10_000, count=3)
    for whitened in (True, False):
        deviations = texture_deviations(pipe, textures, 10_000, whitened)
        assert deviations.shape[0] == 3 and deviations.shape[1] > 40
        # 64 bands up to 1250 Hz share the power 1; those outside of 20-1000 Hz are empty
        assert np.mean(deviations**2) == pytest.approx(64 / deviations.shape[1], rel=0.25)
    levels = spectrum_levels(deviations, (4,), ("ddim",), ("uniform",))["ddim"]["uniform"]["4"]
    assert levels["lowest"] < levels["highest"] < 0 < levels["mean"]


def test_trained_comparison_on_tiny_networks(pipe, pink_noise, monkeypatch):
    """Random networks are no better than chance, but the error of their solution must fall with the steps."""
    monkeypatch.setattr(solver_study, "REFERENCE_STEPS", 200)
    real = pink_noise(16384 // 8, 10_000, count=3)
    stage = TrainedStage(pipe, "dale", real, np.zeros((3, 3)), 10_000)
    found = trained_errors(stage, steps=(2, 20))
    assert set(found) == set(schedulers())
    for name, by_steps in found.items():
        # extrapolated data run away under a network that was never trained (DPM-Solver++)
        if "DPM" not in name:
            assert by_steps["20"]["solver_rms"]["mean"] < by_steps["2"]["solver_rms"]["mean"]
    assert (
        found["order 2, both_ends"]["20"]["solver_rms"]["mean"] < found["order 1, uniform"]["20"]["solver_rms"]["mean"]
    )
    # diffusers' DDIM on our own betas is our order 1
    ours, theirs = (found[name]["20"]["solver_rms"]["mean"] for name in ("order 1, uniform", "diffusers DDIM"))
    assert theirs == pytest.approx(ours, rel=0.02)


def test_settled_is_the_first_count_within_the_noise_of_the_best():
    by_steps = {
        str(n): {"ktd": number(mean, 9, (mean - 2, mean + 2))} for n, mean in ((1, 30.0), (4, 10.9), (10, 10.0))
    }
    assert settled_at(by_steps, "ktd") == 4  # 10.9 lies within the standard error, 1.0, of the best
    by_steps["25"] = {"ktd": number(12.0, 9, (10, 14))}  # what leaves the noise again has not settled
    assert settled_at(by_steps, "ktd") is None
    assert settled_at({"1": {"ktd": number()}}, "ktd") is None
