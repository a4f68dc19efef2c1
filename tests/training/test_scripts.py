"""What both training scripts leave behind: a pipeline that generates, statistics in its config, logs, pictures."""

import json

import numpy as np
import pytest
import torch

from tactile_diffusers import TactileTexturePipeline
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.schedulers import RECOMMENDED


@pytest.fixture
def pipe(runs):
    pipe = TactileTexturePipeline.from_pretrained(runs / "dale")
    pipe.set_progress_bar_config(disable=True)
    return pipe


@pytest.mark.parametrize(("duration_s", "samples"), [(None, 2048), (0.5, 5000)])
def test_the_result_generates(pipe, duration_s, samples):
    options = {"num_inference_steps": 2, "duration_s": duration_s}
    out = pipe([1.0, None, -1.0], generator=torch.Generator().manual_seed(0), **options)
    assert out.textures.shape == (1, samples) and np.isfinite(out.textures).all()
    for scheduler in (pipe.scheduler, pipe.dale_scheduler):
        assert {name: scheduler.config[name] for name in RECOMMENDED} == RECOMMENDED


def test_statistics_of_the_data_are_in_the_config(pipe, prepared):
    data, config = PreparedDataset(prepared, "train"), pipe.dale.config
    assert config.level_mean == pytest.approx(data.levels.mean(), rel=1e-5)
    assert config.level_std == pytest.approx(data.levels.std(), rel=1e-4)
    assert config.log_friction_mean == pytest.approx(np.log(data.friction_coefficients).mean(), abs=1e-5)
    assert config.reference_speed == pytest.approx(data.speeds.mean(), rel=1e-5)
    statistics = config.rating_statistics
    assert statistics["mean"] == pytest.approx(data.ratings.raw_mean.tolist(), rel=1e-6)
    assert statistics["std"] == pytest.approx(data.ratings.raw_scale.tolist(), rel=1e-6)
    table = np.array(statistics["quantiles"])
    assert table.shape == (3, 21) and (np.diff(table) >= 0).all()
    assert table[:, [0, -1]].tolist() == statistics["range"]
    assert config.latent_frames * pipe.lctg.config.latent_hop == pipe.lctg.config.segment_samples == 512
    latents = pipe.encode(data.textures(np.arange(len(data))), data.sampling_rate).latents
    # training resamples whole recordings, this segments: they differ at the ends
    torch.testing.assert_close(torch.tensor(config.latent_mean), latents.mean((0, 2)), rtol=0, atol=0.02)
    torch.testing.assert_close(torch.tensor(config.latent_std), latents.std((0, 2)), rtol=0.1, atol=0.01)
    gains = pipe.feature_extractor.preemphasis_db
    assert min(gains) == 0 and 0 < max(gains) <= 30


def test_dale_leaves_lctg_alone(runs):
    name = "lctg/diffusion_pytorch_model.safetensors"
    assert (runs / "lctg" / name).read_bytes() == (runs / "dale" / name).read_bytes()


@pytest.mark.parametrize(
    ("name", "scores"),
    [
        ("lctg", ("nine_band_db", "snr_db")),
        ("dale", ("velocity_rated", "velocity_unrated", "scalars_rated", "scalars_unrated")),
    ],
)
def test_logs_and_pictures(runs, name, scores):
    values = {}
    for line in (runs / name / "log.jsonl").read_text().splitlines():
        values |= json.loads(line)
    assert values["step"] == 2 and np.isfinite(values["train/loss"])
    assert all(np.isfinite(values[f"validation/{score}"]) for score in scores)
    for picture in ("loss.png", "validation.png"):
        assert (runs / name / picture).stat().st_size > 5000
