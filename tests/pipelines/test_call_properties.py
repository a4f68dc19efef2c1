"""A call with any arguments: refused by name before any network runs, or a finite result of the documented form."""

import copy
import math
import warnings
from contextlib import contextmanager

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_diffusers.signal import power_spectral_density, rms

AXES = ("roughness", "bumpiness", "slipperiness")
NAN, INF, HUGE = math.nan, math.inf, 10**400
rating = st.one_of(
    st.none(), st.just(NAN), st.floats(-3, 3), st.integers(-2, 2), st.floats(-2, 2, width=16).map(np.float16)
)
row = st.lists(rating, min_size=3, max_size=3)
mapping = st.dictionaries(st.sampled_from(AXES), rating)
numbers = st.lists(st.lists(st.floats(-2, 2, width=16), min_size=3, max_size=3), min_size=1, max_size=3)
good_ratings = st.one_of(
    st.none(),
    row,
    row.map(tuple),
    mapping,
    st.lists(st.one_of(row, mapping), min_size=1, max_size=3),
    numbers.map(np.array),
    numbers.map(lambda rows: np.array(rows, np.float16)),
    numbers.map(lambda rows: np.array(rows[0], object)),
    numbers.map(torch.tensor),
    numbers.map(lambda rows: torch.tensor(rows, dtype=torch.bfloat16)),
    numbers.map(lambda rows: torch.tensor(rows[0]).requires_grad_()),
    st.just(np.array([[1, 0, -1]], np.int8)),
)
BAD = {
    "ratings": [
        *("rough", b"rough", 5, {1, 2, 3}, object(), [], (), [[]], [[], []], [1, 2], [1, 2, 3, 4], [[1, 2, 3], [1]]),
        *([[1, 2, 3], 5], [[[1, 2, 3]]], {"loud": 1}, {1: 2, "loud": 3}, [{"loud": 1}], {"roughness": [1]}, [[], {}]),
        *([INF, 0, 0], [[0, -INF, NAN]], [7, 0, 0], [HUGE, 0, 0], {"bumpiness": HUGE}, [1j, 0, 0], ["a", "b", "c"]),
        *(np.zeros((0, 3)), np.zeros((2, 2)), np.zeros((1, 1, 3)), np.zeros(()), np.array("x"), np.zeros(3, complex)),
        *(np.array(["a", "b", "c"]), np.full(3, INF), torch.zeros(0, 3), torch.zeros(2, 4), torch.zeros(3) + 1j),
        *(torch.tensor(1.0), torch.full((3,), 1e30, dtype=torch.bfloat16)),
    ],
    "num_inference_steps": [0, -1, 1.5, True, "3", NAN, INF, [2], torch.tensor(2.5), 10**12],
    "num_latent_inference_steps": [0, -7, 2.0, False, "3", NAN, {}],
    "num_textures_per_rating": [0, -2, 1.5, None, True, "2", NAN, [1]],
    "guidance_scale": [
        *(-1, -1e-9, NAN, INF, -INF, None, "x", [1.0], True, HUGE, 1j, np.complex64(1), torch.zeros(2)),
        *({"loud": 1.0}, {1: 2.0, "loud": 2.0}, {"roughness": NAN}, {"bumpiness": None}, {"slipperiness": -2}),
    ],
    "guidance_rescale": [-0.1, 1.1, NAN, None, "x", True, HUGE],
    "duration_s": [0, -1, NAN, INF, -INF, "1", True, 3601, 1e9, 1e300, HUGE, [1.0], 1j],
    "generator": [5, "x", [], [None], [None] * 99, {}, np.random.default_rng(0), 0.0, ["x"], [torch.Generator()] * 99],
    "latents": [
        *(torch.zeros(1, 6, 31), torch.zeros(6, 32), torch.zeros(0), torch.zeros(()), torch.zeros(99, 6, 32), "x", 5),
        *(np.zeros((1, 6, 32)), [[0.0]], torch.full((1, 6, 32), NAN), torch.full((1, 6, 32), INF)),
        torch.zeros(1, 6, 32, dtype=torch.complex64),
    ],
    "output_type": ["pil", None, 1, [], "NP"],
    "rating_scale": ["Z", None, 1, [], "raw", "percentile"],  # the tiny checkpoint lacks the statistics of the last two
    "callback_on_step_end": ["x", 5, [], [print]],
    "callback_on_step_end_tensor_inputs": [None, 5, "latents", ["noise"], [[]], ["latents", 1], {"latents"}],
}
good = {
    "num_inference_steps": st.one_of(st.none(), st.integers(1, 3), st.just(np.int64(2))),
    "num_latent_inference_steps": st.one_of(st.none(), st.integers(1, 3)),
    "num_textures_per_rating": st.integers(1, 2),
    "guidance_scale": st.one_of(
        st.sampled_from([1, 1.0, 0, np.float32(1.5)]),
        st.floats(0, 20),
        st.dictionaries(st.sampled_from(AXES), st.floats(0, 5)),
    ),
    "guidance_rescale": st.sampled_from([0, 0.0, 0.5, 1]),
    "duration_s": st.one_of(st.none(), st.sampled_from([1e-300, 1e-9, 1e-4, 0.05]), st.floats(1e-3, 0.3)),
    "output_type": st.sampled_from(["np", "pt", "latent"]),
    "return_dict": st.booleans(),
    "callback_on_step_end": st.sampled_from([None, lambda *args: None, lambda pipe, i, t, kwargs: kwargs]),
    "callback_on_step_end_tensor_inputs": st.sampled_from([[], ["latents"], ("latents",)]),
}
#: Some of the arguments, so that the number of combinations stays small.
arguments = st.fixed_dictionaries({"ratings": good_ratings}, optional=good)


@pytest.fixture(scope="module")
def pipe(make_pipeline):
    """One for the module: calls leave it as it was, which is tested."""
    return make_pipeline()


def _state(pipe):
    models = [copy.deepcopy(model.state_dict()) for model in (pipe.lctg, pipe.dale)]
    parts = (pipe.lctg, pipe.dale, pipe.scheduler, pipe.dale_scheduler)
    return models, [dict(part.config) for part in parts], pipe.feature_extractor.to_dict()


def _assert_same_state(before, after):
    for old, new in zip(before[0], after[0], strict=True):
        assert old.keys() == new.keys() and all(torch.equal(value, new[name]) for name, value in old.items())
    assert before[1:] == after[1:]


@contextmanager
def untouched(pipe):
    """Nothing of the pipeline's components, nor of the global random state, may change inside."""
    before, torch_state, numpy_state = _state(pipe), torch.get_rng_state(), np.random.get_state()
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)  # 0 / 0 and overflow
        yield
    _assert_same_state(before, _state(pipe))
    assert torch.equal(torch.get_rng_state(), torch_state)
    assert all(np.array_equal(a, b) for a, b in zip(np.random.get_state(), numpy_state, strict=True))


def _seeded(seed):
    if isinstance(seed, list):
        return [_seeded(one) for one in seed]
    return torch.Generator("cpu").manual_seed(seed)


def _rows(ratings):
    """How many textures ratings ask for, written again."""
    if ratings is None or isinstance(ratings, dict):
        return 1
    if isinstance(ratings, np.ndarray | torch.Tensor):
        return len(ratings) if ratings.ndim == 2 else 1
    return len(ratings) if any(isinstance(row, dict | list | tuple) for row in ratings) else 1


def _check(pipe, out, call):
    count = _rows(call["ratings"]) * call.get("num_textures_per_rating", 1)
    fields = list(out.values()) if call.get("return_dict", True) else list(out)
    duration, rate = call.get("duration_s"), 10_000
    if call.get("output_type") == "latent":
        latents, level, friction = fields
        frames = latents.shape[-1]
        assert latents.shape[:2] == (count, 4) and frames >= 32 and frames * 16 / 2500 >= (duration or 0) - 1e-6
        assert level.shape == friction.shape == (count,)
        assert all(torch.isfinite(field).all() for field in fields)
        return
    textures, friction, level, sampling_rate, speed = fields
    kind = torch.Tensor if call.get("output_type") == "pt" else np.ndarray
    assert all(isinstance(field, kind) and str(field.dtype).endswith("float32") for field in fields[:3])
    textures, friction, level = (np.asarray(field) for field in (textures, friction, level))
    samples = 2048 if duration is None else max(1, round(duration * rate))
    assert textures.shape == (count, samples) and friction.shape == level.shape == (count,)
    assert all(np.isfinite(field).all() for field in (textures, friction, level)) and sampling_rate == rate
    scale = np.exp(level.astype(np.float64))
    # zero mean, and the RMS that is said; a texture of one sample has none
    assert (np.abs(textures.astype(np.float64).mean(-1)) <= 1e-6 * scale).all()
    np.testing.assert_allclose(rms(textures), scale if samples > 1 else 0, rtol=1e-5, atol=1e-9)
    if samples >= 1000:
        # nothing above what the decoder's 2.5 kHz hold
        frequencies, density = power_spectral_density(textures, rate, window_seconds=0.1)
        above = density[:, frequencies > 1400].sum(-1)
        assert (above <= 1e-4 * density.sum(-1)).all()


@settings.get_profile("few")
@given(call=arguments, seed=st.integers(0, 2**63 - 1))
def test_good_arguments_give_what_is_documented(pipe, call, seed):
    with untouched(pipe):
        out = pipe(**call, generator=_seeded(seed))
    _check(pipe, out, call)


@settings.get_profile("few")
@given(call=arguments, data=st.data(), names=st.sets(st.sampled_from(sorted(BAD)), min_size=1, max_size=2))
def test_bad_arguments_are_refused_by_name_before_any_network_runs(pipe, calls_of, call, data, names):
    calls = [calls_of(pipe.dale), calls_of(pipe.lctg)]
    call = call | {name: data.draw(st.sampled_from(BAD[name]), label=name) for name in sorted(names)}
    with untouched(pipe), pytest.raises((ValueError, TypeError)) as caught:
        pipe(**call)
    assert any(f"`{name}" in str(caught.value) for name in names), caught.value
    assert not any(calls)


@pytest.mark.parametrize("name", BAD)
def test_every_bad_value_is_refused_by_itself(pipe, name):
    for value in BAD[name]:
        with pytest.raises((ValueError, TypeError), match=f"`{name}"):
            pipe(**{"ratings": [1, 0, 0], name: value})


@settings.get_profile("few")
@given(call=arguments, seed=st.integers(0, 2**63 - 1), ones_own=st.booleans())
def test_the_same_seed_gives_the_same_result(pipe, call, seed, ones_own):
    if ones_own:  # initial noise given: the generator draws the decoder's alone
        count = _rows(call["ratings"]) * call.get("num_textures_per_rating", 1)
        frames = pipe._sizes(call.get("duration_s"))[0]
        call = call | {"latents": torch.randn(count, 6, frames, generator=_seeded(seed + 1 if seed else 5)).double()}
    results = [pipe(**(call | {"return_dict": False}), generator=_seeded(seed)) for _ in range(2)]
    for first, second in zip(*results, strict=True):
        np.testing.assert_array_equal(np.asarray(first), np.asarray(second))


@settings.get_profile("few")
@given(
    rows=st.lists(row, min_size=1, max_size=2),
    takes=st.integers(1, 2),
    call=st.fixed_dictionaries(
        {"num_inference_steps": st.integers(1, 2)},
        optional={name: good[name] for name in ("duration_s", "guidance_scale")},
    ),
    first=st.integers(0, 2**62),
)
def test_a_batch_with_a_list_of_generators_equals_single_calls(pipe, rows, takes, call, first):
    seeds = [first + number for number in range(len(rows) * takes)]
    together = pipe(rows, num_textures_per_rating=takes, generator=_seeded(seeds), **call)
    for number, seed in enumerate(seeds):
        alone = pipe(rows[number // takes], generator=_seeded(seed), **call)
        scale = float(np.exp(alone.level[0]))
        # sums over a batch are rounded otherwise; guidance far beyond 1 multiplies that
        np.testing.assert_allclose(together.level[number], alone.level[0], rtol=1e-3, atol=1e-3)
        error = rms(together.textures[number] / np.exp(together.level[number]) - alone.textures[0] / scale)
        assert error < 0.02, error


@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning")
def test_what_overflows_is_an_error_and_no_texture(pipe):
    with pytest.raises(FloatingPointError, match="`latents` far from unit variance"):
        pipe([1, 0, 0], 1, latents=torch.full((1, 6, 32), 1e30))
