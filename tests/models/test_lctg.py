"""`LCTGModel`: its encoder, the injection of latents, and configs that cannot be built."""

import pytest
import torch
from torch import nn

from tactile_diffusers import LCTGModel
from tactile_diffusers.models.unet_1d import ChannelRMSNorm, UNet1D, from_patches, to_patches


def _normal(*shape, seed=0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def test_the_paper_s_depths_are_the_defaults():
    model = LCTGModel()
    convolutions = [module for module in model.encoder.modules() if isinstance(module, nn.Conv1d)]
    assert len(convolutions) == 10
    assert len(model.decoder.downsamplers) == len(model.decoder.upsamplers) == 7
    # latents reach every level, on both ways
    blocks = [*model.decoder.down_blocks, model.decoder.mid_block, *model.decoder.up_blocks]
    assert len(blocks) == 15 and all(block.context_proj is not None for block in blocks)


def test_encode(make_lctg):
    model = make_lctg()
    features = _normal(3, 24, 64)
    with torch.no_grad():
        latents = model.encode(features)
        assert latents.shape == (3, 4, 32)
        assert latents.abs().max() < 1 and latents.std() > 0.05
        torch.testing.assert_close(model.encode(features[1:2])[0], latents[1], rtol=0, atol=1e-5)
        assert not torch.allclose(model.encode(features + 0.5), latents, atol=1e-2)


@pytest.mark.parametrize("latent_hop", [8, 16, 32, 64, 128])
def test_every_stride_of_the_encoder(make_lctg, latent_hop):
    model = make_lctg(latent_hop=latent_hop, segment_samples=512)
    ratio = latent_hop // 8
    with torch.no_grad():
        latents = model.encode(_normal(1, 24, 5 * ratio))
        assert latents.shape == (1, 4, 5)
        assert model(_normal(1, 1, 5 * latent_hop), 100, latents).sample.shape == (1, 1, 5 * latent_hop)


@pytest.mark.parametrize("shape", [(1, 23, 64), (1, 24, 63), (24, 64), (1, 1, 24, 64)])
def test_features_that_do_not_fit_are_refused(make_lctg, shape):
    with pytest.raises(ValueError, match=r"`features` must be \(batch, 24, a multiple of 2 frames\)"):
        make_lctg().encode(torch.zeros(shape))


def test_latents_steer_the_output_where_they_lie(make_lctg):
    model = make_lctg()
    sample, latents = _normal(1, 1, 2048), _normal(1, 4, 128, seed=1).tanh()
    changed = latents.clone()
    changed[..., 64] += 1.0
    with torch.no_grad():
        difference = (model(sample, 500, changed).sample - model(sample, 500, latents).sample).abs()[0, 0]
    near = difference[64 * 16 - 64 : 65 * 16 + 64]
    assert near.max() > 0.05
    # convolutions of three levels reach about 300 samples: far away, nothing changes
    assert difference[:512].max() < 1e-5 and difference[-512:].max() < 1e-5


def test_latents_of_another_number_of_frames_are_refused(make_lctg):
    # silently cropped or padded with zeros, a mistake of the caller would only be felt
    model = make_lctg()
    for frames in (15, 17):
        with pytest.raises(ValueError, match="`latents`"):
            model(_normal(1, 1, 256), 500, _normal(1, 4, frames))


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"latent_hop": 12}, r"`latent_hop` \(12\) must be a multiple of `feature_hop` \(8\)"),
        ({"latent_hop": 24, "segment_samples": 480}, "must be 1, 2, 4, 8 or 16, got 3"),
        ({"latent_hop": 256}, "must be 1, 2, 4, 8 or 16, got 32"),
        ({"segment_samples": 500}, r"`segment_samples` \(500\) must be a multiple of `latent_hop` \(16\)"),
        ({"patch_size": 3}, r"Time steps per position of a level \(3, from `patch_size`=3 .* must divide each other"),
        ({"kernel_size": 4}, "`kernel_size` must be odd, got 4"),
        ({"widths": []}, "`widths` must hold at least one positive"),
        ({"widths": [8, 0]}, "`widths` must hold at least one positive"),
    ],
)
def test_configs_that_cannot_be_built_are_refused(make_lctg, config, message):
    with pytest.raises(ValueError, match=message):
        make_lctg(**config)


# --- parts of the backbone


def test_patches_are_inverse():
    x = _normal(2, 3, 24)
    patches = to_patches(x, 4)
    assert patches.shape == (2, 12, 6) and torch.equal(from_patches(patches, 4), x)
    assert torch.equal(patches[0, :4, 0], x[0, 0, :4])  # channel 0, the first four time steps


def test_norm_gives_unit_rms_over_channels_and_is_local_in_time():
    x = _normal(2, 16, 10) * 7
    normed = ChannelRMSNorm()(x)
    torch.testing.assert_close(normed.square().mean(1), torch.ones(2, 10), rtol=0, atol=1e-5)
    torch.testing.assert_close(ChannelRMSNorm()(x[..., 3:5]), normed[..., 3:5])
    assert not ChannelRMSNorm()(torch.zeros(1, 4, 4)).isnan().any()


def test_the_backbone_alone_has_no_context(randomized):
    net = randomized(UNet1D(2, 3, [8, 8], patch_size=1, embedding_dim=4, kernel_size=3))
    assert net(_normal(1, 2, 9), _normal(1, 4)).shape == (1, 3, 9)
