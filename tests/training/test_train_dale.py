"""`examples/train_dale.py` on a tiny data set: learning, the rating estimator, its options."""

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

from tactile_diffusers import TactileTexturePipeline
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.signal import rms

# without the auxiliary loss, which has a test of its own; two updates of its head instead of 600
OPTIONS = {"gradient_accumulation_steps": 2, "conditioning_weight": 0, "rating_head_steps": 2}


@pytest.fixture
def dale_script(train_dale):
    return train_dale()


@pytest.fixture
def train(dale_script, run_script, runs):
    """`train(output, **options)` runs the script on the tiny data set and returns the output folder."""
    fixed = {**OPTIONS, "pretrained_model_name_or_path": runs / "lctg"}
    return lambda output, **options: run_script(dale_script, "dale", output, **(fixed | options))


def test_the_estimator_is_saved_with_the_pipeline(train, dale_script, tmp_path, monkeypatch, pink_noise):
    fit = dale_script.fit_rating_estimator
    monkeypatch.setattr(dale_script, "fit_rating_estimator", lambda *a, **k: fit(*a, **k, batch_size=8))
    output = train(tmp_path / "dale", max_train_steps=1, conditioning_weight=0.05)
    assert "train/conditioning" in (output / "log.jsonl").read_text()
    pipe = TactileTexturePipeline.from_pretrained(output)
    assert np.isfinite(pipe.estimate_ratings(pink_noise(2048, 10_000), 10_000, 0.5)).all()
    # where textures of ratings are is known too, for the warning of others: four surfaces settle no covariance
    statistics = pipe.dale.config.rating_statistics
    assert np.shape(statistics["range"]) == (3, 2) and "reach" not in statistics


def test_single_raters_are_what_dale_hears(dale_script, train, prepared, tmp_path, monkeypatch):
    """Another rating each time than the pooled one, of a rater of that surface."""
    asked = []
    step = dale_script.DALETrainingStep

    class Watched(step):
        def forward(self, batch, random):
            self.model.register_forward_pre_hook(lambda module, args: asked.append((batch["ratings"], args[2])))
            return super().forward(batch, random)

    monkeypatch.setattr(dale_script, "DALETrainingStep", Watched)
    options = {"max_train_steps": 1, "gradient_accumulation_steps": 1, "rating_head_steps": 1}
    train(tmp_path / "dale", ratings="single", condition_dropout=0, unconditional=0, **options)
    raters = PreparedDataset(prepared).ratings.single.shape[0]
    for every, heard in asked[:1]:
        assert every.shape == (4, raters, 3)
        assert ((every == heard[:, None]).all(-1).sum(1) >= 1).all()
    assert asked


def test_single_raters_are_refused_where_the_file_has_none(train, prepared, tmp_path):
    older = shutil.copy(prepared, tmp_path / "older.h5")
    with h5py.File(older, "r+") as file:
        del file["ratings/single"]
    with pytest.raises(ValueError, match="--ratings single: the file holds no single raters' ratings"):
        train(tmp_path / "dale", ratings="single", train_data_dir=older)
    assert not list(tmp_path.glob("dale/checkpoint-*"))


def test_fewer_training_surfaces(train, prepared, tmp_path):
    options = {"max_train_steps": 1, "gradient_accumulation_steps": 1, "rating_head_steps": 1}
    output = train(tmp_path / "dale", max_train_surfaces=2, **options)
    data = PreparedDataset(prepared)
    ends = np.unique(data.surface_ids)[[0, -1]]
    record = json.loads((output / "training.json").read_text())
    assert record["trained_on"]["surfaces"] == sorted(data.surfaces[number] for number in ends)
    config = json.loads((output / "dale" / "config.json").read_text())
    # statistics are of what is trained on
    expected = np.sort(data.ratings.mean[ends], axis=0).T
    np.testing.assert_allclose(config["rating_statistics"]["range"], expected, atol=1e-6)  # float32


def test_sixty_steps_reduce_the_loss(train, tmp_path, read_entries):
    logs = []
    for steps in (1, 60):
        output = train(
            tmp_path / str(steps),
            max_train_steps=steps,
            learning_rate=4e-3,
            gradient_accumulation_steps=1,
            train_batch_size=16,
            checkpointing_steps=1000,
            ema_decay=0.9,
        )
        logs.append({key: value for entry in read_entries(output) for key, value in entry.items()})
    first, last = logs  # means over step 1 and over steps 51 to 60
    # v = 0 at the start, of states of unit variance; rows of small surfaces count more
    assert first["train/velocity"] == pytest.approx(1.0, abs=0.3)
    # latents of an encoder of two steps are almost white: what can be learned of them in a minute is little but clear;
    # level and friction follow from the ratings much sooner
    assert last["train/scalars"] < 0.75 * first["train/scalars"]
    # on a surface it has not seen, with the same times and noise both times
    assert last["validation/velocity_rated"] < 0.995 * first["validation/velocity_rated"]


def test_the_papers_configuration_trains_and_generates_its_gain(train, runs, tiny_configs, tmp_path):
    """Through the latents: the waveform keeps the level, and nothing restores it."""
    lctg = TactileTexturePipeline.from_pretrained(runs / "lctg")
    lctg.feature_extractor.fixed_scale = 0.01
    lctg.save_pretrained(tmp_path / "lctg")
    paper = json.loads((Path(__file__).parents[2] / "examples/configs/dale_paper.json").read_text())
    tiny = json.loads(tiny_configs["dale"].read_text())
    paper["dale"] |= tiny["dale"]
    (tmp_path / "paper.json").write_text(json.dumps(paper))
    options = {"pretrained_model_name_or_path": tmp_path / "lctg", "ratings": "single"}
    output = train(tmp_path / "dale", model_config_name_or_path=tmp_path / "paper.json", **options)
    pipe = TactileTexturePipeline.from_pretrained(output)
    pipe.set_progress_bar_config(disable=True)
    assert not pipe.dale.rating_pool.weight.any() and pipe.dale_scheduler.config.multistep_order == 1
    assert pipe.dale.config.level_std == 0 == pipe.dale.config.log_friction_std
    out = pipe([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], num_inference_steps=2, generator=torch.Generator().manual_seed(0))
    assert out.level.tolist() == pytest.approx(np.log(rms(out.textures)).tolist(), abs=1e-4)  # float32
    assert out.level[0] != pytest.approx(out.level[1], abs=1e-4)


def test_null_in_the_config_is_what_the_data_say(train, tiny_configs, tmp_path):
    config = json.loads(tiny_configs["dale"].read_text())
    config["dale"]["log_friction_std"] = None
    (tmp_path / "config.json").write_text(json.dumps(config))
    output = train(tmp_path / "dale", model_config_name_or_path=tmp_path / "config.json", max_train_steps=1)
    assert TactileTexturePipeline.from_pretrained(output).dale.config.log_friction_std > 0
