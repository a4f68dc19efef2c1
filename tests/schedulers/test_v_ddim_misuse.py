"""`VDDIMScheduler` used wrongly or started again, and its use by other schedulers: what the formulas do not show."""

import math

import pytest
import torch

from tactile_diffusers import VDDIMScheduler


@pytest.fixture
def noise():
    return torch.randn(1, 2, 16, generator=torch.Generator().manual_seed(0))


def _started(steps):
    scheduler = VDDIMScheduler()
    scheduler.set_timesteps(steps)
    return scheduler


@pytest.mark.parametrize("timestep", [500, 998.9, -1, 1000, float("nan")])
def test_a_foreign_first_timestep_is_refused_and_nothing_is_broken(noise, timestep):
    scheduler = _started(3)
    with pytest.raises(ValueError, match="`timestep` must be one of the scheduler's timesteps .*, got "):
        scheduler.step(noise, timestep, noise)
    made = scheduler.step(noise.flip(-1), scheduler.timesteps[0], noise).prev_sample
    fresh = _started(3)
    assert torch.equal(made, fresh.step(noise.flip(-1), fresh.timesteps[0], noise).prev_sample)


def test_step_leaves_its_inputs_alone(noise):
    scheduler, sample, velocity = _started(2), noise.clone(), noise.flip(-1).clone()
    scheduler.step(velocity, scheduler.timesteps[0], sample)
    assert torch.equal(sample, noise) and torch.equal(velocity, noise.flip(-1))


def test_a_begin_index_runs_to_the_end_and_is_forgotten_by_set_timesteps(noise):
    scheduler = _started(6)
    scheduler.set_begin_index(4)
    x = noise
    for timestep in scheduler.timesteps[4:]:
        x = scheduler.step(torch.zeros_like(x), timestep, x).prev_sample
    assert scheduler.step_index == 6
    # at v = 0 each of the two turns of 15 degrees multiplies by its cosine; float32
    torch.testing.assert_close(x, noise * math.cos(math.pi / 12) ** 2, rtol=0, atol=1e-6)
    scheduler.set_timesteps(6)
    assert scheduler.begin_index is None
    scheduler.step(noise, scheduler.timesteps[0], noise)
    assert scheduler.step_index == 1
