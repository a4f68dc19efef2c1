"""Hard cases for `VDDIMScheduler`: step counts, precisions, scales, wrong models, guidance, broken numbers."""

import math

import numpy as np
import pytest
import torch
from scipy.special import ellipk

from tactile_diffusers import VDDIMScheduler
from tactile_diffusers.schedulers.scheduling_v_ddim import SPACINGS, spaced_angles

RULES = [(order, spacing) for order in (1, 2) for spacing in SPACINGS]


def _noise(*shape, seed=0, dtype=torch.float32):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64).to(dtype)


def _loop(order, spacing, velocity, x, steps):
    """`velocity(x, phi)` is followed from noise to data, with the angles in float64."""
    scheduler = VDDIMScheduler(multistep_order=order, spacing=spacing)
    scheduler.set_timesteps(steps)
    for t, phi in zip(scheduler.timesteps, spaced_angles(steps, spacing), strict=False):
        x = scheduler.step(velocity(x, phi), t, x).prev_sample
    return x


def _towards(data, noise):
    """The exact velocity of data that is one point, whatever x: errors of the state are never corrected."""
    return lambda x, phi: math.cos(phi) * noise - math.sin(phi) * data


def _gaussian(mean, deviation):
    """The exact velocity of data N(mean, deviation^2); the path ends at mean + deviation * noise."""

    def velocity(x, phi):
        cos, sin = math.cos(phi), math.sin(phi)
        offset, variance = x - mean * cos, (deviation * cos) ** 2 + sin**2
        return cos * sin * (1 - deviation**2) / variance * offset - sin * mean

    return velocity


# --- precision


@pytest.mark.parametrize("steps", [10, 300])
@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
@pytest.mark.parametrize(("order", "spacing"), RULES)
def test_the_model_may_be_of_half_precision(order, spacing, dtype, steps):
    data, noise = _noise(200, seed=1), _noise(200)
    exact = _towards(data, noise)
    made = _loop(order, spacing, lambda x, phi: exact(x, phi).to(dtype), noise, steps)
    # The sum of the turns is pi/2, so that rounding v (at most 3.5 here) by eps/2 can add up to no more than
    # 3.5 * pi/2 * eps/2 = 2.7 eps; measured 0.8 eps. Beside it float32 rounding, 2e-5 at 300 steps of one direction.
    bound = 2.7 * torch.finfo(dtype).eps + 6e-8 * steps
    assert made.dtype == torch.float32 and (made - data).abs().max() < bound


# --- a model that is wrong


@pytest.mark.parametrize(("order", "spacing"), RULES)
def test_a_constant_error_on_gaussians_does_not_grow_with_the_steps(order, spacing):
    deviations = torch.tensor([0.03, 0.3, 1.0, 3.0, 8.0], dtype=torch.float64)
    velocity, noise, found = _gaussian(0.0, deviations), torch.ones(5, dtype=torch.float64), []
    for steps in (10, 100, 300):
        wrong, right = (
            _loop(order, spacing, lambda x, phi, add=add: velocity(x, phi) + add, noise, steps) for add in (1e-3, 0.0)
        )
        found.append((wrong - right).abs().numpy())
    # The exact path stretches what is added at phi by s / sqrt(s^2 cos^2 + sin^2): an elliptic integral in all.
    exact = 1e-3 * ellipk(1 - 1 / deviations.numpy() ** 2)
    assert np.all(np.array(found) < 1.2 * exact)  # measured 1.18, DDIM at s = 0.03
    assert np.all(np.abs(found[2] / exact - 1)[1:] < 0.02)  # 0.03 needs more steps


def test_an_error_before_a_long_step_is_not_blown_up():
    # a step of 0.0002 rad tells nothing of the 1.4 rad that follow: an error of 1e-3 between the two would be 5
    data, noise, scheduler = _noise(8, seed=1), _noise(8), VDDIMScheduler(multistep_order=2)
    scheduler.set_timesteps(timesteps=[999.0, 998.9, 100.0])
    x = noise
    for index, t in enumerate(scheduler.timesteps):
        x = scheduler.step(_towards(data, noise)(x, math.pi / 2 * (float(t) + 1) / 1000) + 1e-3 * (index == 1), t, x)
        x = x.prev_sample
    assert (x - data).abs().max() < 1e-2


# --- guidance


def _guided(conditional, unconditional, scale):
    return lambda x, phi: unconditional(x, phi) + scale * (conditional(x, phi) - unconditional(x, phi))


@pytest.mark.parametrize("steps", [1, 4, 10, 20, 100])
@pytest.mark.parametrize(("order", "spacing"), RULES)
def test_the_hardest_pull_of_guidance_stays_finite_and_settles(order, spacing, steps):
    # a narrow Gaussian, N(0.9, 0.3^2) against N(0, 1), pulls in proportion to the distance, without limit: 20 times
    # that is beyond what an explicit step of a tenth of the way can follow. The exact paths end near 1.
    noise, narrow, wide = _noise(200), _gaussian(0.9, 0.3), _gaussian(0.0, 1.0)
    for scale in (3.0, 7.5, 20.0):
        made = _loop(order, spacing, _guided(narrow, wide, scale), noise, steps)
        assert made.isfinite().all() and made.abs().max() < 1e4  # measured 7e3: 5 steps, order 2, guidance 20
        if (steps >= 10 and scale < 7) or (steps >= 20 and scale < 10) or steps >= 100:
            assert made.abs().max() < 1.2  # measured 1.14


# --- NaN and infinity


def _broken(shape, value):
    broken = torch.zeros(shape)
    broken.flatten()[-1] = value
    return broken


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
@pytest.mark.parametrize("at", [0, 2, 4])
@pytest.mark.parametrize("order", [1, 2])
def test_on_the_cpu_a_broken_output_is_refused_at_once(order, at, value):
    scheduler, x = VDDIMScheduler(multistep_order=order), _noise(2, 1, 16)
    scheduler.set_timesteps(5)
    for t in scheduler.timesteps[:at]:
        x = scheduler.step(torch.zeros_like(x), t, x).prev_sample
    timestep = (999, 799, 599, 399, 199)[at]
    with pytest.raises(FloatingPointError, match=rf"NaN or infinity at step {at} of 5 \(timestep {timestep}\)"):
        scheduler.step(_broken(x.shape, value), scheduler.timesteps[at], x)
    # nothing has been taken from it: the step may be made again, and the loop goes on
    made = scheduler.step(torch.zeros_like(x), scheduler.timesteps[at], x).prev_sample
    assert made.isfinite().all() and scheduler.step_index == at + 1


class _Accelerated(torch.Tensor):
    """A CPU tensor that says it is on an accelerator, and counts how often the CPU would have waited for it."""

    reads = 0

    @property
    def device(self):
        return torch.device("cuda")

    def __bool__(self):
        _Accelerated.reads += 1
        return super().__bool__()

    def item(self):
        _Accelerated.reads += 1
        return super().item()


@pytest.mark.parametrize("at", [0, 2, 4, None])
@pytest.mark.parametrize("order", [1, 2])
def test_on_an_accelerator_a_broken_output_is_flagged_and_refused_at_the_end(order, at):
    scheduler, x = VDDIMScheduler(multistep_order=order), _noise(2, 1, 16)
    scheduler.set_timesteps(5)
    _Accelerated.reads = 0
    for index, t in enumerate(scheduler.timesteps[:-1]):
        output = _broken(x.shape, float("nan") if index == at else 0.5)
        # the sample is set again, so that the flag alone knows of the broken step
        scheduler.step(output.as_subclass(_Accelerated), t, x.as_subclass(_Accelerated))
    assert _Accelerated.reads == 0
    last = _broken(x.shape, float("nan") if at == 4 else 0.5).as_subclass(_Accelerated)
    if at is None:
        scheduler.step(last, scheduler.timesteps[-1], x)
    else:
        with pytest.raises(FloatingPointError, match="NaN or infinity at one of the 5 steps"):
            scheduler.step(last, scheduler.timesteps[-1], x)
    assert _Accelerated.reads == 1  # once, at the end
    scheduler.set_timesteps(1)  # a new run has forgotten the flag
    x = _noise(2, 1, 16).as_subclass(_Accelerated)
    assert scheduler.step(torch.zeros_like(x), scheduler.timesteps[0], x).prev_sample.isfinite().all()
