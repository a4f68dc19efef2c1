"""diffusers' schedulers in either stage: the same textures, seeds that count, and refusals before any work."""

import diffusers
import numpy as np
import pytest
import torch

from tactile_diffusers import VDDIMScheduler
from tactile_diffusers.pipelines.components import check_scheduler
from tactile_diffusers.signal import nine_band_error_db, rms

pytestmark = pytest.mark.filterwarnings("ignore:__array_wrap__:DeprecationWarning")  # of diffusers' own schedulers
DETERMINISTIC = ("DDIM", "DPMSolverMultistep", "EulerDiscrete", "HeunDiscrete", "KDPM2Discrete", "LMSDiscrete", "PNDM")
#: of both stages: what is left of the error is that of first-order solvers
STEPS = 30
STOCHASTIC = ("DDPM", "EulerAncestralDiscrete", "LCM", "SASolver", "TCD")


def scheduler_of(name, **options):
    if name == "HeunDiscrete":
        options = {"use_exponential_sigmas": True, **options}
    return getattr(diffusers, f"{name}Scheduler").from_config(VDDIMScheduler().config, **options)


def generated(pipe, seed=0, ratings=(1.0, -0.5, 0.3), **options):
    options = {"num_inference_steps": 3, "generator": torch.Generator().manual_seed(seed), **options}
    return pipe(list(ratings), **options)


@pytest.fixture(scope="module")
def solved(make_pipeline):
    pipe = make_pipeline()
    pipe.scheduler, pipe.dale_scheduler = (VDDIMScheduler(multistep_order=2) for _ in range(2))
    return generated(pipe, num_inference_steps=STEPS)


@pytest.mark.parametrize("name", DETERMINISTIC)
def test_deterministic_schedulers_give_the_same_texture(pipe, solved, name):
    """All solve one equation. Without `init_noise_sigma` the error is 8 dB and more."""
    pipe.scheduler, pipe.dale_scheduler = scheduler_of(name), scheduler_of(name)
    out = generated(pipe, num_inference_steps=STEPS)
    error = nine_band_error_db(out.textures[0], solved.textures[0], out.sampling_rate)
    assert error < 1.0 and abs(out.level - solved.level) < 0.1, (error, out.level, solved.level)


@pytest.mark.parametrize("name", STOCHASTIC)
def test_the_generator_reaches_every_step(pipe, name):
    pipe.scheduler, pipe.dale_scheduler = scheduler_of(name), scheduler_of(name)
    state = torch.get_rng_state()
    first, again, other = (generated(pipe, seed).textures for seed in (3, 3, 4))
    assert torch.equal(torch.get_rng_state(), state)
    assert np.array_equal(first, again) and rms((first - other)[0]) > 0.1 * rms(first[0])
    generators = [torch.Generator().manual_seed(seed) for seed in (3, 4)]
    listed = generated(pipe, ratings=[[1.0, 0.0, 0.0]] * 2, generator=generators)
    alone = generated(pipe, 4, [1.0, 0.0, 0.0]).textures[0]
    assert rms(listed.textures[1] - alone) < 1e-3 * rms(alone)


def test_every_stage_counts_the_evaluations_of_its_scheduler(pipe, calls_of):
    pipe.scheduler = scheduler_of("HeunDiscrete")
    indices = []
    generated(pipe, callback_on_step_end=lambda pipe, index, t, tensors: indices.append(index))
    assert indices == list(range(pipe.num_timesteps)) and pipe.num_timesteps == 3 + 5


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("FlowMatchEulerDiscrete", {}, "FlowMatchEulerDiscreteScheduler: it samples models with another objective"),
        ("IPNDM", {}, "IPNDMScheduler: it samples models with another objective"),
        ("EDMEuler", {}, "EDMEulerScheduler: it samples models with another objective"),
        ("RePaint", {}, "RePaintScheduler: it samples models with another objective"),
        ("DDIMInverse", {}, "DDIMInverseScheduler: it adds noise"),
        ("UniPCMultistep", {"use_flow_sigmas": True}, "UniPCMultistepScheduler with flow sigmas"),
        ("EulerDiscrete", {"prediction_type": "epsilon"}, "`prediction_type` 'v_prediction', .* 'epsilon'"),
        ("EulerDiscrete", {"beta_schedule": "linear"}, "noise schedule .* with 'linear'"),
        ("HeunDiscrete", {"use_exponential_sigmas": False}, "`use_exponential_sigmas` .*diverges"),
        ("KDPM2AncestralDiscrete", {}, "KDPM2AncestralDiscreteScheduler: it diverges"),
        ("UnCLIP", {}, "UnCLIPScheduler: it does not know v-prediction"),
    ],
)
@pytest.mark.parametrize("stage", ["scheduler", "dale_scheduler"])
def test_other_schedulers_are_refused_by_name_before_any_work(pipe, calls_of, stage, name, options, message):
    calls = calls_of(pipe.dale)
    setattr(pipe, stage, scheduler_of(name, **options))
    with pytest.raises(ValueError, match=f"`{stage}` must .*{message}"):
        generated(pipe)
    if stage == "scheduler":
        with pytest.raises(ValueError, match=f"`{stage}` must .*{message}"):
            pipe.reconstruct(np.ones(2048, np.float32), 10_000)
    assert not calls


def test_a_scheduler_whose_noise_has_no_seed_is_refused():
    class DPMSolverSDEScheduler:
        pass

    with pytest.raises(ValueError, match="DPMSolverSDEScheduler: `generator` does not reach its noise"):
        check_scheduler("scheduler", DPMSolverSDEScheduler())
