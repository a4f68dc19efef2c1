"""Any schedule, shape and dtype: of a single point every solver finds exactly that point."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_diffusers import VDDIMScheduler
from tactile_diffusers.schedulers.scheduling_v_ddim import SPACINGS

configs = st.fixed_dictionaries(
    {},
    optional={
        "num_train_timesteps": st.sampled_from([1, 2, 50, 1000, 4000]),
        "multistep_order": st.sampled_from([1, 2]),
        "spacing": st.sampled_from(SPACINGS),
    },
)
steps = st.one_of(*3 * [st.integers(1, 30)], st.just(1001))
shapes = st.lists(st.integers(1, 4), min_size=0, max_size=4).map(tuple)
# largest error after a loop: halves are rounded at every step, and float32's are of the size of the numbers
DTYPES = {torch.float64: 1e-9, torch.float32: 1e-4, torch.bfloat16: 0.1, torch.float16: 0.02}


@settings.get_profile("many")
@given(
    config=configs,
    count=steps,
    shape=shapes,
    dtype=st.sampled_from(list(DTYPES)),
    size=st.sampled_from([0.0, 1e-3, 1.0, 30.0]),
    seed=st.integers(0, 99),
)
def test_the_exact_velocity_of_a_point_leads_to_the_point(config, count, shape, dtype, size, seed):
    scheduler = VDDIMScheduler(**config)
    count = min(count, 60) if dtype not in (torch.float64, torch.float32) else count
    scheduler.set_timesteps(count)
    assert len(scheduler.timesteps) == scheduler.num_inference_steps == count
    generator = torch.Generator().manual_seed(seed)
    point = size * torch.randn(shape, generator=generator, dtype=torch.float64)
    x = torch.randn(shape, generator=generator, dtype=torch.float64).to(dtype)
    for number, t in enumerate(scheduler.timesteps):
        # if all data are this point: noise = (x - cos phi x0) / sin phi, v = cos phi noise - sin phi x0
        phi = float(scheduler._angles[number])
        noise = (x.double() - np.cos(phi) * point) / np.sin(phi)
        velocity = (np.cos(phi) * noise - np.sin(phi) * point).to(dtype)
        out = scheduler.step(velocity, t, x)
        assert out.prev_sample.shape == x.shape and out.prev_sample.dtype == dtype
        x = out.prev_sample
        assert torch.isfinite(x).all()
    torch.testing.assert_close(x.double(), point, atol=DTYPES[dtype] * (1 + size), rtol=0)


@settings.get_profile("many")
@given(config=configs, count=steps)
def test_timesteps_fall_from_pure_noise_and_stay_in_range(config, count):
    scheduler = VDDIMScheduler(**config)
    scheduler.set_timesteps(count)
    last = scheduler.config.num_train_timesteps - 1
    angles, times = scheduler._angles, scheduler.timesteps
    assert times[0] == last and (times > -1).all() and (times <= last).all()
    assert angles[0] == np.pi / 2 and angles[-1] == 0 and (np.diff(angles) < 0).all()
    np.testing.assert_allclose(scheduler.angle(times.double()), angles[:-1], rtol=1e-5, atol=1e-6)


@settings.get_profile("many")
@given(
    config=configs,
    time=st.floats(0, 1),
    shape=st.lists(st.integers(1, 4), min_size=1, max_size=3).map(tuple),
    dtype=st.sampled_from(list(DTYPES)),
)
def test_noising_is_undone_by_its_own_velocity(config, time, shape, dtype):
    scheduler = VDDIMScheduler(**config)
    t = torch.tensor([time * scheduler.config.num_train_timesteps - 1] * shape[0])
    clean, noise = torch.randn(2, *shape, generator=torch.Generator().manual_seed(0)).to(dtype)
    state, velocity = scheduler.add_noise(clean, noise, t), scheduler.get_velocity(clean, noise, t)
    assert state.dtype == velocity.dtype == dtype and state.shape == velocity.shape == shape
    close = {"atol": 3 * torch.finfo(dtype).eps * 4, "rtol": 0}
    torch.testing.assert_close(scheduler.get_original_sample(velocity, state, t), clean, **close)
    torch.testing.assert_close(scheduler.get_noise(velocity, state, t), noise, **close)


@pytest.mark.parametrize("count", [0, -1, 1.5, float("nan"), float("inf"), None])
def test_impossible_numbers_of_steps_are_refused(count):
    with pytest.raises(ValueError, match="`num_inference_steps`"):
        VDDIMScheduler().set_timesteps(count)
