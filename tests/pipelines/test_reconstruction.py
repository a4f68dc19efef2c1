"""`encode`, `decode` and `reconstruct`, with DALE and without."""

import numpy as np
import pytest
import torch

from tactile_diffusers import TactileLatents, TactileTexturePipelineOutput
from tactile_diffusers.signal import level, resample, rms


def _generator(seed=0):
    return torch.Generator().manual_seed(seed)


@pytest.fixture
def decoder(make_pipeline):
    return make_pipeline(dale=False)


def test_encode(pipe, pink_noise):
    textures = pink_noise(2048, 10_000, count=3) * np.array([[1.0], [4.0], [0.2]])
    made = pipe.encode(textures, 10_000)
    assert isinstance(made, TactileLatents) and made.latents.shape == (3, 4, 32)
    held = resample(textures - textures.mean(-1, keepdims=True), 10_000, 2500)
    np.testing.assert_allclose(made.level.numpy(), level(held), rtol=1e-6)  # float32
    assert torch.isnan(made.friction_coefficient).all() and made.friction_coefficient.shape == (3,)
    assert made.latents.abs().max() <= 1 and not made.latents.requires_grad
    tensors = pipe.encode(torch.from_numpy(textures), 10_000)
    assert torch.equal(tensors.latents, made.latents) and torch.equal(tensors.level, made.level)
    alone = pipe.encode(textures[1], 10_000)
    torch.testing.assert_close(alone.latents[0], made.latents[1], rtol=0, atol=1e-5)  # batched sums, float32
    # gain is kept beside the shape
    louder = pipe.encode(textures * 2, 10_000)
    torch.testing.assert_close(louder.latents, made.latents, rtol=0, atol=1e-5)
    torch.testing.assert_close(louder.level - made.level, torch.full((3,), np.log(2.0)).float(), rtol=0, atol=1e-5)


def test_a_texture_in_millinewtons_is_warned_of_once(pipe, pink_noise, recorded_warnings):
    newtons = pink_noise(2048, 10_000, count=2, rms=np.exp(pipe.dale.config.level_mean))
    with recorded_warnings() as found:
        pipe.encode(newtons, 10_000)
        assert not found
        for _ in range(2):
            pipe.encode(newtons * 1000, 10_000)
    assert len(found) == 1 and "newtons, not mN" in found[0]


@pytest.mark.parametrize("output_type", ["np", "pt"])
def test_decode(decoder, output_type):
    latents = torch.rand((2, 4, 20), generator=_generator()) * 2 - 1
    wanted = torch.tensor([-5.0, -3.5])
    out = decoder.decode(latents, level=wanted, num_inference_steps=3, generator=_generator(), output_type=output_type)
    assert isinstance(out, TactileTexturePipelineOutput)
    assert isinstance(out.textures, np.ndarray if output_type == "np" else torch.Tensor)
    textures = np.asarray(out.textures)
    assert textures.shape == (2, 20 * 16 * 4) and textures.dtype == np.float32
    np.testing.assert_allclose(level(textures), wanted.numpy(), rtol=1e-6)  # float32
    assert np.isnan(np.asarray(out.friction_coefficient)).all() and np.isnan(out.reference_speed)
    given = decoder.decode(latents, wanted, torch.tensor([0.4, 0.9]), 3, _generator())
    np.testing.assert_array_equal(given.friction_coefficient, np.array([0.4, 0.9], dtype=np.float32))


@pytest.mark.parametrize("frames", [20, 70], ids=["one window", "fused windows"])
def test_decode_with_a_list_of_generators_equals_single_calls(decoder, frames):
    latents = torch.rand((3, 4, frames), generator=_generator()) * 2 - 1
    wanted = torch.tensor([-5.0, -4.0, -6.0])
    together = decoder.decode(latents, wanted, None, 4, [_generator(seed) for seed in range(3)])
    for row in range(3):
        alone = decoder.decode(latents[row : row + 1], wanted[row : row + 1], None, 4, _generator(row))
        error = np.abs(together.textures[row] - alone.textures[0]).max()
        assert error < 1e-4 * rms(alone.textures[0])  # batched sums in float32, over four steps


def test_reconstruct_is_encode_and_decode(decoder, pink_noise):
    texture = pink_noise(2048, 10_000)[0]
    out = decoder.reconstruct(texture, 10_000, num_inference_steps=3, generator=_generator())
    made = decoder.encode(texture, 10_000)
    again = decoder.decode(made.latents, made.level, num_inference_steps=3, generator=_generator())
    assert out.textures.shape == (1, 2048) and np.array_equal(out.textures, again.textures)
    assert isinstance(decoder.reconstruct(texture, 10_000, 2, _generator(), "pt").textures, torch.Tensor)


def test_without_dale_there_is_no_generation(decoder):
    with pytest.raises(ValueError, match="has no `dale`: it reconstructs"):
        decoder([0.0, 0.0, 0.0])
