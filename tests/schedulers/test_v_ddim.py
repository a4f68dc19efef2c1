"""`VDDIMScheduler` against formulas written again here, against diffusers' DDIM, and at its edges."""

import math

import pytest
import torch

from tactile_diffusers import VDDIMScheduler


def _noise(*shape, seed=0, dtype=torch.float32):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def _model(x, t):
    """A velocity that is neither linear nor periodic in x."""
    return torch.tanh(1.3 * x) * math.cos(0.002 * float(t)) + 0.2 * x


def _sample(scheduler, velocity, x, steps, order=None):
    scheduler.set_timesteps(steps)
    for t in scheduler.timesteps:
        x = scheduler.step(velocity(x, t), t, x).prev_sample
    return x


# --- one step


def test_step_equals_ddim_written_again():
    # paper: Song et al. 2021, equation 12 with sigma = 0, on alpha = cos phi, sigma = sin phi, in float64
    steps, scheduler = 9, VDDIMScheduler()
    scheduler.set_timesteps(steps)
    x, v = _noise(2, 3, 64), _noise(2, 3, 64, seed=1)
    for index, t in enumerate(scheduler.timesteps):
        phi, following = math.pi / 2 * (1 - index / steps), math.pi / 2 * (1 - (index + 1) / steps)
        x0 = math.cos(phi) * x.double() - math.sin(phi) * v.double()
        noise = math.sin(phi) * x.double() + math.cos(phi) * v.double()
        expected = math.cos(following) * x0 + math.sin(following) * noise
        out = scheduler.step(v, t, x)
        # float32 in and out: numbers up to 5 rounded at 2**-24
        torch.testing.assert_close(out.prev_sample.double(), expected, rtol=0, atol=1e-6)
        torch.testing.assert_close(out.pred_original_sample.double(), x0, rtol=0, atol=1e-6)


@pytest.mark.parametrize("num_train_timesteps", [1, 50, 1000])
def test_timesteps_are_the_angles(num_train_timesteps):
    scheduler = VDDIMScheduler(num_train_timesteps)
    scheduler.set_timesteps(7)
    angles = math.pi / 2 * (1 - torch.arange(7, dtype=torch.float64) / 7)
    assert scheduler.timesteps.dtype == torch.float32 and len(scheduler.timesteps) == 7
    expected = num_train_timesteps * angles / (math.pi / 2) - 1
    torch.testing.assert_close(scheduler.timesteps.double(), expected, rtol=1e-7, atol=1e-7)  # float32
    torch.testing.assert_close(scheduler.angle(scheduler.timesteps).double(), angles, rtol=1e-6, atol=1e-6)
    assert len(scheduler) == num_train_timesteps


# --- noise, velocity and data


def test_noise_velocity_and_data_are_inverse():
    scheduler = VDDIMScheduler()
    x0, noise = _noise(7, 3, 20), _noise(7, 3, 20, seed=1)
    timesteps = torch.tensor([-1.0, 0.0, 0.25, 300.0, 500.7, 998.9, 999.0])
    noisy, velocity = scheduler.add_noise(x0, noise, timesteps), scheduler.get_velocity(x0, noise, timesteps)
    phi = (math.pi / 2 * (timesteps.double() + 1) / 1000)[:, None, None]
    # float32 rounding of numbers up to 5
    expected = dict(rtol=0, atol=1e-6)
    torch.testing.assert_close(noisy.double(), phi.cos() * x0 + phi.sin() * noise, **expected)
    torch.testing.assert_close(velocity.double(), phi.cos() * noise - phi.sin() * x0, **expected)
    torch.testing.assert_close(scheduler.get_original_sample(velocity, noisy, timesteps), x0, **expected)
    assert torch.equal(noisy[0], x0[0])  # t = -1 is clean data
    torch.testing.assert_close(noisy[-1], noise[-1], rtol=0, atol=1e-7)  # t = 999 is pure noise


@pytest.mark.parametrize("dtype", [torch.float32, torch.float16, torch.bfloat16])
def test_dtype_is_kept_and_the_update_is_float32(dtype):
    scheduler, x, v = VDDIMScheduler(), _noise(2, 1, 64), _noise(2, 1, 64, seed=1)
    scheduler.set_timesteps(10)
    out = scheduler.step(v.to(dtype), scheduler.timesteps[0], x.to(dtype))
    assert out.prev_sample.dtype == dtype
    scheduler.set_timesteps(10)
    wide = scheduler.step(v.to(dtype).float(), scheduler.timesteps[0], x.to(dtype).float())
    assert torch.equal(out.prev_sample, wide.prev_sample.to(dtype))  # one rounding, at the end
    t = torch.tensor([3.0, 500.0])
    for method in (scheduler.add_noise, scheduler.get_velocity):
        assert method(x.to(dtype), v.to(dtype), t).dtype == dtype
    assert scheduler.get_original_sample(v.to(dtype), x.to(dtype), t).dtype == dtype


# --- interface


def test_step_before_set_timesteps_is_refused():
    with pytest.raises(ValueError, match="Number of inference steps is 'None', you need to run 'set_timesteps' after"):
        VDDIMScheduler().step(_noise(1), 999, _noise(1))


def test_step_after_the_end_is_refused():
    scheduler, x = VDDIMScheduler(), _noise(1, 1, 4)
    _sample(scheduler, _model, x, 2)
    with pytest.raises(ValueError, match="after the last timestep"):
        scheduler.step(x, scheduler.timesteps[-1], x)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"num_train_timesteps": 0}, "`num_train_timesteps` must be a whole number of at least 1"),
        ({"multistep_order": 0}, "`multistep_order`"),
        ({"multistep_order": 3}, "`multistep_order`"),
        ({"spacing": "karras"}, "`spacing` must be one of .*, got 'karras'"),
    ],
)
def test_bad_configs_are_refused(config, message):
    with pytest.raises(ValueError, match=message):
        VDDIMScheduler(**config)


@pytest.mark.parametrize("timestep", [500, 998.9, -1, 1000, float("nan")])
def test_a_foreign_first_timestep_is_refused_and_nothing_is_broken(timestep):
    scheduler, fresh, x, v = VDDIMScheduler(), VDDIMScheduler(), _noise(1, 16), _noise(1, 16, seed=1)
    scheduler.set_timesteps(3)
    with pytest.raises(ValueError, match="`timestep` must be one of the timesteps .*, got "):
        scheduler.step(v, timestep, x)
    fresh.set_timesteps(3)
    made, expected = (each.step(v, each.timesteps[0], x).prev_sample for each in (scheduler, fresh))
    assert torch.equal(made, expected)
