"""LoRA adapters on both models, through diffusers' `PeftAdapterMixin`."""

import pytest
import torch

peft = pytest.importorskip("peft")

TARGETS = {"dale": ["to_q", "to_k", "to_v", "to_out.0"], "lctg": ["time_proj", "conv1", "conv2"]}


@pytest.fixture(params=TARGETS)
def kind(request):
    return request.param


@pytest.fixture
def make_model(kind, make_lctg, make_dale):
    return {"lctg": make_lctg, "dale": make_dale}[kind]


def _lora(kind, **options):
    return peft.LoraConfig(r=2, target_modules=TARGETS[kind], **options)


def _velocity(model):
    generator = torch.Generator().manual_seed(0)
    shapes = ((2, 6, 32), (2, 3)) if model.config.get("rating_axes") else ((2, 1, 256), (2, 4, 16))
    sample, condition = (torch.randn(shape, generator=generator) for shape in shapes)
    return model(sample, 300, condition).sample


@torch.no_grad()
def test_an_adapter_is_saved_loaded_weighted_and_taken_off(make_model, kind, tmp_path):
    model, plain = make_model(), make_model()
    expected = _velocity(plain)
    torch.manual_seed(0)  # peft draws from the global state
    model.add_adapter(_lora(kind, init_lora_weights=False), adapter_name="rough")
    adapted = _velocity(model)
    assert (adapted - expected).norm() / expected.norm() > 0.01
    model.save_lora_adapter(tmp_path, adapter_name="rough")
    assert [path.name for path in tmp_path.iterdir()] == ["pytorch_lora_weights.safetensors"]

    plain.load_lora_adapter(tmp_path, prefix=None, adapter_name="again", use_safetensors=True)
    near = {"rtol": 0, "atol": 1e-5}  # float32, another place in memory
    torch.testing.assert_close(_velocity(plain), adapted, **near)
    assert plain.active_adapters() == ["again"]
    plain.set_adapters("again", 0.5)
    assert not torch.allclose(_velocity(plain), adapted, atol=1e-3)
    plain.disable_adapters()
    torch.testing.assert_close(_velocity(plain), expected, **near)
    plain.enable_adapters()
    plain.set_adapters("again", 1.0)
    plain.fuse_lora()
    plain.unload_lora()
    torch.testing.assert_close(_velocity(plain), adapted, rtol=0, atol=1e-4)  # one sum of weights instead of two layers


def test_the_adapter_alone_learns_also_with_gradient_checkpointing(make_model, kind):
    model = make_model().requires_grad_(False).train()
    model.add_adapter(_lora(kind))
    gradients = []
    for checkpointed in (False, True):
        if checkpointed:
            model.enable_gradient_checkpointing()
        model.zero_grad()
        _velocity(model).square().mean().backward()
        gradients.append({name: p.grad.clone() for name, p in model.named_parameters() if p.grad is not None})
    assert gradients[0] and all("lora" in name for name in gradients[0])
    assert any(gradient.any() for gradient in gradients[0].values())
    assert gradients[0].keys() == gradients[1].keys()
    for name, gradient in gradients[0].items():
        torch.testing.assert_close(gradients[1][name], gradient, rtol=1e-5, atol=1e-7)  # the order of sums


def test_a_pipeline_samples_with_adapters(pipe):
    def make():
        return pipe([1.0, None, 0.0], num_inference_steps=2, generator=torch.Generator().manual_seed(0)).textures[0]

    plain = make()
    torch.manual_seed(0)
    for kind in TARGETS:
        getattr(pipe, kind).add_adapter(_lora(kind, init_lora_weights=False), adapter_name="rough")
    assert abs(make() - plain).max() > 0.01 * abs(plain).max()
    for kind in TARGETS:
        getattr(pipe, kind).disable_adapters()
    torch.testing.assert_close(make(), plain, rtol=0, atol=1e-5 * float(abs(plain).max()))


def test_what_wears_an_adapter_is_not_saved_until_it_is_fused(pipe, tmp_path):
    pipe.dale.add_adapter(_lora("dale", init_lora_weights=False), adapter_name="rough")
    for thing in (pipe, pipe.dale):
        with pytest.raises(ValueError, match=r"wears the adapter\(s\) \['rough'\].*fuse_lora"):
            thing.save_pretrained(tmp_path / "saved")
    assert not list(tmp_path.iterdir())
    pipe.dale.fuse_lora()
    pipe.dale.unload_lora()
    pipe.save_pretrained(tmp_path / "saved")
    again = type(pipe).from_pretrained(tmp_path / "saved")
    torch.testing.assert_close(_velocity(again.dale), _velocity(pipe.dale), rtol=0, atol=1e-6)


def test_an_adapter_that_the_decoder_of_few_steps_does_not_wear_is_told(pipe, make_lctg, recorded_warnings):
    few = make_lctg(distilled_steps=1)
    pipe.register_modules(lctg_distilled=few)
    pipe.lctg.add_adapter(_lora("lctg"), adapter_name="rough")
    with recorded_warnings() as found:
        assert pipe.decoder_of(2) is pipe.lctg and not found
        assert pipe.decoder_of(1) is few and "the adapter does nothing" in found[0]
        pipe.decoder_of(1)
    assert len(found) == 1
