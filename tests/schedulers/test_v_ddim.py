"""`VDDIMScheduler` against formulas written again here, against diffusers' DDIM, and at its edges."""

import math

import numpy as np
import pytest
import torch
from diffusers import DDIMScheduler

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


def _ddim_cosine(steps, beta_end=1.0):
    """diffusers' DDIM on the same schedule: cumulative alpha = cos^2(phi) at phi = pi/2 (t + 1) / 1000."""
    angles = np.arange(1, 1001) / 1000 * np.pi / 2
    alphas_bar = np.cos(angles) ** 2
    betas = 1 - alphas_bar / np.concatenate([[1.0], alphas_bar[:-1]])
    scheduler = DDIMScheduler(
        trained_betas=betas.tolist(),
        prediction_type="v_prediction",
        timestep_spacing="trailing",
        clip_sample=False,
        set_alpha_to_one=True,
    )
    scheduler.set_timesteps(steps)
    return scheduler


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


def test_ten_steps_are_the_timesteps_of_diffusers_trailing_ddim():
    scheduler = VDDIMScheduler()
    scheduler.set_timesteps(10)
    assert scheduler.timesteps.tolist() == [999, 899, 799, 699, 599, 499, 399, 299, 199, 99]
    assert scheduler.timesteps.tolist() == _ddim_cosine(10).timesteps.tolist()


# --- whole loops


@pytest.mark.parametrize("shape", [(2, 5), (2, 3, 5), (2, 3, 4, 5), (2, 2, 3, 4, 5)])
def test_rank_and_layout_do_not_matter(shape):
    scheduler, x, v = VDDIMScheduler(), _noise(*shape), _noise(*shape, seed=1)
    timesteps = torch.tensor([700.0, 12.5])
    scheduler.set_timesteps(3)
    flat = scheduler.step(v.flatten(), scheduler.timesteps[0], x.flatten()).prev_sample
    scheduler.set_timesteps(3)
    assert torch.equal(scheduler.step(v, scheduler.timesteps[0], x).prev_sample.flatten(), flat)
    noisy, velocity = scheduler.add_noise(x, v, timesteps), scheduler.get_velocity(x, v, timesteps)
    assert noisy.shape == velocity.shape == shape
    for row in range(2):
        alone = scheduler.add_noise(x[row : row + 1], v[row : row + 1], timesteps[row : row + 1])
        assert torch.equal(noisy[row : row + 1], alone)


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


def test_a_scalar_or_integer_timestep_is_broadcast():
    scheduler, x0, noise = VDDIMScheduler(), _noise(3, 2, 8), _noise(3, 2, 8, seed=1)
    expected = scheduler.add_noise(x0, noise, torch.tensor([250.0, 250.0, 250.0]))
    for timestep in (250, 250.0, torch.tensor(250), torch.tensor([250, 250, 250]), torch.tensor(250.0)):
        assert torch.equal(scheduler.add_noise(x0, noise, timestep), expected)


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


def test_defaults_are_ready_to_train():
    scheduler = VDDIMScheduler()
    assert scheduler.init_noise_sigma == 1.0 and scheduler.order == 1 and len(scheduler.timesteps) == 1000
    sample = _noise(1, 2, 3)
    assert scheduler.scale_model_input(sample, 3) is sample
    assert scheduler.num_inference_steps is None and scheduler.step_index is None and scheduler.begin_index is None


def test_tuple_output():
    scheduler, x, v = VDDIMScheduler(), _noise(1, 1, 8), _noise(1, 1, 8, seed=1)
    scheduler.set_timesteps(4)
    plain = scheduler.step(v, scheduler.timesteps[0], x, return_dict=False)
    scheduler.set_timesteps(4)
    out = scheduler.step(v, scheduler.timesteps[0], x)
    assert isinstance(plain, tuple)
    assert torch.equal(plain[0], out.prev_sample) and torch.equal(plain[1], out.pred_original_sample)
    assert torch.equal(out[0], out.prev_sample)


def test_a_loop_may_start_part_way():
    scheduler, x, v = VDDIMScheduler(), _noise(1, 1, 8), _noise(1, 1, 8, seed=1)
    scheduler.set_timesteps(10)
    from_timestep = scheduler.step(v, scheduler.timesteps[4], x).prev_sample  # found from the timestep
    assert scheduler.step_index == 5
    scheduler.set_timesteps(10)
    scheduler.set_begin_index(4)
    assert scheduler.begin_index == 4
    assert torch.equal(scheduler.step(v, scheduler.timesteps[4], x).prev_sample, from_timestep)
    turn = math.pi / 20
    torch.testing.assert_close(from_timestep, math.cos(turn) * x - math.sin(turn) * v, rtol=0, atol=1e-6)


def test_set_timesteps_starts_again():
    scheduler, noise = VDDIMScheduler(), _noise(1, 1, 16)
    first = _sample(scheduler, _model, noise, 5)
    _sample(scheduler, _model, noise, 3)
    assert torch.equal(_sample(scheduler, _model, noise, 5), first)


def test_step_before_set_timesteps_is_refused():
    with pytest.raises(ValueError, match="Number of inference steps is 'None', you need to run 'set_timesteps' after"):
        VDDIMScheduler().step(_noise(1), 999, _noise(1))


def test_step_after_the_end_is_refused():
    scheduler, x = VDDIMScheduler(), _noise(1, 1, 4)
    _sample(scheduler, _model, x, 2)
    with pytest.raises(ValueError, match="after the last timestep"):
        scheduler.step(x, scheduler.timesteps[-1], x)


@pytest.mark.parametrize("steps", [0, -3, 2.5, float("nan"), float("inf")])
def test_bad_numbers_of_steps_are_refused(steps):
    with pytest.raises(ValueError, match="`num_inference_steps` must be a whole number >= 1"):
        VDDIMScheduler().set_timesteps(steps)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"num_train_timesteps": 0}, "`num_train_timesteps` must be at least 1"),
        ({"multistep_order": 0}, "`multistep_order`"),
        ({"multistep_order": 3}, "`multistep_order`"),
        ({"spacing": "karras"}, "`spacing` must be one of .*, got 'karras'"),
    ],
)
def test_bad_configs_are_refused(config, message):
    with pytest.raises(ValueError, match=message):
        VDDIMScheduler(**config)
