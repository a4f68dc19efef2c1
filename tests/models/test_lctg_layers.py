"""`LCTGModel` with a base layer, a detail layer and band levels."""

import math

import numpy as np
import pytest
import torch

from tactile_diffusers.features.low_band import sample_low_band, synthesize

#: features: 2 band levels, the 24 of `tests/conftest.py`, 2 samples of the waveform's low end;
#: latents: the levels, 2 learned channels of the base layer, the samples as the detail layer
LAYERED = {"feature_channels": 28, "latent_channels": 6, "detail_channels": 2, "level_bands": 1}


def _normal(*shape, seed=0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def _serial(detail):
    """(batch, 2, frames) -> (batch, 2 * frames): the samples of the low end in their order."""
    return detail.transpose(1, 2).flatten(1)


@pytest.fixture
def layered(make_lctg):
    return make_lctg(**LAYERED)


@pytest.mark.parametrize(
    "config",
    [
        {"detail_channels": 4},
        {"detail_channels": 24, "latent_channels": 30},
        {"detail_channels": -1},
        {"level_bands": 3},
        {"level_bands": 1, "detail_channels": 2},
        {"level_bands": 1, "latent_channels": 30, "detail_channels": 22},
        {"level_bands": 23, "latent_channels": 30},
        {"envelope_channels": 4},
    ],
)
def test_layers_that_leave_nothing_to_learn_are_refused(make_lctg, config):
    message = (
        r"\(-?\d+\), the \d+ levels of bands .* must leave some of the `latent_channels` \(\d+\) to learn, .* encode"
    )
    with pytest.raises(ValueError, match=message):
        make_lctg(**config)


def test_detail_channels_that_do_not_divide_a_frame_are_refused(make_lctg):
    with pytest.raises(ValueError, match=r"`detail_channels` \(3\) must divide half of `latent_hop` \(16\)"):
        make_lctg(latent_channels=8, detail_channels=3)


@torch.no_grad()
def test_the_encoder_hears_all_features_but_the_detail(layered):
    assert layered.base_channels == 4
    features = 5 * _normal(2, 28, 64)  # far beyond what a tanh could give
    latents = layered.encode(features)
    assert latents.shape == (2, 6, 32) and latents[:, 2:4].abs().max() < 1
    assert torch.equal(latents[:, 4:], features[:, 26:, ::2])  # passes through as it is
    for part in (slice(0, 2), slice(2, 18), slice(18, 26), slice(26, 28)):  # levels, energies, waveform, detail
        changed = features.clone()
        changed[:, part] = _normal(2, part.stop - part.start, 64, seed=2)
        difference = (layered.encode(changed) - latents)[:, 2:4].abs().mean((0, 2))
        assert (difference > 0.02).all() if part.stop < 28 else not difference.any()


@torch.no_grad()
@pytest.mark.parametrize("bands", [1, 3])
@pytest.mark.parametrize("feature_hop", [4, 8, 16], ids=["1 of 4", "1 of 2", "all"])
def test_band_levels_pass_through_as_they_are(make_lctg, bands, feature_hop):
    size, ratio = bands + 1, 16 // feature_hop
    changes = {"feature_channels": 26 + size, "latent_channels": size + 4, "level_bands": bands}
    model = make_lctg(**LAYERED | changes, feature_hop=feature_hop)
    assert (model.level_channels, model.base_channels) == (size, size + 2)
    features = 5 * _normal(2, 26 + size, 32 * ratio)  # far beyond what a tanh could give
    latents = model.encode(features)
    levels = model.band_levels(latents)
    assert levels.shape == (2, size, 32) and torch.equal(levels, latents[:, :size])
    assert torch.equal(levels, features[:, :size, ::ratio])
    assert torch.equal(latents[:, -2:], features[:, -2:, ::ratio])
    # the base layer alone holds them, so DALE can make them
    assert torch.equal(model.band_levels(model.pad_detail(latents[:, : model.base_channels])), levels)


@torch.no_grad()
@pytest.mark.parametrize("time", [-1, 0, 400, 999])
def test_an_untrained_decoder_leaves_what_is_given(layered, time):
    for parameter in layered.decoder.conv_out.parameters():
        parameter.zero_()  # as in new models
    sample, latents = _normal(2, 1, 512), 3 * _normal(2, 6, 32, seed=1)
    given, sine = synthesize(_serial(latents[:, 4:]), 8), math.sin(math.pi / 2 * (time + 1) / 1000)
    velocity = layered(sample, time, latents).sample
    torch.testing.assert_close(velocity, -sine * given, rtol=0, atol=1e-6)  # float32, up to 5
    # ...and zeros give nothing
    assert not layered(sample, time, layered.pad_detail(latents[:, :4])).sample.any()


@torch.no_grad()
def test_the_decoder_denoises_what_is_left(layered):
    """The whole velocity, put together by hand from what the decoder makes of the rest."""
    sample, latents, heard = _normal(2, 1, 512), _normal(2, 6, 32, seed=1), []
    layered.decoder.register_forward_hook(
        lambda module, args, kwargs, out: heard.append((args, kwargs, out)), with_kwargs=True
    )
    times = torch.tensor([100.0, 700.0])
    velocity = layered(sample, times, latents).sample
    [((states, _), options, made)] = heard
    given, angle = synthesize(_serial(latents[:, 4:]), 8), (math.pi / 2 * (times + 1) / 1000)[:, None, None]
    # float32
    torch.testing.assert_close(states, torch.cat([sample - angle.cos() * given, given], dim=1), rtol=0, atol=1e-5)
    torch.testing.assert_close(velocity, made - angle.sin() * given, rtol=0, atol=1e-5)
    assert torch.equal(options["context"], latents[:, :4])  # the base layer alone


@torch.no_grad()
def test_band_levels_and_detail_of_the_extractor_come_back(layered, make_extractor, pink_noise):
    extractor = make_extractor(level_bands=1, detail_samples=2)
    waveform, _ = extractor.normalize(pink_noise(2048, 10_000, count=2), 10_000)
    latents = layered.encode(torch.from_numpy(extractor.features(waveform)))
    assert torch.equal(layered.band_levels(latents), torch.from_numpy(extractor.band_levels(waveform)))
    np.testing.assert_array_equal(_serial(latents[:, 4:]).numpy(), sample_low_band(waveform, 8).astype(np.float32))


def test_modulation_gain_is_of_what_has_no_detail(make_lctg):
    latents = torch.randn(3, 6, 4, generator=torch.Generator().manual_seed(0))
    lctg = make_lctg(**LAYERED, modulation_gains=[1.2, 0.9])
    assert lctg.modulation_gain(latents) is None and make_lctg(**LAYERED).modulation_gain(torch.zeros(1, 6, 4)) is None
    latents[1, 4:] = 0
    np.testing.assert_allclose(lctg.modulation_gain(latents), [[1, 1], [1.2, 0.9], [1, 1]], rtol=1e-6)  # float32


@pytest.mark.parametrize("modulation_gain", [[1.0], [1.0, -0.1], [1.0, 1.0, 1.0]])
def test_modulation_gains_that_do_not_fit_are_refused(make_lctg, modulation_gain):
    with pytest.raises(ValueError, match="`modulation_gains` must hold 2 numbers"):
        make_lctg(**LAYERED, modulation_gains=modulation_gain)
