"""`LCTGModel` with a base layer, a detail layer and band levels."""

import pytest
import torch

from tactile_diffusers import LCTGModel, VDDIMScheduler, bundled_checkpoint

#: features: 2 band levels, then the 24 of `tests/conftest.py`, of which the last 8 are the waveform's;
#: latents: 2 band levels, 2 learned channels of the base layer, 2 of the detail layer
LAYERED = {"feature_channels": 26, "latent_channels": 6, "detail_channels": 2, "detail_features": 8, "level_bands": 1}


def _normal(*shape, seed=0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


@pytest.fixture
def layered(make_lctg):
    return make_lctg(**LAYERED)


@pytest.mark.parametrize(
    "config",
    [
        {"detail_channels": 4, "detail_features": 8},
        {"detail_channels": 2, "detail_features": 24},
        {"detail_channels": -1, "detail_features": 8},
        {"detail_channels": 2, "detail_features": -8},
        {"level_bands": 3},
        {"level_bands": 1, "detail_channels": 2, "detail_features": 8},
        {"level_bands": 1, "latent_channels": 6, "detail_channels": 2, "detail_features": 22},
        {"level_bands": 23, "latent_channels": 30},
    ],
)
def test_layers_that_leave_nothing_to_learn_are_refused(make_lctg, config):
    message = (
        r"\(-?\d+\) and the \d+ levels of bands must leave some of the `latent_channels` \(\d+\) to learn, .* hear"
    )
    with pytest.raises(ValueError, match=message):
        make_lctg(**config)


@pytest.mark.parametrize("config", [{"detail_channels": 2}, {"detail_features": 8}])
def test_half_a_detail_layer_is_refused(make_lctg, config):
    with pytest.raises(ValueError, match="must both be 0, or none of them"):
        make_lctg(**config)


def test_without_layers_nothing_is_new(make_lctg):
    model = make_lctg()
    assert model.base_channels == model.config.latent_channels == 4 and model.level_channels == 0
    assert {name.split(".")[0] for name in model.state_dict()} == {"encoder", "time_embedder", "decoder"}
    latents = _normal(2, 4, 8)
    assert model.band_levels(latents) is None and torch.equal(model.complete(latents), latents)


@torch.no_grad()
def test_the_base_layer_does_not_hear_the_waveform(layered):
    assert layered.base_channels == 4
    features = _normal(2, 26, 64)
    other = torch.cat([features[:, :18], _normal(2, 8, 64, seed=1)], dim=1)
    latents, changed = layered.encode(features), layered.encode(other)
    assert latents.shape == (2, 6, 32) and latents[:, 2:].abs().max() < 1
    assert torch.equal(changed[:, :4], latents[:, :4])
    assert (changed[:, 4:] - latents[:, 4:]).abs().mean() > 0.02
    # while all that is learned hears the energies, and the band levels
    energies = torch.cat([features[:, :2], _normal(2, 16, 64, seed=2), features[:, 18:]], dim=1)
    levels = torch.cat([_normal(2, 2, 64, seed=2), features[:, 2:]], dim=1)
    for other in (energies, levels):
        difference = (layered.encode(other) - latents).abs().mean((0, 2))
        assert (difference[2:] > 0.02).all()


@torch.no_grad()
def test_the_decoder_hears_levels_and_both_layers(layered):
    sample, latents = _normal(1, 1, 512), _normal(1, 6, 32, seed=1).tanh()
    made = layered(sample, 500, latents).sample
    for layer in (slice(0, 2), slice(2, 4), slice(4, 6)):
        changed = latents.clone()
        changed[:, layer] = 0
        assert (layered(sample, 500, changed).sample - made).abs().mean() > 0.01


def test_a_base_layer_is_completed_with_zeros(layered):
    base = _normal(2, 4, 5).half()
    latents = layered.complete(base)
    assert latents.shape == (2, 6, 5) and latents.dtype == torch.float16
    assert torch.equal(latents[:, :4], base) and not latents[:, 4:].any()


@torch.no_grad()
@pytest.mark.parametrize("bands", [1, 3])
@pytest.mark.parametrize("feature_hop", [4, 8, 16], ids=["1 of 4", "1 of 2", "all"])
def test_band_levels_pass_through_as_they_are(make_lctg, bands, feature_hop):
    size, ratio = bands + 1, 16 // feature_hop
    changes = {"feature_channels": 24 + size, "latent_channels": size + 4, "level_bands": bands}
    model = make_lctg(**LAYERED | changes, feature_hop=feature_hop)
    assert (model.level_channels, model.base_channels) == (size, size + 2)
    features = 5 * _normal(2, 24 + size, 32 * ratio)  # far beyond what a tanh could give
    latents = model.encode(features)
    levels = model.band_levels(latents)
    assert levels.shape == (2, size, 32) and torch.equal(levels, latents[:, :size])
    assert torch.equal(levels, features[:, :size, ::ratio])
    # the base layer alone holds them, so DALE can make them
    assert torch.equal(model.band_levels(model.complete(latents[:, : model.base_channels])), levels)


@torch.no_grad()
def test_band_levels_of_the_extractor_come_back(layered, make_extractor, pink_noise):
    extractor = make_extractor(level_bands=1, feature_size=26)
    waveform, _ = extractor.normalize(pink_noise(2048, 10_000, count=2), 10_000)
    latents = layered.encode(torch.from_numpy(extractor.features(waveform)))
    assert torch.equal(layered.band_levels(latents), torch.from_numpy(extractor.band_levels(waveform)))


@torch.no_grad()
@pytest.mark.parametrize("frames", [1, 2, 3, 31, 200])
def test_any_length(layered, frames):
    latents = layered.encode(_normal(1, 26, 2 * frames))
    assert latents.shape == (1, 6, frames) and layered.band_levels(latents).shape == (1, 2, frames)
    assert layered(_normal(1, 1, 16 * frames), 100, latents).sample.shape == (1, 1, 16 * frames)


@torch.no_grad()
@pytest.mark.parametrize(
    "config", [LAYERED, {"level_bands": 1}, {k: v for k, v in LAYERED.items() if k != "level_bands"}]
)
def test_saving_and_loading(make_lctg, tmp_path, config, recorded_warnings):
    model = make_lctg(**config)
    model.save_pretrained(tmp_path)
    with recorded_warnings() as found:
        again = LCTGModel.from_pretrained(tmp_path)
    assert found == [] and {name: again.config[name] for name in config} == config
    latents = model.encode(features := _normal(1, model.config.feature_channels, 16))
    assert torch.equal(again.encode(features), latents)
    levels = model.band_levels(latents)
    assert (levels is None) == ("level_bands" not in config)
    if levels is not None:
        assert torch.equal(again.band_levels(latents), levels)


def test_checkpoints_from_before_layers_load(pytestconfig, recorded_warnings):
    tiny = pytestconfig.rootpath / "tests" / "fixtures" / "tiny_pipeline"
    for folder in (tiny, bundled_checkpoint()):
        with recorded_warnings() as found:
            model = LCTGModel.from_pretrained(str(folder), subfolder="lctg")
        assert found == []
        # whichever checkpoint is bundled, `base_channels` is what its DALE makes
        assert model.base_channels == model.config.latent_channels - model.config.detail_channels
    old = LCTGModel.from_pretrained(str(tiny), subfolder="lctg")
    assert "detail_channels" not in LCTGModel.load_config(str(tiny), subfolder="lctg")
    assert (old.config.detail_channels, old.config.detail_features, old.config.level_bands) == (0, 0, 0)
    assert old.base_channels == 4 and old.detail_encoder is None and old.level_channels == 0


@pytest.mark.parametrize("checkpointed", [False, True])
def test_every_parameter_learns(make_lctg, checkpointed):
    model, scheduler = make_lctg(**LAYERED).train(), VDDIMScheduler()
    if checkpointed:
        model.enable_gradient_checkpointing()
    clean, noise, timesteps = _normal(2, 1, 512), _normal(2, 1, 512, seed=1), torch.tensor([200.0, 700.0])
    latents = model.encode(_normal(2, 26, 64))
    velocity = model(scheduler.add_noise(clean, noise, timesteps), timesteps, latents).sample
    (velocity - scheduler.get_velocity(clean, noise, timesteps)).square().mean().backward()
    idle = [
        name
        for name, p in model.named_parameters()
        if p.grad is None or not p.grad.isfinite().all() or not p.grad.any()
    ]
    assert idle == []
