"""Devices, hooks, adapters and inputs of the models that a caller can get wrong."""

import pytest
import torch
from accelerate import cpu_offload
from accelerate.hooks import ModelHook, add_hook_to_module

from tactile_diffusers import LCTGModel, bundled_checkpoint


def _normal(*shape, seed=0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


@pytest.fixture(params=["lctg", "dale"])
def case(request, make_lctg, make_dale):
    """A model with random weights, its inputs, its output."""
    if request.param == "lctg":
        model, inputs = make_lctg(), (_normal(2, 1, 256), 300, _normal(2, 4, 16, seed=1))
    else:
        model, inputs = make_dale(), (_normal(2, 6, 32), 300, _normal(2, 3, seed=1))
    with torch.no_grad():
        out = model(*inputs).sample
    assert out.std() > 0.1
    return model, inputs, out


def test_weights_that_come_only_for_the_call_change_nothing(case):
    model, inputs, expected = case
    cpu_offload(model, execution_device=torch.device("cpu"))
    assert all(parameter.is_meta for parameter in model.parameters())
    with torch.no_grad():
        torch.testing.assert_close(model(*inputs).sample, expected, rtol=0, atol=1e-6)
    assert all(parameter.is_meta for parameter in model.parameters())


def test_encode_calls_the_hook_of_an_offloaded_model(make_lctg):
    """Otherwise a model that is offloaded as a whole would stay away."""
    model, features, calls = make_lctg(), _normal(1, 24, 8), []
    with torch.no_grad():
        expected = model.encode(features)

    class Recorder(ModelHook):
        def pre_forward(self, module, *args, **kwargs):
            calls.append(module)
            return args, kwargs

    add_hook_to_module(model, Recorder())
    with torch.no_grad():
        made = model.encode(features)
    assert calls == [model] and torch.equal(made, expected)


def test_the_whole_time_axis_is_finite_and_told_apart(case):
    model, (sample, _, condition), _ = case
    with torch.no_grad():
        outs = [model(sample, t, condition).sample for t in (-1, -0.5, 0, 499.5, 998.9, 999)]
    assert all(out.isfinite().all() for out in outs)
    assert all(not torch.equal(a, b) for a, b in zip(outs, outs[1:], strict=False))


def test_pickles_are_not_written(make_lctg, tmp_path):
    """They could not be read again."""
    with pytest.raises(ValueError, match="`safe_serialization` must not be False. Such files are pickles"):
        make_lctg().save_pretrained(str(tmp_path / "a"), safe_serialization=False)
    assert not (tmp_path / "a").exists()
    make_lctg().save_pretrained(str(tmp_path / "b"), variant="fp16", safe_serialization=True)
    assert (tmp_path / "b" / "diffusion_pytorch_model.fp16.safetensors").is_file()


def test_of_a_pipelines_folder_the_subfolder_is_asked_for():
    with pytest.raises(FileNotFoundError, match="`subfolder` must be one of dale, lctg, lctg_distilled"):
        LCTGModel.from_pretrained(bundled_checkpoint())
