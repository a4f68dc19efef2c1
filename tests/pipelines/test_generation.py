"""`TactileTexturePipeline.__call__`: seeds, batches, ratings, guidance, callbacks, durations, outputs."""

import doctest
import os

import numpy as np
import pandas as pd
import pytest
import torch

from tactile_diffusers import (
    TactileLatents,
    TactileTextureEditPipeline,
    TactileTexturePipeline,
    TactileTexturePipelineOutput,
    bundled_checkpoint,
)
from tactile_diffusers.signal import rms

#: Batched and single convolutions add in another order: float32 errors of 1e-6 grow by the steps of two stages.
BATCH_TOLERANCE = 1e-4  # of a texture's RMS
SAMPLES = 2048  # of the tiny pipeline's segment, 0.2048 s


def _generator(seed=0):
    return torch.Generator().manual_seed(seed)


def _run(pipe, ratings=(1.0, -0.5, 0.3), seed=0, **kwargs):
    kwargs = {"num_inference_steps": 3, "generator": _generator(seed), **kwargs}
    return pipe(list(ratings) if isinstance(ratings, tuple) else ratings, **kwargs)


def _assert_same_textures(made, expected, tolerance=BATCH_TOLERANCE):
    assert made.shape == expected.shape
    assert (np.abs(made - expected).max(-1) <= tolerance * rms(expected)).all()


# --- output


def test_output_is_what_the_contract_says(pipe):
    out = _run(pipe, [[1.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    assert isinstance(out, TactileTexturePipelineOutput)
    assert out.textures.shape == (2, SAMPLES) and out.textures.dtype == np.float32
    assert out.level.shape == out.friction_coefficient.shape == (2,)
    assert out.level.dtype == out.friction_coefficient.dtype == np.float32
    assert out.sampling_rate == 10_000 and out.reference_speed == pipe.dale.config.reference_speed
    assert np.isfinite(out.textures).all() and (out.friction_coefficient > 0).all()
    # zero mean, and the RMS that the level says: float32 samples
    assert (abs(out.textures.mean(-1)) < 1e-6 * rms(out.textures)).all()
    np.testing.assert_allclose(rms(out.textures), np.exp(out.level), rtol=1e-5)
    assert not np.allclose(out.textures[0], out.textures[1], atol=1e-3)


def test_tuple_output(pipe):
    out, plain = _run(pipe), _run(pipe, return_dict=False)
    assert isinstance(plain, tuple) and len(plain) == 5
    assert np.array_equal(plain[0], out.textures) and np.array_equal(plain[1], out.friction_coefficient)
    assert np.array_equal(plain[2], out.level) and plain[3:] == (out.sampling_rate, out.reference_speed)
    latents = _run(pipe, output_type="latent", return_dict=False)
    assert isinstance(latents, tuple) and [part.shape for part in latents] == [(1, 4, 32), (1,), (1,)]


def test_latent_output_is_what_the_textures_are_decoded_from(pipe):
    def not_run(*args, **kwargs):
        raise AssertionError("LCTG must not run")

    out = _run(pipe)
    hook = pipe.lctg.register_forward_pre_hook(not_run)
    made = _run(pipe, output_type="latent")
    hook.remove()
    assert isinstance(made, TactileLatents) and made.latents.shape == (1, 4, 32)
    assert np.array_equal(made.level.numpy(), out.level)
    assert np.array_equal(made.friction_coefficient.numpy(), out.friction_coefficient)
    # the noise of the second stage is drawn after that of the first
    generator = _generator()
    torch.randn((1, 6, 32), generator=generator)
    again = pipe.decode(made.latents, made.level, made.friction_coefficient, 3, generator)
    assert np.array_equal(again.textures, out.textures)
    assert np.array_equal(again.friction_coefficient, out.friction_coefficient)


# --- seeds, takes and batches


def test_without_a_generator_the_global_seed_counts(pipe):
    torch.manual_seed(3)
    first = _run(pipe, generator=None)
    torch.manual_seed(3)
    assert np.array_equal(_run(pipe, generator=None).textures, first.textures)
    assert not np.allclose(_run(pipe, generator=None).textures, first.textures)


def _on_step(model, record):
    """Calls `record(args)` at each step of a model."""
    return model.register_forward_pre_hook(lambda module, args: record(args))


def test_one_generator_draws_for_dale_and_then_for_lctg(pipe):
    ratings, generator = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], _generator(4)
    state = torch.randn((2, 6, 32), generator=generator)  # DALE's noise, the whole batch
    waveform = torch.randn((2, 1, 512), generator=generator)  # then LCTG's
    dale, lctg = [], []
    _on_step(pipe.dale, lambda args: dale.append(args[0].clone()))
    _on_step(pipe.lctg, lambda args: lctg.append(args[0].clone()))
    used = _generator(4)
    _run(pipe, ratings, generator=used)
    assert torch.equal(dale[0], state) and torch.equal(lctg[0], waveform)
    assert torch.equal(torch.randn(3, generator=used), torch.randn(3, generator=generator))  # and nothing else


# --- ratings


def test_forms_of_ratings_are_equal(pipe):
    expected = _run(pipe, [[1.0, -0.5, 0.3]])
    for form in (
        [1.0, -0.5, 0.3],
        (1.0, -0.5, 0.3),
        {"roughness": 1.0, "bumpiness": -0.5, "slipperiness": 0.3},
        {"slipperiness": 0.3, "bumpiness": -0.5, "roughness": 1.0},
        [{"roughness": 1.0, "bumpiness": -0.5, "slipperiness": 0.3}],
        np.array([1.0, -0.5, 0.3]),
        np.array([[1.0, -0.5, 0.3]], dtype=np.float32),
        [np.array([1.0, -0.5, 0.3])],
        torch.tensor([1.0, -0.5, 0.3]),
        torch.tensor([[1.0, -0.5, 0.3]], dtype=torch.float64),
        torch.tensor([[1.0, -0.5, 0.3]], requires_grad=True),
        [torch.tensor([1.0, -0.5, 0.3])],
    ):
        assert np.array_equal(
            _run(pipe, form if not isinstance(form, tuple) else list(form)).textures, expected.textures
        )
    assert np.array_equal(
        pipe((1.0, -0.5, 0.3), num_inference_steps=3, generator=_generator()).textures, expected.textures
    )


def test_forms_of_not_specified_are_equal(pipe):
    expected = _run(pipe, [[1.0, float("nan"), float("nan")]])
    for form in (
        [1.0, None, None],
        [[1.0, None, float("nan")]],
        {"roughness": 1.0},
        [{"roughness": 1.0, "bumpiness": None}],
        np.array([1.0, np.nan, np.nan]),
        torch.tensor([1.0, torch.nan, torch.nan]),
    ):
        assert np.array_equal(_run(pipe, form).textures, expected.textures)
    free = _run(pipe, [None, None, None])
    for form in (None, {}, [{}], [[None] * 3]):
        assert np.array_equal(_run(pipe, form).textures, free.textures)
    assert not np.allclose(free.textures, expected.textures, atol=1e-4)


def test_tables_of_pandas_are_ratings_too(pipe):
    rows = [[1.0, -0.5, 0.25], [0.0, np.nan, 0.5]]
    expected = _run(pipe, rows).textures
    table = pd.DataFrame(rows, columns=["roughness", "bumpiness", "slipperiness"], index=["glass", "denim"])
    for form in (table, table[["slipperiness", "roughness", "bumpiness"]], pd.DataFrame(rows)):
        assert np.array_equal(_run(pipe, form).textures, expected)
    one = _run(pipe, [rows[0]]).textures
    assert np.array_equal(_run(pipe, table.loc["glass"]).textures, one)
    assert np.array_equal(_run(pipe, pd.Series(rows[0])).textures, one)
    with pytest.raises(ValueError, match="unknown axes .'hardness'"):
        _run(pipe, table.assign(hardness=1.0))
    with pytest.raises(ValueError, match="at least one texture"):
        _run(pipe, table.iloc[:0])


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_every_rating_changes_the_texture(pipe, axis):
    ratings = np.zeros((2, 3))
    ratings[1, axis] = 3.0
    out = _run(pipe, ratings, generator=[_generator(0), _generator(0)])
    assert rms(out.textures[0] - out.textures[1]) > 0.02 * rms(out.textures[0])
    assert out.level[0] != out.level[1] and out.friction_coefficient[0] != out.friction_coefficient[1]


# --- guidance


def _watch(model):
    """Records the batch size of every step."""
    calls = []
    _on_step(model, lambda args: calls.append(len(args[0])))
    return calls


@pytest.mark.parametrize("scale", [0.0, 1.0, 3.0])
def test_guidance_equals_its_formula(pipe, scale):
    # one step from pure noise: x0 = -v
    noise, ratings = torch.randn((1, 6, 32), generator=_generator(2)), torch.tensor([[1.0, 0.0, -1.0]])
    made = _run(pipe, ratings, latents=noise, num_inference_steps=1, guidance_scale=scale, output_type="latent")
    with torch.no_grad():
        free = pipe.dale(noise, 999.0, torch.full((1, 3), torch.nan)).sample
        steered = pipe.dale(noise, 999.0, ratings).sample
        expected = pipe.dale.unpack(-(free + scale * (steered - free)))
    torch.testing.assert_close(made.latents, expected[0], rtol=0, atol=1e-5)  # float32, numbers near 3
    torch.testing.assert_close(made.level, expected[1], rtol=0, atol=1e-5)
    torch.testing.assert_close(made.friction_coefficient, expected[2], rtol=1e-4, atol=0)


# --- steps and callbacks


def test_callbacks_see_every_step_of_both_stages(pipe):
    seen = []

    def look(pipeline, index, timestep, tensors):
        assert pipeline is pipe and set(tensors) == {"latents"}
        seen.append((index, float(timestep), tuple(tensors["latents"].shape)))
        return {}

    out = _run(pipe, num_inference_steps=2, num_latent_inference_steps=3, callback_on_step_end=look)
    assert [index for index, _, _ in seen] == [0, 1, 2, 3, 4] == list(range(pipe.num_timesteps))
    assert [round(t, 2) for _, t, _ in seen] == [999.0, 665.67, 332.33, 999.0, 499.0]
    assert [shape for _, _, shape in seen] == [(1, 6, 32)] * 3 + [(1, 1, 512)] * 2
    expected = _run(pipe, num_inference_steps=2, num_latent_inference_steps=3)
    assert np.array_equal(out.textures, expected.textures)


@pytest.mark.parametrize("wrong", ["x", np.zeros(3), torch.zeros(1, 2, 3)], ids=["text", "array", "shape"])
def test_a_callback_that_returns_something_else_is_told(pipe, wrong):
    with pytest.raises(ValueError, match="`callback_on_step_end` must return `latents` as a tensor"):
        _run(pipe, num_inference_steps=2, callback_on_step_end=lambda *_: {"latents": wrong})


@pytest.mark.parametrize(("last", "dale_steps", "lctg_steps"), [(1, 2, 0), (6, 5, 2)])
def test_a_callback_may_interrupt_either_stage(pipe, last, dale_steps, lctg_steps):
    dale, lctg, indices = _watch(pipe.dale), _watch(pipe.lctg), []

    def stop(pipeline, index, timestep, tensors):
        indices.append(index)
        pipeline._interrupt = index == last

    out = _run(pipe, num_inference_steps=5, callback_on_step_end=stop)
    assert pipe.interrupt and indices == list(range(last + 1)) and (len(dale), len(lctg)) == (dale_steps, lctg_steps)
    assert out.textures.shape == (1, SAMPLES) and np.isfinite(out.textures).all()
    _run(pipe)
    assert not pipe.interrupt  # the next call is whole


# --- durations


def test_a_shorter_texture_is_a_piece_of_a_segment(pipe):
    whole, piece = _run(pipe).textures[0], _run(pipe, duration_s=0.1).textures[0]
    # the same waveform, but for its own mean and RMS
    assert np.corrcoef(whole[:1000], piece)[0, 1] == pytest.approx(1.0, abs=1e-6)


# --- devices, dtypes, schedulers


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.float16])
def test_half_precision(pipe, dtype):
    expected = _run(pipe, duration_s=0.5).textures
    pipe = pipe.to(dtype)
    # the same noise: bfloat16 keeps 8 bits, which a few steps add up; of other noise it would be 1.4
    assert rms(_run(pipe, duration_s=0.5).textures - expected) < 0.2 * rms(expected)
    assert pipe.dale.dtype == pipe.lctg.dtype == dtype
    out = _run(pipe, duration_s=0.5, guidance_scale=2.0)
    assert out.textures.dtype == np.float32 and np.isfinite(out.textures).all()
    np.testing.assert_allclose(rms(out.textures), np.exp(out.level), rtol=1e-5)
    assert _run(pipe, output_type="latent").latents.dtype == dtype


@pytest.mark.parametrize("offload_type", ["block_level", "leaf_level"])
def test_group_offload(make_pipeline, pink_noise, tmp_path, offload_type):
    # offloading to the disk leaves nothing usable behind, even on a machine without an accelerator
    pipe, texture = make_pipeline(dale_config={"scalar_width": 16, "distilled_steps": 1}), pink_noise(4096, 10_000)

    def edited():
        options = {"ratings": {"roughness": 1.0}, "source_ratings": [0.0] * 3, "generator": _generator()}
        return TactileTextureEditPipeline.from_pipe(pipe)(texture, 10_000, **options).textures

    wanted = [_run(pipe, duration_s=0.5, guidance_scale=scale).textures for scale in (1.0, 1.5)] + [edited()]
    latents = pipe.encode(texture, 10_000).latents
    blocks = {"num_blocks_per_group": 1} if offload_type == "block_level" else {}
    for name in ("dale", "lctg"):
        getattr(pipe, name).enable_group_offload(
            onload_device=torch.device("cpu"),
            offload_device=torch.device("cpu"),
            offload_type=offload_type,
            offload_to_disk_path=str(tmp_path / name),
            **blocks,
        )
    assert torch.equal(pipe.encode(texture, 10_000).latents, latents)
    made = [_run(pipe, duration_s=0.5, guidance_scale=scale).textures for scale in (1.0, 1.5)] + [edited()]
    for ours, expected in zip(made, wanted, strict=True):
        _assert_same_textures(ours, expected)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs an accelerator")
@pytest.mark.parametrize("how", ["to", "enable_model_cpu_offload", "enable_sequential_cpu_offload"])
def test_accelerators_and_offload(pipe, how):
    expected = _run(pipe)
    pipe.to("cuda") if how == "to" else getattr(pipe, how)()
    made = _run(pipe)  # a CPU generator draws the same noise
    _assert_same_textures(made.textures, expected.textures, 1e-2)  # TF32 and another order of sums


# --- documentation


def test_the_example_of_the_docstring_runs():
    docstring = TactileTexturePipeline.__call__.__doc__
    assert docstring.count("Examples:") == 1 and "from_pretrained(bundled_checkpoint())" in docstring
    if not os.path.isfile(os.path.join(bundled_checkpoint(), "model_index.json")):
        pytest.skip("the bundled checkpoint is not there yet")
    example = docstring.split("```py")[1].split("```")[0]
    test = doctest.DocTestParser().get_doctest(example, {}, "example", None, 0)
    assert len(test.examples) >= 4
    assert doctest.DocTestRunner(verbose=False).run(test).failed == 0
