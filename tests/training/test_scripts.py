"""Both training scripts as a user runs them: two processes, one after the other, then the pipeline."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from tactile_diffusers import TactileTexturePipeline
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.schedulers import RECOMMENDED

EXAMPLES = Path(__file__).parents[2] / "examples"


def _run(script, words):
    return subprocess.run(
        [sys.executable, str(EXAMPLES / script), *words],
        capture_output=True,
        text=True,
        env={**os.environ, "HF_HUB_OFFLINE": "1"},
        timeout=240,
    )


@pytest.fixture(scope="module")
def folders(options_of_a_tiny_training, tmp_path_factory):
    """Output folders of both scripts."""
    root = tmp_path_factory.mktemp("scripts")
    changes = {"max_train_steps": 3, "validation_steps": 3, "checkpointing_steps": 100}
    done = _run("train_lctg.py", options_of_a_tiny_training("lctg", root / "lctg", subset="full", **changes))
    assert done.returncode == 0, done.stderr
    changes |= {"pretrained_model_name_or_path": root / "lctg", "conditioning_weight": 0}
    done = _run("train_dale.py", options_of_a_tiny_training("dale", root / "pipeline", **changes))
    assert done.returncode == 0, done.stderr
    return root


def _the_result_generates(folders, prepared, recorded_warnings):
    with recorded_warnings() as found:
        pipe = TactileTexturePipeline.from_pretrained(str(folders / "pipeline"))
    assert not found
    pipe.set_progress_bar_config(disable=True)
    out = pipe([1.0, None, -1.0], num_inference_steps=3, generator=torch.Generator().manual_seed(0))
    assert out.textures.shape == (1, 2048) and np.isfinite(out.textures).all()
    long = pipe([1.0, None, -1.0], num_inference_steps=2, duration_s=0.5, generator=torch.Generator().manual_seed(0))
    assert long.textures.shape == (1, 5000) and np.isfinite(long.textures).all()


def _statistics_of_the_data_are_in_the_config(folders, prepared):
    pipe = TactileTexturePipeline.from_pretrained(str(folders / "pipeline"))
    data, config = PreparedDataset(prepared, "train"), pipe.dale.config
    assert config.level_mean == pytest.approx(data.levels.mean(), rel=1e-5)
    assert config.level_std == pytest.approx(data.levels.std(), rel=1e-4)
    assert config.log_friction_mean == pytest.approx(np.log(data.friction_coefficients).mean(), abs=1e-5)
    assert config.reference_speed == pytest.approx(data.speeds.mean(), rel=1e-5)
    statistics = config.rating_statistics
    assert statistics["mean"] == pytest.approx(data.ratings.raw_mean.tolist(), rel=1e-6)
    table = np.array(statistics["quantiles"])
    assert table.shape == (3, 21) and (np.diff(table) >= 0).all()
    assert table[:, [0, -1]].tolist() == statistics["range"]
    assert statistics["std"] == pytest.approx(data.ratings.raw_scale.tolist(), rel=1e-6)
    assert config.latent_frames * pipe.lctg.config.latent_hop == pipe.lctg.config.segment_samples == 512
    latents = pipe.encode(data.textures(np.arange(len(data))), data.sampling_rate).latents
    # the encoder heard the working rate in training and 10 kHz here: two resamplings differ at the ends
    torch.testing.assert_close(torch.tensor(config.latent_mean), latents.mean((0, 2)), rtol=0, atol=0.02)
    torch.testing.assert_close(torch.tensor(config.latent_std), latents.std((0, 2)), rtol=0.1, atol=0.01)
    gains = pipe.feature_extractor.preemphasis_db
    assert min(gains) == 0 and 0 < max(gains) <= 30


def _the_schedulers_of_training_are_those_of_sampling(folders):
    pipe = TactileTexturePipeline.from_pretrained(str(folders / "pipeline"))
    for scheduler in (pipe.scheduler, pipe.dale_scheduler):
        assert {name: scheduler.config[name] for name in RECOMMENDED} == RECOMMENDED


def _dale_leaves_lctg_alone(folders):
    name = "lctg/diffusion_pytorch_model.safetensors"
    assert (folders / "lctg" / name).read_bytes() == (folders / "pipeline" / name).read_bytes()


def _logs_and_pictures(folders):
    for folder, scores in (
        ("lctg", ("nine_band_db", "snr_db")),
        ("pipeline", ("velocity_rated", "velocity_unrated", "scalars_rated", "scalars_unrated")),
    ):
        log = [json.loads(line) for line in (folders / folder / "log.jsonl").read_text().splitlines()]
        values = {key: value for entry in log for key, value in entry.items()}
        assert values["step"] == 3 and np.isfinite(values["train/loss"])
        assert all(np.isfinite(values[f"validation/{score}"]) for score in scores)
        for picture in ("loss.png", "validation.png"):
            assert (folders / folder / picture).stat().st_size > 5000
        assert (folders / folder / "training.json").is_file()


def test_both_scripts_make_a_pipeline(folders, prepared, recorded_warnings):
    """One test: processes that share the tests would each run both trainings for several."""
    _the_result_generates(folders, prepared, recorded_warnings)
    _statistics_of_the_data_are_in_the_config(folders, prepared)
    _the_schedulers_of_training_are_those_of_sampling(folders)
    _dale_leaves_lctg_alone(folders)
    _logs_and_pictures(folders)
