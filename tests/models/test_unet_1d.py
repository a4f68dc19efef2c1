"""Layers of the backbone against PyTorch's own."""

import pytest
import torch

from tactile_diffusers.models.unet_1d import FEW_POSITIONS, Conv1d


@pytest.mark.parametrize("length", [1, 2, FEW_POSITIONS, FEW_POSITIONS + 1, 4 * FEW_POSITIONS, 5 * FEW_POSITIONS])
@pytest.mark.parametrize(("size", "stride", "padding"), [(3, 1, 1), (5, 1, 2), (1, 1, 0), (2, 2, 0), (4, 4, 0)])
def test_a_convolution_of_few_positions_is_a_convolution(length, size, stride, padding):
    """Outputs and gradients, on either side of the number of positions from which PyTorch's own is used."""
    torch.manual_seed(0)
    length *= stride
    ours = Conv1d(6, 4, size, stride=stride, padding=padding)
    theirs = torch.nn.Conv1d(6, 4, size, stride=stride, padding=padding)
    theirs.load_state_dict(ours.state_dict())
    inputs = [torch.randn(3, 6, length, generator=torch.Generator().manual_seed(1)).requires_grad_() for _ in "ab"]
    made = [layer(x) for layer, x in zip((ours, theirs), inputs, strict=True)]
    torch.testing.assert_close(made[0], made[1], rtol=1e-5, atol=1e-6)
    for result in made:
        result.square().sum().backward()
    torch.testing.assert_close(inputs[0].grad, inputs[1].grad, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(ours.weight.grad, theirs.weight.grad, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("detail_channels", [0, 2])
@pytest.mark.parametrize("samples", [16, 500, 512])
def test_conditions_stand_for_latents(make_lctg, detail_channels, samples):
    """A sampler prepares what latents add once; velocities are those of the latents themselves."""
    sizes = {"feature_channels": 26, "latent_channels": 6, "detail_channels": 2} if detail_channels else {}
    lctg = make_lctg(**sizes)
    latents = torch.randn(2, lctg.config.latent_channels, -(-samples // 16))
    sample = torch.randn(2, 1, samples)
    with torch.no_grad():
        conditions = lctg.condition(latents)
        for timestep in (0.0, 640.5):
            found = lctg(sample, timestep, conditions).sample
            torch.testing.assert_close(found, lctg(sample, timestep, latents).sample, rtol=1e-5, atol=1e-6)
    assert (conditions.given is None) == (detail_channels == 0)
    compiled = torch.compile(lctg, fullgraph=True, backend="eager")
    torch.testing.assert_close(compiled(sample, 0.0, conditions).sample, lctg(sample, 0.0, conditions).sample)
