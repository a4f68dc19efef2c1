"""What `LCTGModel` and `DALEModel` share: a diffusers model's whole contract. Tiny real classes, random weights.

Every test randomises the parameters first (`make_lctg`, `make_dale`): a new model answers zero, and zero equals zero.
"""

import copy
import pickle

import pytest
import torch
from diffusers.models.attention import AttentionModuleMixin

from tactile_diffusers import DALEModel, LCTGModel
from tactile_diffusers.models.attention import CrossAttnProcessor

KINDS = {"lctg": LCTGModel, "dale": DALEModel}


@pytest.fixture
def make_model(make_lctg, make_dale):
    return lambda kind, **changes: {"lctg": make_lctg, "dale": make_dale}[kind](**changes)


def _inputs(model, batch=2, length=None, seed=0):
    """A noisy sample, timesteps and the condition."""
    generator = torch.Generator().manual_seed(seed)

    def normal(*shape):
        return torch.randn(shape, generator=generator)

    timestep = torch.linspace(50.5, 900.0, batch)
    if isinstance(model, LCTGModel):
        length = length or 256
        frames = -(-length // model.config.latent_hop)
        return normal(batch, 1, length), timestep, model.pad_detail(normal(batch, model.base_channels, frames).tanh())
    ratings = normal(batch, 3)
    ratings[0, 1] = torch.nan
    return normal(batch, model.config.in_channels, length or 32), timestep, ratings


def _run(model, inputs):
    with torch.no_grad():
        return model(*inputs).sample


@pytest.fixture(params=KINDS)
def kind(request):
    return request.param


# --- construction and forward


def test_default_constructors_run(kind, randomized):
    model = randomized(KINDS[kind]()).eval()
    inputs = _inputs(model, batch=1, length=1024 if kind == "lctg" else 64)
    out = _run(model, inputs)
    assert out.shape == inputs[0].shape and out.isfinite().all() and out.std() > 0.01


def test_a_new_model_answers_zero(kind):
    # the training loss then begins at the variance of the velocity
    model = KINDS[kind]()
    assert not _run(model, _inputs(model, length=64)).any()


def test_dict_and_tuple_outputs_are_equal(make_model, kind):
    model = make_model(kind)
    inputs = _inputs(model)
    out = _run(model, inputs)
    with torch.no_grad():
        plain = model(*inputs, return_dict=False)
    assert isinstance(plain, tuple) and len(plain) == 1 and torch.equal(plain[0], out)
    assert out.shape == inputs[0].shape and out.std() > 0.1


def test_forms_of_the_timestep_are_equal(make_model, kind):
    model = make_model(kind)
    sample, _, condition = _inputs(model)
    expected = _run(model, (sample, torch.tensor([300.0, 300.0]), condition))
    numbers = (300, 300.0)
    tensors = (torch.tensor(300), torch.tensor(300.0), torch.tensor([300.0]), torch.tensor([300, 300]))
    for timestep in numbers + tensors:
        assert torch.equal(_run(model, (sample, timestep, condition)), expected)
    assert not torch.allclose(_run(model, (sample, 700, condition)), expected, atol=1e-2)


def test_rows_do_not_depend_on_the_rest_of_the_batch(make_model, kind):
    model = make_model(kind)
    inputs = _inputs(model, batch=4)
    together = _run(model, inputs)
    for row in range(4):
        alone = _run(model, tuple(part[row : row + 1] for part in inputs))
        # convolutions of another batch size may add in another order: float32, values near 1
        torch.testing.assert_close(alone[0], together[row], rtol=0, atol=1e-5)


@pytest.mark.parametrize("length", [1, 2, 3, 5, 15, 16, 17, 63, 100, 257])
def test_any_length_comes_back(make_model, kind, length):
    model = make_model(kind)
    inputs = _inputs(model, length=length)
    out = _run(model, inputs)
    assert out.shape == inputs[0].shape and out.isfinite().all() and out.std() > 0.01


def test_the_end_of_an_odd_length_is_padded_with_zeros(make_lctg):
    model = make_lctg()
    sample, timestep, latents = _inputs(model, length=250)  # 250 samples and 16 latent frames of 16 samples
    padded = torch.nn.functional.pad(sample, (0, 6))
    expected = _run(model, (padded, timestep, latents))[..., :250]
    torch.testing.assert_close(_run(model, (sample, timestep, latents)), expected, rtol=0, atol=1e-6)


# --- saving and loading


def _loaded(cls, folder, recorded_warnings, **kwargs):
    """Loads, and asserts that nothing was said: "newly initialized" weights are an error."""
    with recorded_warnings() as found:
        model, info = cls.from_pretrained(folder, output_loading_info=True, **kwargs)
    assert not found
    assert not any(info[name] for name in ("missing_keys", "unexpected_keys", "mismatched_keys", "error_msgs"))
    assert not model.training
    return model


def _assert_same_weights(model, other):
    state = other.state_dict()
    assert state.keys() == model.state_dict().keys()
    assert all(torch.equal(value, state[name]) for name, value in model.state_dict().items())


@pytest.mark.parametrize(
    "how",
    [{}, {"variant": "fp16"}, {"max_shard_size": "20KB"}, {"variant": "ema", "max_shard_size": "20KB"}],
    ids=["plain", "variant", "shards", "shards of a variant"],
)
def test_save_and_load(make_model, kind, tmp_path, how, recorded_warnings):
    model = make_model(kind, seed=5)
    model.save_pretrained(tmp_path, **how)
    files = sorted(path.name for path in tmp_path.glob("*.safetensors"))
    assert (len(files) > 1) == ("max_shard_size" in how)
    assert all(how.get("variant", "diffusion") in name for name in files)
    loaded = _loaded(KINDS[kind], tmp_path, recorded_warnings, variant=how.get("variant"))
    _assert_same_weights(model, loaded)
    inputs = _inputs(model)
    # memory alignment may change the order of sums (CONVENTIONS rule 11)
    torch.testing.assert_close(_run(loaded, inputs), _run(model, inputs), rtol=0, atol=1e-6)


@pytest.mark.parametrize("low_cpu_mem_usage", [True, False])
def test_save_half_and_load_wide(make_model, kind, tmp_path, recorded_warnings, low_cpu_mem_usage):
    # how the bundled checkpoint is stored: fp16 under the plain names
    model = make_model(kind).half()
    model.save_pretrained(tmp_path)
    loaded = _loaded(KINDS[kind], tmp_path, recorded_warnings, low_cpu_mem_usage=low_cpu_mem_usage)
    assert {parameter.dtype for parameter in loaded.parameters()} == {torch.float32}
    assert {buffer.dtype for buffer in loaded.buffers()} <= {torch.float32}
    _assert_same_weights(model.float(), loaded)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_half_precision_is_finite_and_near(make_model, kind, dtype):
    model = make_model(kind)
    sample, timestep, condition = _inputs(model)
    expected = _run(model, (sample, timestep, condition))
    out = _run(model.to(dtype), (sample.to(dtype), timestep, condition))
    assert out.dtype == dtype and out.isfinite().all()
    error = (out.float() - expected).norm() / expected.norm()
    assert error < 0.1  # bfloat16 has 8 bits: 0.4 % each through some ten layers


def test_models_pickle_and_copy(make_model, kind):
    model = make_model(kind)
    inputs = _inputs(model)
    expected = _run(model, inputs)
    for again in (pickle.loads(pickle.dumps(model)), copy.deepcopy(model)):
        assert type(again) is type(model)
        torch.testing.assert_close(_run(again, inputs), expected, rtol=0, atol=1e-6)


# --- training


def _gradients(model, inputs):
    model.zero_grad()
    model(*inputs).sample.square().mean().backward()
    return {name: p.grad.clone() for name, p in model.named_parameters() if p.grad is not None}


def test_gradient_checkpointing_gives_equal_gradients(make_model, kind):
    model = make_model(kind).train()
    inputs = _inputs(model)
    expected = _gradients(model, inputs)
    calls = []
    model.enable_gradient_checkpointing()
    inner = model._gradient_checkpointing_func
    model._gradient_checkpointing_func = lambda *args, **kwargs: calls.append(args[0]) or inner(*args, **kwargs)
    made = _gradients(model, inputs)
    assert model.is_gradient_checkpointing
    blocks = [m for m in model.modules() if type(m).__name__ == "ResnetBlock1D"]
    assert {id(block) for block in calls} == {id(block) for block in blocks}  # the flag is no silent no-op
    assert made.keys() == expected.keys()
    for name, gradient in made.items():
        # the same operations again: equal but for the order of sums
        torch.testing.assert_close(gradient, expected[name], rtol=1e-5, atol=1e-7)
    calls.clear()
    with torch.no_grad():
        model(*inputs)
    assert not calls


def test_every_parameter_learns(make_model, kind):
    model = make_model(kind).train()
    inputs = _inputs(model)
    loss = model(*inputs).sample.square().mean()
    if kind == "lctg":
        loss = loss + model.encode(torch.randn(2, 24, 16, generator=torch.Generator().manual_seed(0))).square().mean()
    loss.backward()
    idle = [n for n, p in model.named_parameters() if p.grad is None or not p.grad.isfinite().all() or not p.grad.any()]
    assert not idle


# --- what diffusers offers every model


def test_layerwise_casting(make_model, kind):
    model = make_model(kind)
    inputs = _inputs(model)
    expected = _run(model, inputs)
    model.enable_layerwise_casting(storage_dtype=torch.float8_e4m3fn, compute_dtype=torch.float32)
    dtypes = {name: parameter.dtype for name, parameter in model.named_parameters()}
    assert torch.float8_e4m3fn in dtypes.values()
    assert all(dtype == torch.float32 for name, dtype in dtypes.items() if "time" in name or "rating" in name)
    out = _run(model, inputs)
    # float8 has 3 bits of mantissa: 6 % a weight, 25 % allowed through all layers
    assert out.dtype == torch.float32 and (out - expected).norm() / expected.norm() < 0.25


def test_names_for_offloading_and_regional_compilation_exist(make_model, kind):
    model = make_model(kind)
    classes = {type(module).__name__ for module in model.modules()}
    assert model._no_split_modules and set(model._no_split_modules) <= classes
    assert model._repeated_blocks and set(model._repeated_blocks) <= classes


def test_attention_processors(make_dale):
    model = make_dale()
    inputs = _inputs(model)
    expected = _run(model, inputs)
    processors = model.attn_processors
    attentions = [module for module in model.modules() if isinstance(module, AttentionModuleMixin)]
    assert len(processors) == len(attentions) == 5  # two levels down, middle, two up
    assert all(isinstance(processor, CrossAttnProcessor) for processor in processors.values())
    calls = []

    class Counting(CrossAttnProcessor):
        def __call__(self, *args):
            calls.append(1)
            return super().__call__(*args)

    model.set_attn_processor(Counting())
    assert torch.equal(_run(model, inputs), expected) and len(calls) == 5
    model.set_attn_processor(dict.fromkeys(processors, CrossAttnProcessor()))
    assert torch.equal(_run(model, inputs), expected) and len(calls) == 5
    with pytest.raises(ValueError):
        model.set_attn_processor({"one.processor": CrossAttnProcessor()})


def test_attention_equals_its_formula(make_dale):
    model = make_dale(widths=[64, 64])
    attention = next(m for m in model.modules() if isinstance(m, AttentionModuleMixin))
    generator = torch.Generator().manual_seed(0)
    queries, tokens = (torch.randn(shape, generator=generator) for shape in ((2, 10, 64), (2, 3, 16)))
    with torch.no_grad():
        made = attention(queries, tokens)
        q, k, v = attention.to_q(queries), attention.to_k(tokens), attention.to_v(tokens)
        heads = []
        for head in range(2):
            part = slice(32 * head, 32 * head + 32)
            weights = torch.softmax(q[..., part] @ k[..., part].transpose(1, 2) / 32**0.5, dim=-1)
            heads.append(weights @ v[..., part])
        expected = attention.to_out[0](torch.cat(heads, dim=-1))
    torch.testing.assert_close(made, expected, rtol=0, atol=1e-5)  # float32, sums of 64


@pytest.mark.slow
def test_compiles_as_one_graph(make_model, kind):
    model = make_model(kind)
    sample, timestep, condition = _inputs(model)
    torch._dynamo.reset()
    compiled = torch.compile(model, fullgraph=True, backend="aot_eager")  # the capture is what can fail
    for time in (timestep, torch.tensor(300.0)):  # as in training, as in the pipeline
        eager = _run(model, (sample, time, condition))
        torch.testing.assert_close(_run(compiled, (sample, time, condition)), eager, rtol=0, atol=1e-5)
    torch._dynamo.reset()
