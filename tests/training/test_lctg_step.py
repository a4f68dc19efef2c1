"""`LCTGTrainingStep`: dropped detail layers, polarity, weighted losses; and the arguments that ask for them."""

import json
import math

import numpy as np
import pytest
import torch

from tactile_diffusers import TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.training.losses import detection_sensitivity, multi_resolution_spectral_loss

ROWS = 64
LAYERED = {"feature_channels": 28, "latent_channels": 6, "detail_channels": 2, "level_bands": 1}
ARGUMENTS = ["--train_data_dir", "none", "--output_dir", "none"]


def _generator(seed=0):
    return torch.Generator().manual_seed(seed)


def _normal(*shape, seed=0):
    return torch.randn(shape, generator=_generator(seed))


@pytest.fixture
def lctg_script(script):
    """A fresh module of the script, free to be patched."""
    return script("train_lctg")


@pytest.fixture
def step(lctg_script, make_lctg, make_extractor):
    """`step("--detail_dropout", "0", config=LAYERED)`: the training step of a tiny model, as the script parses it."""

    def make(*words, config=LAYERED):
        model = make_lctg(**config)
        extractor = make_extractor(
            level_bands=model.config.level_bands,
            feature_size=model.config.feature_channels,
            detail_samples=model.config.detail_channels,
        )
        args = lctg_script.parse_args([*ARGUMENTS, *words])
        return lctg_script.LCTGTrainingStep(model, VDDIMScheduler(), extractor, args)

    return make


@pytest.fixture
def batch():
    return {"waveform": _normal(ROWS, 512), "input_features": _normal(ROWS, 28, 64, seed=1)}


# --- layers


@torch.no_grad()
@pytest.mark.parametrize("dropout", [0.0, 0.3, 1.0])
def test_the_detail_layer_alone_is_dropped_as_often_as_asked(step, dropout):
    module = step("--detail_dropout", str(dropout), config=LAYERED | {"latent_noise": 0.0})
    features = _normal(600, 28, 4)
    clean = module.model.encode(features)
    latents = module.noisy_latents(clean, _generator())
    assert torch.equal(latents[:, :4], clean[:, :4])
    dropped = ~latents[:, 4:].flatten(1).any(1)
    assert torch.equal(latents[~dropped], clean[~dropped])  # a row has all of its detail layer or nothing
    # 600 rows: the standard error of a share of 0.3 is 0.02; at 0 and 1 there is none
    assert dropped.float().mean().item() == pytest.approx(dropout, abs=0.08 if 0 < dropout < 1 else 0)


@torch.no_grad()
def test_noise_is_on_both_layers_but_not_where_detail_is_missing(step):
    module, features = step("--detail_dropout", "0"), _normal(200, 28, 64)
    clean = module.model.encode(features)
    noise = module.noisy_latents(clean, _generator()) - clean
    # 200 x 32 values or more of each channel: its standard deviation is known to 1 %
    torch.testing.assert_close(noise.std((0, 2)), torch.full((6,), 0.1), rtol=0.05, atol=0)
    without = step("--detail_dropout", "1").noisy_latents(clean, _generator())
    assert not without[:, 4:].any() and without[:, :4].any()


@torch.no_grad()
def test_without_a_detail_layer_nothing_is_dropped(step):
    module = step("--detail_dropout", "1", config={"latent_noise": 0.0})
    features = _normal(3, 24, 64)
    latents = module.model.encode(features)
    assert torch.equal(module.noisy_latents(latents, _generator()), latents)


@torch.no_grad()
@pytest.mark.parametrize("config", [LAYERED, {}], ids=["layered", "plain"])
def test_the_drawn_polarity_changes_the_waveform_and_its_features_alone(step, batch, config, monkeypatch):
    module, heard, targets = step(config=config), [], []
    size = module.model.config.feature_channels
    batch["input_features"] = batch["input_features"][:, :size]
    encode, get_velocity = module.model.encode, module.scheduler.get_velocity
    monkeypatch.setattr(module.model, "encode", lambda f: heard.append(f) or encode(f))
    monkeypatch.setattr(module.scheduler, "get_velocity", lambda x, *a: targets.append(x) or get_velocity(x, *a))
    module(batch, _generator())
    signs = targets[0][:, 0, 0] / batch["waveform"][:, 0]
    assert set(signs.tolist()) == {-1.0, 1.0}
    assert torch.equal(targets[0][:, 0], batch["waveform"] * signs[:, None])
    even = size - 8 - module.model.config.detail_channels
    assert torch.equal(heard[0][:, :even], batch["input_features"][:, :even])  # band levels and energies
    assert torch.equal(heard[0][:, even:], batch["input_features"][:, even:] * signs[:, None, None])


def test_every_parameter_learns(step, batch):
    module = step("--detail_dropout", "0.5", "--spectral_loss_weight", "0.1")
    module.model.train()
    loss, scalars = module(batch, _generator())
    assert set(scalars) == {"velocity", "spectral"}
    loss.backward()
    idle = [name for name, p in module.named_parameters() if p.grad is None or not p.grad.isfinite().all()]
    idle += [name for name, p in module.named_parameters() if name not in idle and not p.grad.any()]
    assert idle == []


# --- losses


@torch.no_grad()
def test_the_power_of_what_is_learned_costs(step, batch, monkeypatch):
    plain, penalised, made = step(), step("--latent_penalty", "0.5"), []
    encode = penalised.model.encode
    monkeypatch.setattr(penalised.model, "encode", lambda features: made.append(encode(features)) or made[0])
    loss, scalars = plain(batch, _generator())
    more, with_power = penalised(batch, _generator())
    # levels and detail are what they are: they cost nothing
    power = made[0][:, penalised.model.level_channels : penalised.model.base_channels].square().mean()
    assert set(scalars) == {"velocity"} and set(with_power) == {"velocity", "latent_power"}
    assert torch.equal(with_power["latent_power"], power)
    torch.testing.assert_close(more, loss + 0.5 * with_power["latent_power"], rtol=1e-5, atol=0)


@torch.no_grad()
def test_the_loss_is_the_weighted_sum_of_what_is_logged(step, batch):
    module = step("--spectral_loss_weight", "0.7")
    loss, scalars = module(batch, _generator())
    expected = scalars["velocity"] + 0.7 * scalars["spectral"]
    torch.testing.assert_close(loss, expected, rtol=1e-5, atol=0)
    # what is asked for moves no random draw
    plain, alone = step()(batch, _generator())
    assert set(alone) == {"velocity"} and torch.equal(alone["velocity"], scalars["velocity"])
    torch.testing.assert_close(plain, alone["velocity"], rtol=1e-6, atol=0)


@torch.no_grad()
@pytest.mark.parametrize("exponent", [0, 0.5, 1, 2, 4])
def test_phi_weighting(step, lctg_script, batch, exponent, monkeypatch):
    module, rows, times = step("--phi_exponent", str(exponent)), _normal(ROWS).square(), []
    monkeypatch.setattr(lctg_script, "velocity_loss", lambda *args: rows)
    module.model.register_forward_pre_hook(lambda model, args: times.append(args[1]))
    loss, scalars = module(batch, _generator())
    weights = (math.pi / 2 * (times[-1] + 1) / 1000).cos() ** exponent
    # the mean over a quarter turn, by the midpoint rule; where phi fell in this batch does not matter
    grid = (torch.arange(100_000) + 0.5) / 100_000 * math.pi / 2
    expected = (rows * weights).mean() / (grid.double().cos() ** exponent).mean().float()
    torch.testing.assert_close(loss, expected, rtol=1e-4, atol=0)  # float32
    assert torch.equal(scalars["velocity"], rows.mean())  # what is logged stays comparable


@torch.no_grad()
def test_the_scale_of_the_spectral_loss_reaches_it(step, lctg_script, batch, monkeypatch):
    asked = []

    def record(predicted, clean, sensitivity_rate):
        asked.append(sensitivity_rate)
        return torch.ones(len(clean))

    monkeypatch.setattr(lctg_script, "multi_resolution_spectral_loss", record)
    for scale in ("flat", "threshold"):
        module = step("--spectral_loss_weight", "1", "--spectral_loss_scale", scale)
        spectral = module(batch, _generator())[1]["spectral"]
        # cos^2 over a stratified quarter turn: one half
        assert spectral.item() == pytest.approx(0.5, abs=0.02)
    assert asked == [None, 2500]


def test_the_fingertip_is_most_sensitive_at_250_hz():
    frequencies = torch.tensor([0.0, 20, 50, 100, 200, 250, 300, 400, 600, 1000, 1250])
    sensitivity = detection_sensitivity(frequencies)
    assert sensitivity[5].item() == pytest.approx(1, abs=1e-6)
    assert (sensitivity[:6].diff() > 0).all() and (sensitivity[5:].diff() < 0).all() and sensitivity.min() > 0
    # 62 dB above the best threshold at 0 Hz, and 23.7 dB at 500 Hz, by the formula of VC-PWQ
    assert sensitivity[0].item() == pytest.approx(10 ** (-62 / 20), rel=1e-4)
    by_hand = 62 * (math.log10(500 / 550 + 6 / 11) / math.log10(6 / 11)) ** 2
    assert -20 * math.log10(detection_sensitivity(torch.tensor(500.0))) == pytest.approx(by_hand, rel=1e-4)


def test_the_threshold_weighs_frequencies_and_keeps_the_size_of_the_loss():
    time = torch.arange(4096) / 2500
    clean = 100 * _normal(1, 4096)  # far above the floor of the logarithm

    def losses(predicted):
        return [multi_resolution_spectral_loss(predicted, clean, sensitivity_rate=r).item() for r in (None, 2500)]

    # the same gain at every frequency costs its logarithm under any weights of mean one
    assert losses(2 * clean)[1] == pytest.approx(math.log(2), rel=5e-3)
    tones = {f: losses(clean + 1000 * torch.sin(2 * math.pi * f * time)) for f in (60, 250, 800)}
    flat, weighted = (np.array([tones[f][index] for f in (60, 250, 800)]) for index in (0, 1))
    # leakage of a tone is much the same anywhere
    assert flat.max() < 2 * flat.min()
    assert weighted[1] > 2 * flat[1] and weighted[1] > 3 * weighted[0] and weighted[1] > 3 * weighted[2]


# --- the script


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--detail_dropout", "-0.1"], r"--detail_dropout must lie in \[0, 1\], got -0.1"),
        (["--detail_dropout", "1.5"], r"--detail_dropout must lie in \[0, 1\], got 1.5"),
        (["--detail_dropout", "nan"], r"--detail_dropout must lie in \[0, 1\], got nan"),
        (["--phi_exponent", "-1"], "--phi_exponent"),
        (["--latent_penalty", "-1"], "--latent_penalty"),
        (["--spectral_loss_weight", "-1"], "--spectral_loss_weight"),
    ],
)
def test_impossible_arguments_are_refused(lctg_script, words, message):
    with pytest.raises(ValueError, match=message):
        lctg_script.parse_args([*ARGUMENTS, *words])


def test_unknown_scale_is_refused(lctg_script, capsys):
    with pytest.raises(SystemExit):
        lctg_script.parse_args([*ARGUMENTS, "--spectral_loss_scale", "mel"])
    assert "--spectral_loss_scale" in capsys.readouterr().err


@pytest.mark.parametrize("changes", [{}, {"level_bands": 3, "feature_size": 28}], ids=["plain", "levels"])
def test_batches_hold_waveforms_and_all_features(lctg_script, make_extractor, pink_noise, changes):
    extractor = make_extractor(**changes)
    items = [{"texture": torch.from_numpy(row).float()} for row in pink_noise(512, 2500, count=3)]
    batch = lctg_script.make_collate(extractor, 2500)(items)
    assert set(batch) == {"waveform", "input_features"}
    assert batch["waveform"].shape == (3, 512)
    features = extractor.features(batch["waveform"].numpy())
    assert features.shape == (3, extractor.feature_size, 64)
    np.testing.assert_array_equal(batch["input_features"].numpy(), features)


def test_a_layered_model_is_trained_saved_and_gone_on_with(lctg_script, run_script, tiny_configs, tmp_path):
    config = json.loads(tiny_configs["lctg"].read_text())
    config["feature_extractor"] |= {"level_bands": 1, "detail_samples": 2, "feature_size": 28}
    config["lctg"]["latent_channels"] = 6  # what the extractor decides is not asked for a second time
    (tmp_path / "layered.json").write_text(json.dumps(config))
    steps = {"max_train_steps": 2, "checkpointing_steps": 1000}
    first = run_script(
        lctg_script, "lctg", tmp_path / "first", model_config_name_or_path=tmp_path / "layered.json", **steps
    )
    second = run_script(
        lctg_script,
        "lctg",
        tmp_path / "second",
        model_config_name_or_path=None,
        pretrained_model_name_or_path=first,
        **steps,
    )
    pipe = TactileTexturePipeline.from_pretrained(str(second))
    assert {name: pipe.lctg.config[name] for name in LAYERED} == LAYERED
    assert pipe.feature_extractor.level_bands == 1 and pipe.feature_extractor.detail_samples == 2
