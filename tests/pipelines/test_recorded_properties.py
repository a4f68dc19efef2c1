"""Recordings of any length, rate, form and content: latents, textures and estimates of the documented form."""

import math
import warnings

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_diffusers.models import RatingEstimator
from tactile_diffusers.signal import level, rms

KINDS = ("noise", "silent", "constant", "saturated", "impulse", "slow", "alternating")


@pytest.fixture(scope="module")
def pipe(make_pipeline):
    made = make_pipeline()
    made.register_modules(rating_estimator=RatingEstimator(made.dale.channel_groups, width=8))
    return made


def _content(kind, samples, rate, seed):
    time = np.arange(samples) / rate
    if kind in ("noise", "saturated"):
        noise = np.random.default_rng(seed).standard_normal(samples)
        return noise if kind == "noise" else np.clip(5 * noise, -1, 1)
    return {
        "silent": np.zeros(samples),
        "constant": np.full(samples, 0.3),
        "impulse": np.eye(1, samples, samples // 2)[0],
        "slow": np.sin(2 * np.pi * 0.5 * time),
        "alternating": (-1.0) ** np.arange(samples),
    }[kind]


@st.composite
def recordings(draw, longest=6000):
    rate = draw(st.sampled_from([2500, 4000, 8000, 10_000, 10_007, 44_100, 48_000]))
    samples = draw(st.one_of(st.integers(1, 40), st.integers(1, longest)))
    kinds = draw(st.lists(st.sampled_from(KINDS), min_size=1, max_size=min(2, samples)))
    size = 10.0 ** draw(st.floats(-12, 4))
    batch = np.stack([size * _content(kind, samples, rate, seed) for seed, kind in enumerate(kinds)])
    form = draw(st.sampled_from(["float64", "float32", "torch", "bfloat16", "list", "row"]))
    if form == "row":
        return batch[0], rate
    if form == "list":
        return batch.tolist(), rate
    if form in ("torch", "bfloat16"):
        return torch.tensor(batch, dtype=torch.float64 if form == "torch" else torch.bfloat16), rate
    return batch.astype(form), rate


def _as_batch(texture):
    texture = texture.double().numpy() if isinstance(texture, torch.Tensor) else np.asarray(texture, np.float64)
    return texture[None] if texture.ndim == 1 else texture


@settings.get_profile("few")
@given(recording=recordings())
def test_encoding(pipe, recording):
    texture, rate = recording
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        made = pipe.encode(texture, rate)
    batch = _as_batch(texture)
    seconds = batch.shape[1] / rate
    assert made.latents.shape[:2] == (len(batch), 4) and torch.isfinite(made.latents).all()
    # zero-padded to whole frames of 16 samples at 2.5 kHz
    assert made.latents.shape[2] == math.ceil(math.ceil(seconds * 2500 - 1e-9) / 16)
    assert torch.isfinite(made.level).all() and torch.isnan(made.friction_coefficient).all()
    flat = np.ptp(batch, axis=1) <= 1e-12 * np.abs(batch).max(1)
    np.testing.assert_allclose(made.level[torch.from_numpy(flat)], level(np.zeros((1, 2)))[0], rtol=1e-6)
    # what the working rate holds is no more than the whole, but for the edges of the resampling filter; floor 1e-15
    assert (np.exp(made.level.numpy()) <= 1.5 * batch.std(axis=1) + 1.1e-15).all()


@settings.get_profile("few")
@given(recording=recordings(3000), seed=st.integers(0, 2**62), output_type=st.sampled_from(["np", "pt"]))
def test_reconstruction_keeps_length_and_level(pipe, recording, seed, output_type):
    texture, rate = recording
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        out = pipe.reconstruct(texture, rate, 1, torch.Generator().manual_seed(seed), output_type)
    made, batch = np.asarray(out.textures), _as_batch(texture)
    assert made.dtype == np.float32 and made.shape == (len(batch), max(1, round(batch.shape[1] * 10_000 / rate)))
    assert np.isfinite(made).all() and np.isnan(np.asarray(out.friction_coefficient)).all()
    wanted = np.exp(np.asarray(out.level, np.float64))
    heard = (wanted > 1e-10) & (made.shape[1] > 4)
    np.testing.assert_allclose(rms(made)[heard], wanted[heard], rtol=1e-4)
    assert (rms(made) <= wanted * 1.0001 + 1e-12).all()


@settings.get_profile("few")
@given(recording=recordings(3000), friction=st.sampled_from([None, 0.5, math.nan, np.float32(1), 1e-6]))
def test_estimated_ratings(pipe, recording, friction):
    texture, rate = recording
    made = pipe.estimate_ratings(texture, rate, friction)
    assert made.shape == (len(_as_batch(texture)), 3) and made.dtype == np.float32 and np.isfinite(made).all()


BAD_TEXTURES = [
    *(None, "x", 5.0, [], [[]], np.zeros((0, 5)), np.zeros((1, 2, 3)), [[1.0, 2.0], [3.0]], np.array(["a", "b"])),
    *([math.nan] * 9, [[0.0, math.inf]], np.zeros(9, complex), torch.zeros(9, dtype=torch.complex64), {"a": 1}),
    *(torch.full((2, 9), math.nan), np.full(9, 1e300), [10**400] * 9, [object()] * 4),
]
BAD_RATES = [None, 0, -1, math.nan, math.inf, 1999, 10_000.5, "10000", [10_000], 1e300, 10**400, 1j]


@pytest.mark.parametrize("call", ["encode", "reconstruct", "estimate_ratings"])
def test_bad_recordings_are_refused_by_name(pipe, calls_of, call):
    calls = calls_of(pipe.lctg)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for texture in BAD_TEXTURES:
            with pytest.raises((ValueError, TypeError), match="`texture`"):
                getattr(pipe, call)(texture, 10_000)
        for rate in BAD_RATES:
            with pytest.raises((ValueError, TypeError), match="`sampling_rate`"):
                getattr(pipe, call)(np.zeros(100), rate)
    assert not calls


BAD_DECODING = {
    "latents": [None, "x", 5, np.zeros((1, 4, 8)), torch.zeros(1, 3, 8), torch.zeros(4, 8), torch.zeros(0, 4, 8)]
    + [torch.zeros(1, 4, 0), torch.full((1, 4, 8), math.nan), torch.full((1, 4, 8), -math.inf)],
    "level": [None, "x", -5.0, np.zeros(1), torch.zeros(2), torch.zeros(()), torch.full((1,), math.nan)]
    + [torch.full((1,), math.inf)],
    "friction_coefficient": ["x", 0.5, np.zeros(1), torch.zeros(2), torch.zeros(())],
    "num_inference_steps": [0, -1, 1.5, True, "3", math.nan],
    "generator": [5, "x", [], [torch.Generator()] * 2],
    "output_type": ["latent", None, 3],
    "samples": [0, -1, 1.5, True, "3"],
    "noise": [5, "x", np.zeros((1, 1, 128)), torch.zeros(1, 128), torch.full((1, 1, 128), math.nan)],
}


@pytest.mark.parametrize("name", BAD_DECODING)
def test_bad_arguments_of_decode_are_refused_by_name(pipe, calls_of, name):
    calls = calls_of(pipe.lctg)
    for value in BAD_DECODING[name]:
        with pytest.raises((ValueError, TypeError), match=f"`{name}`"):
            pipe.decode(**{"latents": torch.zeros(1, 4, 8), "level": torch.full((1,), -5.0), name: value})
    assert not calls


@pytest.mark.parametrize("friction", ["x", [0.5] * 3, [[0.5]], {}, [None]])
def test_bad_friction_coefficients_are_refused_by_name(pipe, friction):
    with pytest.raises(ValueError, match="`friction_coefficient`"):
        pipe.estimate_ratings(np.zeros((2, 600)), 10_000, friction)


@settings.get_profile("few")
@given(
    frames=st.integers(1, 70),
    levels=st.lists(st.floats(-40, 5), min_size=1, max_size=3),
    size=st.sampled_from([0.0, 1e-6, 1.0, 1e3]),
    samples=st.one_of(st.none(), st.integers(1, 9000)),
    dtype=st.sampled_from([torch.float32, torch.float64, torch.float16]),
)
def test_decoding(pipe, frames, levels, size, samples, dtype):
    generator = torch.Generator().manual_seed(frames)
    latents = (size * torch.randn(len(levels), 4, frames, generator=generator)).to(dtype)
    out = pipe.decode(latents, torch.tensor(levels), None, 1, generator, samples=samples)
    whole = frames * 16 * 4  # 10 kHz from 2.5
    assert out.textures.shape == (len(levels), whole if samples is None else min(samples, whole))
    assert np.isfinite(out.textures).all() and out.textures.dtype == np.float32
    if out.textures.shape[1] > 4:
        wanted = np.exp(levels)
        np.testing.assert_allclose(rms(out.textures), np.where(wanted > 1e-12, wanted, 0), rtol=1e-3, atol=1e-12)
