"""`LCTGTrainingStep`: noise on the latents, dropped detail layers, polarity, weighted losses."""

import json
import math

import pytest
import torch

from tactile_diffusers import TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.training.steps import BatchNoise, LCTGTrainingStep

ROWS = 64
LAYERED = {"feature_channels": 28, "latent_channels": 6, "detail_channels": 2, "level_bands": 1}


def _random(seed=0):
    return BatchNoise(torch.Generator().manual_seed(seed), torch.device("cpu"))


def _normal(*shape, seed=0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


@pytest.fixture
def step(make_lctg, make_extractor):
    """`step(detail_dropout=0.0, config=LAYERED)`: the training step of a tiny model."""

    def make(config=LAYERED, **options):
        model = make_lctg(**config)
        extractor = make_extractor(
            level_bands=model.config.level_bands,
            detail_samples=model.config.detail_channels,
        )
        return LCTGTrainingStep(model, VDDIMScheduler(), extractor, **options)

    return make


@pytest.fixture
def batch():
    return {"waveform": _normal(ROWS, 512), "input_features": _normal(ROWS, 28, 64, seed=1)}


# --- latents


@torch.no_grad()
@pytest.mark.parametrize("dropout", [0.0, 0.3, 1.0])
def test_only_the_detail_layer_is_dropped_and_as_often_as_asked(step, dropout):
    module = step(config=LAYERED | {"latent_noise": 0.0}, detail_dropout=dropout)
    clean = module.model.encode(_normal(600, 28, 4))
    latents = module.noisy_latents(clean, _random())
    assert torch.equal(latents[:, :4], clean[:, :4])
    dropped = ~latents[:, 4:].flatten(1).any(1)
    assert torch.equal(latents[~dropped], clean[~dropped])  # a row has all of its detail layer or nothing
    # 600 rows: the standard error of a share of 0.3 is 0.02; at 0 and 1 there is none
    assert dropped.float().mean().item() == pytest.approx(dropout, abs=0.08 if 0 < dropout < 1 else 0)


@torch.no_grad()
def test_noise_is_added_to_both_layers_but_not_where_detail_is_missing(step):
    module = step(detail_dropout=0.0)
    clean = module.model.encode(_normal(200, 28, 64))
    noise = module.noisy_latents(clean, _random()) - clean
    # 200 x 32 values or more of each channel: its standard deviation is known to 1 %
    torch.testing.assert_close(noise.std((0, 2)), torch.full((6,), 0.1), rtol=0.05, atol=0)
    without = step(detail_dropout=1.0).noisy_latents(clean, _random())
    assert not without[:, 4:].any() and without[:, :4].any()


@torch.no_grad()
def test_textures_keep_their_polarity(step, batch, monkeypatch):
    module, targets = step(), []
    get_velocity = module.scheduler.get_velocity
    monkeypatch.setattr(module.scheduler, "get_velocity", lambda x, *a: targets.append(x) or get_velocity(x, *a))
    module(batch, _random())
    assert torch.equal(targets[0][:, 0], batch["waveform"])  # slip has a direction


# --- losses


@torch.no_grad()
def test_the_latent_penalty_is_on_learned_channels_only(step, batch, monkeypatch):
    plain, penalised, encoded = step(), step(latent_penalty=0.5), []
    encode = penalised.model.encode
    monkeypatch.setattr(penalised.model, "encode", lambda features: encoded.append(encode(features)) or encoded[0])
    loss, scalars = plain(batch, _random())
    more, with_power = penalised(batch, _random())
    power = encoded[0][:, penalised.model.passed_channels : penalised.model.base_channels].square().mean()
    assert set(scalars) == {"velocity"} and set(with_power) == {"velocity", "latent_power"}
    assert torch.equal(with_power["latent_power"], power)
    torch.testing.assert_close(more, loss + 0.5 * power, rtol=1e-5, atol=0)


@torch.no_grad()
def test_the_frequency_aware_loss_is_weighted_and_moves_no_random_number(step, batch):
    loss, scalars = step(spectral_loss_weight=0.7)(batch, _random())
    torch.testing.assert_close(loss, scalars["velocity"] + 0.7 * scalars["spectral"], rtol=1e-5, atol=0)
    plain, alone = step()(batch, _random())
    assert set(alone) == {"velocity"} and torch.equal(alone["velocity"], scalars["velocity"])
    torch.testing.assert_close(plain, alone["velocity"], rtol=1e-6, atol=0)


@torch.no_grad()
def test_the_velocity_loss_is_that_of_the_papers_equations(step, batch):
    module = step(config={"latent_noise": 0.0}, octave_exponent=0.0)
    asked = []
    batch["input_features"] = batch["input_features"][:, :24]
    module.model.register_forward_hook(lambda model, args, out: asked.append((*args, out[0])))
    loss, _ = module(batch, _random())
    noisy, timesteps, _, velocity = asked[-1]
    random = _random()
    clean = batch["waveform"][:, None]
    random.normal(ROWS, 4, 32)  # noise on the latents
    noise = random.normal(ROWS, 1, 512)
    phi = (math.pi / 2 * (timesteps + 1) / 1000)[:, None, None]
    torch.testing.assert_close(noisy, phi.cos() * clean + phi.sin() * noise, rtol=0, atol=1e-5)
    expected = (velocity - (phi.cos() * noise - phi.sin() * clean)).square().mean()
    torch.testing.assert_close(loss, expected, rtol=1e-5, atol=0)


# --- the script


def test_a_layered_model_is_trained_saved_and_continued(script, run_script, tiny_configs, tmp_path):
    config = json.loads(tiny_configs["lctg"].read_text())
    config["feature_extractor"] |= {"level_bands": 1, "detail_samples": 2}
    config["lctg"]["latent_channels"] = 6  # the script derives the rest of LCTG's geometry from the extractor
    (tmp_path / "layered.json").write_text(json.dumps(config))
    module, steps = script("train_lctg"), {"max_train_steps": 2, "checkpointing_steps": 1000}
    first = run_script(module, "lctg", tmp_path / "first", model_config_name_or_path=tmp_path / "layered.json", **steps)
    changes = {"model_config_name_or_path": None, "pretrained_model_name_or_path": first}
    second = run_script(module, "lctg", tmp_path / "second", **changes, **steps)
    pipe = TactileTexturePipeline.from_pretrained(str(second))
    assert {name: pipe.lctg.config[name] for name in LAYERED} == LAYERED
    assert pipe.feature_extractor.level_bands == 1 and pipe.feature_extractor.detail_samples == 2
