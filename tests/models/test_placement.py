"""Where layers lie and in what type: parts on several devices, narrow storage, compiled blocks, no stray types."""

import inspect

import pytest
import torch
from accelerate.hooks import AlignDevicesHook, add_hook_to_module
from torch.utils._python_dispatch import TorchDispatchMode

from tactile_diffusers import DALEModel, LCTGModel, RatingEstimator


def _normal(*shape, seed=0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


@pytest.fixture(params=["lctg", "lctg with detail", "dale", "dale with levels"])
def case(request, make_lctg, make_dale):
    """A model and its inputs, in the plain and in the layered form."""
    if request.param.startswith("lctg"):
        layers = (
            {"feature_channels": 26, "latent_channels": 6, "detail_channels": 2} if "detail" in request.param else {}
        )
        model = make_lctg(**layers)
        return model, (_normal(2, 1, 256), 300, _normal(2, model.config.latent_channels, 16, seed=1))
    statistics = {"latent_mean": [0.0] * 5, "latent_std": [1.0] * 5, "departure_std": [0.4, 0.2, 0.1]}
    levels = {"in_channels": 11, "level_channels": 3, "patch_size": 4, **statistics}
    model = make_dale(**(levels if "levels" in request.param else {}))
    return model, (_normal(2, model.config.in_channels, 32), 300, _normal(2, 3, seed=1))


def _parts(model, unbroken):
    """What `device_map="auto"` may put on devices of their own: leaves, and modules of the `unbroken` classes."""
    parts, waiting = [], list(model.children())
    while waiting:
        module = waiting.pop(0)
        if type(module).__name__ in unbroken or not list(module.children()):
            parts.append(module)
        else:
            assert not list(module.parameters(recurse=False)), "parameters beside layers would lie apart from them"
            waiting = [*module.children(), *waiting]
    return [part for part in parts if list(part.parameters())]


class _Fetchable(TorchDispatchMode):
    """Copies from the device "meta", which holds no numbers, give zeros instead of an error."""

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        kwargs = kwargs or {}
        if (
            function is torch.ops.aten._to_copy.default
            and args[0].is_meta
            and kwargs.get("device") != torch.device("meta")
        ):
            return torch.zeros(args[0].shape, dtype=kwargs.get("dtype") or args[0].dtype)
        return function(*args, **kwargs)


@torch.no_grad()
def test_parts_may_lie_on_two_devices(case):
    """Each part in turn lies elsewhere than all others: what it makes must be fetched before it is mixed.

    The second device is "meta", which refuses to be mixed with the CPU as an accelerator does.
    """
    model, inputs = case
    parts = _parts(model, model._no_split_modules)
    assert len(parts) >= 3
    for part in parts:
        add_hook_to_module(part, AlignDevicesHook(execution_device="cpu"))
    for part in parts:
        weights = {name: value.clone() for name, value in part.state_dict().items()}
        part._hf_hook.execution_device = "meta"
        part.to("meta")
        with _Fetchable():
            assert model(*inputs).sample.shape == inputs[0].shape
            if isinstance(model, LCTGModel):
                made = model.encode(_normal(1, model.config.feature_channels, 8))
                assert made.shape == (1, model.config.latent_channels, 4)
        part._hf_hook.execution_device = "cpu"
        part.to_empty(device="cpu").load_state_dict(weights)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["lctg", "dale"], indirect=True)
@torch.no_grad()
def test_repeated_blocks_compile_as_whole_graphs_and_change_nothing(case):
    model, inputs = case
    expected = model(*inputs).sample
    torch._dynamo.reset()
    model.compile_repeated_blocks(fullgraph=True, backend="eager")
    torch.testing.assert_close(model(*inputs).sample, expected, rtol=0, atol=1e-5)  # the order of sums
    torch._dynamo.reset()


class _NoFloat64(TorchDispatchMode):
    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        out = function(*args, **(kwargs or {}))
        made = out if isinstance(out, tuple | list) else (out,)
        assert not any(torch.is_tensor(x) and x.dtype == torch.float64 for x in made), f"{function} makes float64"
        return out


@torch.no_grad()
def test_no_operation_is_in_float64(case, recorded_warnings):
    """Not every accelerator has it. Nor is anything said: reading `model.x` for `model.config.x` would warn."""
    model, (sample, timestep, condition) = case
    times = torch.tensor([900.0, 300.0])
    with _NoFloat64(), recorded_warnings() as found:
        model(sample, timestep, condition)
        model(sample, None, model.condition(condition, times)[1])
        if isinstance(model, LCTGModel):
            model.encode(_normal(1, model.config.feature_channels, 8))
        else:
            model.unpack(model.pack(_normal(2, model.latent_channels, 8), torch.zeros(2), torch.ones(2)))
    assert not found


def test_no_tensor_is_left_behind_by_a_move(case):
    """A tensor that is neither parameter nor buffer follows neither devices nor types."""
    model, _ = case
    for module in model.modules():
        assert not [name for name, value in vars(module).items() if torch.is_tensor(value)]


@pytest.mark.parametrize("cls", [LCTGModel, DALEModel])
def test_a_new_model_is_in_train_mode_and_has_no_leaking_configuration(cls):
    model = cls()
    assert model.training
    arguments = set(inspect.signature(cls.__init__).parameters) - {"self"}
    assert {name for name in model.config if not name.startswith("_")} == arguments
    assert not model.is_gradient_checkpointing and cls._supports_group_offloading


def test_the_estimator_is_a_model_of_the_package_too(randomized, tmp_path, recorded_warnings):
    model = randomized(RatingEstimator(channel_groups=[4, 0, 2])).eval()
    numbers, known = _normal(2, 6, 8), torch.tensor([True, False])
    for how in ({}, {"variant": "fp16"}, {"max_shard_size": "20KB"}):
        folder = tmp_path / "-".join(how or ["plain"])
        model.save_pretrained(folder, **how)
        with recorded_warnings() as found:
            again = RatingEstimator.from_pretrained(folder, variant=how.get("variant"))
        assert not found and not again.training
        with torch.no_grad():
            torch.testing.assert_close(again(numbers, known), model(numbers, known), rtol=0, atol=1e-6)
    placed = RatingEstimator.from_pretrained(tmp_path / "plain", device_map="auto")
    assert placed._no_split_modules and next(placed.parameters()).isfinite().all()
    half = RatingEstimator.from_pretrained(tmp_path / "plain", dtype=torch.bfloat16)
    assert half(numbers.bfloat16()).dtype == torch.bfloat16
