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
        timesteps = torch.tensor([0.0, 640.5])
        conditions = lctg.condition(latents, timesteps)
        for timestep, prepared in zip(timesteps, conditions, strict=True):
            found = lctg(sample, None, prepared).sample
            torch.testing.assert_close(found, lctg(sample, timestep, latents).sample, rtol=1e-5, atol=1e-6)
        # what is not given is not made, and changes nothing
        latents = lctg.pad_detail(latents[:, : lctg.base_channels])
        (prepared,) = lctg.condition(latents, timesteps[:1])
        assert prepared.detail is None and (conditions[0].detail is None) == (detail_channels == 0)
        expected = lctg(sample, timesteps[0], latents).sample
        torch.testing.assert_close(lctg(sample, None, prepared).sample, expected, rtol=1e-5, atol=1e-6)
    compiled = torch.compile(lctg, fullgraph=True, backend="eager")
    torch.testing.assert_close(compiled(sample, None, conditions[1]).sample, found)
    assert len(compiled.condition(latents, timesteps)) == 2


@torch.no_grad()
def test_conditions_stand_for_ratings(make_dale):
    """Times and ratings are prepared once for all steps; velocities are those of the ratings."""
    dale = make_dale()
    ratings = torch.tensor([[1.0, torch.nan, -2.0], [0.0, 0.5, 1.0]])
    sample, timesteps = torch.randn(2, dale.config.in_channels, 16), torch.tensor([999.0, 333.3, -1.0])
    conditions = dale.condition(ratings, timesteps)
    assert len(conditions) == 3
    for timestep, prepared in zip(timesteps, conditions, strict=True):
        found, expected = dale(sample, None, prepared).sample, dale(sample, timestep, ratings).sample
        torch.testing.assert_close(found, expected, rtol=1e-5, atol=1e-6)  # float32, products in another order
    assert not torch.allclose(dale(sample, None, conditions[0]).sample, expected)
