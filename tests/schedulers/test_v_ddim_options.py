"""Options of `VDDIMScheduler`: fresh noise, starts part-way, one's own timesteps, spacings, configs of others."""

import math

import numpy as np
import pytest
import torch
from diffusers import DDIMScheduler, DPMSolverMultistepScheduler
from diffusers.training_utils import compute_snr
from solvers import rotation_2, run

from tactile_diffusers import VDDIMScheduler
from tactile_diffusers.schedulers import draw_noise
from tactile_diffusers.schedulers.scheduling_v_ddim import SPACINGS, spaced_angles

OTHERS = [DDIMScheduler, DPMSolverMultistepScheduler]


def _noise(*shape, seed=0, dtype=torch.float32):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def _generator(seed):
    return torch.Generator().manual_seed(seed)


def _angle(t):
    return math.pi / 2 * (float(t) + 1) / 1000


def _model(x, phi):
    return torch.tanh(1.3 * x) * math.cos(3 * phi) + 0.2 * x


def _follow(scheduler, x, first=0, velocity=_model, **kwargs):
    """The loop over the timesteps that are set."""
    for t in scheduler.timesteps[first:]:
        x = scheduler.step(velocity(x, _angle(t)), t, x, **kwargs).prev_sample
    return x


def _sample(scheduler, x, steps, **kwargs):
    scheduler.set_timesteps(steps)
    return _follow(scheduler, x, **kwargs)


# --- fresh noise


def test_eta_0_is_deterministic_and_draws_nothing():
    noise, generator = _noise(2, 1, 32), _generator(5)
    before = generator.get_state()
    made = _sample(VDDIMScheduler(), noise, 6, eta=0.0, generator=generator)
    assert torch.equal(made, _sample(VDDIMScheduler(), noise, 6))
    assert torch.equal(generator.get_state(), before)


@pytest.mark.parametrize("deviation", [0.3, 1.0, 2.0])
@pytest.mark.parametrize("eta", [0.4, 1.0])
def test_eta_gives_the_variance_of_song_et_al(eta, deviation):
    # For data N(0, s^2) every step is linear: x' = gain x + spread * noise, with alpha_bar = cos^2 and the spread of
    # equation 16. The variance follows from that alone, in float64; many steps lead to s^2.
    def velocity(x, phi):
        cos, sin = math.cos(phi), math.sin(phi)
        return x * (1 - deviation**2) * sin * cos / ((deviation * cos) ** 2 + sin**2)

    def variance_after(steps):
        variance, angles = 1.0, math.pi / 2 * (1 - np.arange(steps + 1) / steps)
        for phi, following in zip(angles[:-1], angles[1:], strict=True):
            bar, bar_next = math.cos(phi) ** 2, math.cos(following) ** 2
            spread = eta * math.sqrt((1 - bar_next) / (1 - bar) * (1 - bar / bar_next))
            marginal = deviation**2 * bar + 1 - bar
            data, noise = deviation**2 * math.sqrt(bar) / marginal, math.sqrt(1 - bar) / marginal  # predicted, per x
            gain = math.sqrt(bar_next) * data + math.sqrt(max(0.0, 1 - bar_next - spread**2)) * noise
            variance = gain**2 * variance + spread**2
        return variance

    samples = 100_000
    made = _sample(VDDIMScheduler(), _noise(samples), 12, velocity=velocity, eta=eta, generator=_generator(1))
    # a variance of 100,000 Gaussian samples has a relative standard error of sqrt(2 / 100,000) = 0.45 %: 4 of them
    assert float(made.var()) == pytest.approx(variance_after(12), rel=0.018)
    assert abs(float(made.mean())) < 4 * math.sqrt(variance_after(12) / samples)
    assert variance_after(2000) == pytest.approx(deviation**2, rel=0.01)  # first order: measured 0.6 % at worst


@pytest.mark.parametrize("eta", [-0.1, 1.01, float("nan"), float("inf")])
def test_eta_out_of_range_is_refused(eta):
    scheduler, x = VDDIMScheduler(), _noise(1, 4)
    scheduler.set_timesteps(3)
    with pytest.raises(ValueError, match="`eta` must be between 0 and 1"):
        scheduler.step(x, scheduler.timesteps[0], x, eta=eta)


# --- starting part-way, and again


@pytest.mark.parametrize("spacing", SPACINGS)
@pytest.mark.parametrize("by_index", [True, False])
def test_order_2_starts_part_way_with_a_step_of_order_1(spacing, by_index):
    scheduler, x = VDDIMScheduler(multistep_order=2, spacing=spacing), _noise(20, dtype=torch.float64)
    _sample(scheduler, x, 8)  # an earlier run, whose history must be gone
    scheduler.set_timesteps(8)
    if by_index:
        scheduler.set_begin_index(3)
    angles = spaced_angles(8, spacing)[3:]
    expected = run(rotation_2, angles, lambda x, phi: np.tanh(1.3 * x) * math.cos(3 * phi) + 0.2 * x, x.numpy())
    made = x
    for t, phi in zip(scheduler.timesteps[3:], angles, strict=False):
        made = scheduler.step(_model(made, phi), t, made).prev_sample
    np.testing.assert_allclose(made.numpy(), expected, rtol=0, atol=1e-12)  # float64
    assert scheduler.step_index == 8


@pytest.mark.parametrize("order", [1, 2])
def test_buffers_that_are_used_again_change_nothing(order):
    # as with CUDA graphs: model output and sample are always the same memory
    scheduler, expected = (
        VDDIMScheduler(multistep_order=order),
        _sample(VDDIMScheduler(multistep_order=order), _noise(64), 8),
    )
    x, v = _noise(64), torch.empty(64)
    scheduler.set_timesteps(8)
    for t in scheduler.timesteps:
        v.copy_(_model(x, _angle(t)))
        x.copy_(scheduler.step(v, t, x).prev_sample)
    assert torch.equal(x, expected)


# --- one's own timesteps


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("spacing", SPACINGS)
def test_the_preset_as_own_timesteps_is_the_preset(spacing, order):
    preset, own = VDDIMScheduler(multistep_order=order, spacing=spacing), VDDIMScheduler(multistep_order=order)
    noise = _noise(64)
    expected = _sample(preset, noise, 9)
    own.set_timesteps(timesteps=preset.timesteps)
    assert torch.equal(own.timesteps, preset.timesteps)
    # float32 timesteps of up to 999 are angles to 5e-8 rad
    torch.testing.assert_close(_follow(own, noise), expected, rtol=0, atol=2e-6)


@pytest.mark.parametrize(
    "timesteps",
    [
        [],
        [500, 999],
        [999, 500, 500],
        [999, 100, 500],
        [1000, 500],
        [999, -1],
        [999, -2.5],
        [999, float("nan")],
        [float("inf"), 500],
        [[999, 500]],
        999,
    ],
)
def test_unusable_timesteps_are_refused(timesteps):
    scheduler = VDDIMScheduler()
    scheduler.set_timesteps(4)
    before = scheduler.timesteps
    with pytest.raises(ValueError, match=r"`timesteps` must fall, without repeats, inside \(-1, 999\], got"):
        scheduler.set_timesteps(timesteps=timesteps)
    assert torch.equal(scheduler.timesteps, before)  # and nothing is broken


# --- spacings


def test_spacings_are_what_they_say():
    way = 1 - np.arange(11) / 10
    tolerance = dict(rtol=0, atol=1e-14)  # float64
    np.testing.assert_allclose(spaced_angles(10), math.pi / 2 * way, **tolerance)
    cosine = (1 - np.cos(math.pi * way)) / 2
    np.testing.assert_allclose(spaced_angles(10, "both_ends"), math.pi / 2 * (way + cosine) / 2, **tolerance)


# --- to diffusers' schedulers


@pytest.mark.parametrize("length", [1, 2, 50, 1000])
def test_betas_and_alphas_are_those_of_cos_squared(length):
    scheduler = VDDIMScheduler(length)
    expected = np.cos(math.pi / 2 * np.arange(1, length + 1) / length) ** 2
    for values in (scheduler.alphas_cumprod, torch.cumprod(1 - scheduler.betas.double(), 0)):
        np.testing.assert_allclose(values, expected, rtol=0, atol=1e-6)  # float32 products
    assert scheduler.betas[-1] == 1 and scheduler.alphas_cumprod[-1] == 0
    assert scheduler.betas.dtype == scheduler.alphas_cumprod.dtype == torch.float32


def test_the_signal_to_noise_ratio_of_diffusers_training():
    timesteps = torch.tensor([0, 250, 998, 999])
    expected = torch.tan(math.pi / 2 * (timesteps.double() + 1) / 1000) ** -2
    expected[-1] = 0
    found = compute_snr(VDDIMScheduler(), timesteps).double()
    torch.testing.assert_close(found, expected, rtol=0.02, atol=0)  # 1 - alpha in float32


def test_a_loaded_config_holds_its_arguments_alone(config, tmp_path):
    VDDIMScheduler.from_config(config).save_pretrained(tmp_path)
    loaded = VDDIMScheduler.from_pretrained(tmp_path).config
    assert "_use_default_values" not in loaded and loaded.prediction_type == "v_prediction"


def test_the_order_of_a_dpm_solver_is_its_own_affair():
    first_order = DPMSolverMultistepScheduler.from_config(VDDIMScheduler(multistep_order=1).config)
    assert first_order.config.solver_order == 2  # diffusers' default
    third_order = DPMSolverMultistepScheduler.from_config(VDDIMScheduler().config, solver_order=3)
    assert VDDIMScheduler.from_config(third_order.config).config.multistep_order == 1


@pytest.fixture(params=["made", "saved"])
def config(request, tmp_path):
    """The config of a new scheduler with defaults, and of the same one from its file: they must say the same."""
    scheduler = VDDIMScheduler()
    if request.param == "saved":
        scheduler.save_pretrained(tmp_path)
        scheduler = VDDIMScheduler.from_pretrained(tmp_path)
    return scheduler.config


def _only_unused_keys(found):
    return [text for text in found if "are not expected and will be ignored" not in text]


def _angles_of(other):
    return np.arccos(np.sqrt(other.alphas_cumprod.double().numpy()))


@pytest.mark.parametrize("other", OTHERS)
def test_our_config_says_what_diffusers_schedulers_need(other, config, recorded_warnings):
    with recorded_warnings() as found:
        made = other.from_config(config)
    assert not _only_unused_keys(found)
    wanted = {
        "num_train_timesteps": 1000,
        "prediction_type": "v_prediction",
        "beta_schedule": "squaredcos_cap_v2",
        "timestep_spacing": "trailing",
        "rescale_betas_zero_snr": True,
    }
    assert {key: made.config[key] for key in wanted} == wanted
    assert made.config.get("clip_sample", False) is False
    # their schedule lags by up to 0.0125 rad (docstring; measured 0.011), the last alpha is 2^-24 for DPM-Solver
    assert np.abs(_angles_of(made) - math.pi / 2 * np.arange(1, 1001) / 1000).max() <= 0.0125


@pytest.mark.parametrize(
    ("other", "order", "tolerance"),
    # the schedule lags by 0.011 rad, samples and velocities have a size of 1 to 3: measured 0.014. DPM-Solver++ 2M is
    # another rule beside: measured 0.019. Were the model one of noise, of another schedule or clipped: above 0.5
    [(DDIMScheduler, 1, 0.03), (DPMSolverMultistepScheduler, 2, 0.04)],
)
def test_diffusers_schedulers_sample_close_to_ours(config, other, order, tolerance):
    noise = _noise(200)
    ours = _sample(VDDIMScheduler(multistep_order=order), noise, 50)
    theirs = other.from_config(config, solver_order=2) if order == 2 else other.from_config(config)
    made = _sample(theirs, noise, 50)
    assert (made - ours).abs().max() < tolerance


# --- from diffusers' schedulers


@pytest.mark.parametrize("other", OTHERS)
def test_a_v_prediction_cosine_scheduler_becomes_ours(other, recorded_warnings):
    theirs = other(num_train_timesteps=400, prediction_type="v_prediction", beta_schedule="squaredcos_cap_v2")
    with recorded_warnings() as found:
        ours = VDDIMScheduler.from_config(theirs.config)
    assert not _only_unused_keys(found)
    assert ours.config.num_train_timesteps == 400 and len(ours) == 400
    assert _sample(ours, _noise(8), 5).isfinite().all()


@pytest.mark.parametrize("other", OTHERS)
def test_trained_betas_of_our_schedule_are_accepted(other):
    theirs = other(trained_betas=VDDIMScheduler().betas.tolist(), prediction_type="v_prediction")
    assert len(VDDIMScheduler.from_config(theirs.config)) == 1000
    cosine = other(beta_schedule="squaredcos_cap_v2").betas.tolist()  # of diffusers' own, nearly the same schedule
    assert len(VDDIMScheduler(trained_betas=cosine)) == 1000


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"beta_schedule": "squaredcos_cap_v2"}, "`prediction_type` must be 'v_prediction', got 'epsilon'"),
        (
            {"beta_schedule": "squaredcos_cap_v2", "prediction_type": "sample"},
            "`prediction_type` must be 'v_prediction', got 'sample'",
        ),
        ({"prediction_type": "v_prediction"}, "`beta_schedule` must be 'squaredcos_cap_v2', got 'linear'"),
        (
            {"prediction_type": "v_prediction", "beta_schedule": "scaled_linear"},
            "`beta_schedule` must be 'squaredcos_cap_v2', got 'scaled_linear'",
        ),
        ({"prediction_type": "v_prediction", "trained_betas": [0.01] * 1000}, "`trained_betas` must be those of cos"),
        ({}, "`(prediction_type|beta_schedule)` must be"),  # every default of theirs is wrong for us
    ],
)
@pytest.mark.parametrize("saved", [False, True])
@pytest.mark.parametrize("other", OTHERS)
def test_schedulers_of_another_model_are_refused(other, saved, changes, message, tmp_path):
    theirs = other(**changes)
    if saved:
        theirs.save_pretrained(tmp_path)
    with pytest.raises(ValueError, match=message):
        VDDIMScheduler.from_pretrained(tmp_path) if saved else VDDIMScheduler.from_config(theirs.config)


@pytest.mark.parametrize(
    "betas",
    [
        [],
        [0.5] * 999,
        [2.0] * 1000,
        [float("nan")] * 1000,
        VDDIMScheduler(500).betas.tolist(),
        np.linspace(1e-4, 0.02, 1000).tolist(),
    ],
)
def test_foreign_betas_are_refused(betas):
    with pytest.raises(ValueError, match="`trained_betas` must be those of cos.2 over 1000 timesteps"):
        VDDIMScheduler(trained_betas=betas)


# --- configs


OPTIONS = {
    "num_train_timesteps": 400,
    "multistep_order": 2,
    "spacing": "both_ends",
    "rescale_betas_zero_snr": False,
    "timestep_spacing": "leading",
    "clip_sample": True,
}


def test_every_option_survives_its_file(tmp_path, recorded_warnings):
    made = VDDIMScheduler(**OPTIONS, trained_betas=VDDIMScheduler(400).betas.tolist())
    with recorded_warnings() as found:
        made.save_pretrained(tmp_path)
        loaded = VDDIMScheduler.from_pretrained(tmp_path)
        again = VDDIMScheduler.from_config(loaded.config)
    assert not found
    for scheduler in (loaded, again):
        assert {key: scheduler.config[key] for key in OPTIONS} == OPTIONS
        assert scheduler.config.trained_betas == VDDIMScheduler(400).betas.tolist()
        assert scheduler.config.prediction_type == "v_prediction"
    noise = _noise(16)
    assert torch.equal(_sample(again, noise, 7), _sample(made, noise, 7))


# --- noise


@pytest.mark.parametrize("dtype", [torch.float64, torch.bfloat16, torch.float16])
@pytest.mark.parametrize("count", [8, 17, 100, 2048])
def test_a_seed_draws_the_same_noise_in_every_dtype(dtype, count):
    noise, expected = (
        draw_noise((1, count), torch.Generator().manual_seed(3), "cpu", d) for d in (dtype, torch.float32)
    )
    assert noise.dtype == dtype and torch.equal(noise, expected.to(dtype))
