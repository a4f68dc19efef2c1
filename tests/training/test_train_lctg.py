"""`examples/train_lctg.py` on a tiny data set: outputs, learning, exact resume, checkpoints, refusals."""

import hashlib
import json
import shutil

import numpy as np
import pytest
import torch

from tactile_diffusers import TactileTexturePipeline
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.training.record import surfaces_of

WEIGHTS = "diffusion_pytorch_model.safetensors"


@pytest.fixture
def lctg_script(script):
    """A fresh module of the script, free to be patched."""
    return script("train_lctg")


@pytest.fixture
def train(lctg_script, run_script):
    """`train(output, **options)` runs the script on the tiny data set and returns the output folder."""
    return lambda output, **options: run_script(lctg_script, "lctg", output, **options)


@pytest.fixture(scope="module")
def trained(script, run_script, tmp_path_factory):
    """The output folder of four steps, unbroken. Copy it before changing anything in it."""
    return run_script(script("train_lctg"), "lctg", tmp_path_factory.mktemp("trained") / "lctg")


@pytest.fixture
def copy_of_trained(trained, tmp_path):
    return shutil.copytree(trained, tmp_path / "lctg")


def _names(folder, pattern="*checkpoint-*"):
    return sorted(path.name for path in folder.glob(pattern))


class TestOutput:
    def test_folder_is_a_pipeline_that_reconstructs(self, trained, prepared, recorded_warnings):
        with recorded_warnings() as found:
            pipe = TactileTexturePipeline.from_pretrained(str(trained))
        assert found == [] and pipe.dale is None
        assert pipe.lctg.config.segment_samples == 512 and pipe.lctg.config.latent_hop == 16
        assert len(pipe.feature_extractor.preemphasis_db) == len(pipe.feature_extractor.preemphasis_frequencies) > 8
        assert max(pipe.feature_extractor.preemphasis_db) <= 30
        pipe.set_progress_bar_config(disable=True)
        texture = PreparedDataset(prepared, "test").textures([0])
        out = pipe.reconstruct(texture, 10_000, 3, torch.Generator().manual_seed(0))
        assert out.textures.shape == texture.shape and np.isfinite(out.textures).all()

    def test_pictures_and_facts_for_the_model_card(self, trained, prepared):
        for name in ("loss.png", "validation.png"):
            assert (trained / name).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
        facts = json.loads((trained / "training.json").read_text())
        assert facts["steps"] == 4 and facts["segments"] > 4 and facts["arguments"]["seed"] == 0
        assert facts["trained_on"] == surfaces_of(PreparedDataset(prepared, "train"))

    def test_averaged_weights_are_the_ones_saved(self, trained, differing_weights):
        assert differing_weights(trained / "lctg", trained / "checkpoint-4" / "lctg_ema") == []
        assert differing_weights(trained / "lctg", trained / "checkpoint-4" / "lctg")

    def test_without_averaging_the_last_weights_are_the_ones_saved(self, train, trained, tmp_path, differing_weights):
        output = train(tmp_path / "raw", **{"no-use_ema": True})
        assert differing_weights(output / "lctg", trained / "checkpoint-4" / "lctg") == []
        assert not (output / "checkpoint-4" / "lctg_ema").exists()


class TestResume:
    def test_resumed_training_equals_an_unbroken_one_bit_for_bit(
        self, train, trained, copy_of_trained, differing_weights, read_entries
    ):
        # as if killed while writing the checkpoint of step 4
        (copy_of_trained / "checkpoint-4").rename(copy_of_trained / "unfinished-checkpoint-4")
        (copy_of_trained / "unfinished-checkpoint-4" / "lctg" / WEIGHTS).write_bytes(b"")
        shutil.rmtree(copy_of_trained / "lctg")
        train(copy_of_trained, resume_from_checkpoint="latest")
        assert differing_weights(copy_of_trained / "lctg", trained / "lctg") == []
        for part in ("lctg", "lctg_ema"):
            assert differing_weights(copy_of_trained / "checkpoint-4" / part, trained / "checkpoint-4" / part) == []
        resumed, unbroken = (
            torch.load(folder / "checkpoint-4" / "optimizer.bin", weights_only=True)["state"]
            for folder in (copy_of_trained, trained)
        )
        for index, state in unbroken.items():
            assert all(torch.equal(value, resumed[index][name]) for name, value in state.items())
        # what was logged after the checkpoint is not there twice; means over fewer steps than unbroken may differ
        resumed, unbroken = read_entries(copy_of_trained), read_entries(trained)
        assert [entry["step"] for entry in resumed] == [entry["step"] for entry in unbroken]
        assert resumed[-1] == unbroken[-1]
        assert _names(copy_of_trained) == ["checkpoint-2", "checkpoint-4"]

    def test_finished_training_is_left_as_it_is(self, train, trained, copy_of_trained, differing_weights, read_entries):
        train(copy_of_trained, resume_from_checkpoint="latest")
        assert differing_weights(copy_of_trained / "lctg", trained / "lctg") == []
        assert read_entries(copy_of_trained) == read_entries(trained)

    def test_latest_before_the_first_checkpoint_starts_from_the_beginning(
        self, train, trained, tmp_path, differing_weights, read_entries
    ):
        output = tmp_path / "killed"
        output.mkdir()
        (output / "log.jsonl").write_text('{"step": 1, "train/loss": 123.0, "lr": 0.1, "seconds": 9.0}\n')
        train(output, resume_from_checkpoint="latest")
        assert differing_weights(output / "lctg", trained / "lctg") == []
        assert read_entries(output) == read_entries(trained)  # nothing of the run that left no checkpoint

    @pytest.mark.parametrize("wanted", ["nowhere", "lctg"])
    def test_what_is_no_checkpoint_is_refused(self, train, copy_of_trained, wanted):
        with pytest.raises(ValueError, match="--resume_from_checkpoint"):
            train(copy_of_trained, resume_from_checkpoint=copy_of_trained / wanted)


class TestCheckpoints:
    def test_the_oldest_are_removed_and_foreign_folders_are_not(self, train, tmp_path):
        output = tmp_path / "lctg"
        (output / "checkpoint-best").mkdir(parents=True)
        train(output, checkpointing_steps=1, checkpoints_total_limit=3, max_train_steps=4)
        assert _names(output) == ["checkpoint-2", "checkpoint-3", "checkpoint-4", "checkpoint-best"]


def _snapshot(folder):
    """Every file's name and hash."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()[:12] for path in files}


class TestRefusals:
    def test_output_folder_in_use(self, train, copy_of_trained):
        before = _snapshot(copy_of_trained)
        with pytest.raises(ValueError, match="--output_dir .* already holds a training.*--overwrite_output_dir"):
            train(copy_of_trained)
        assert _snapshot(copy_of_trained) == before

    def test_overwriting_starts_again(self, train, copy_of_trained, read_entries):
        (copy_of_trained / "checkpoint-4").rename(copy_of_trained / "checkpoint-900")
        train(copy_of_trained, overwrite_output_dir=True, max_train_steps=2, seed=1)
        assert _names(copy_of_trained) == ["checkpoint-2"]
        assert {entry["step"] for entry in read_entries(copy_of_trained)} == {2}

    @pytest.mark.parametrize(
        ("options", "error", "message"),
        [
            ({"train_data_dir": "/nowhere/prepared.h5"}, FileNotFoundError, "/nowhere/prepared.h5"),
            ({"train_batch_size": 100_000}, ValueError, "train_batch_size"),
            ({"lr_scheduler": "zigzag"}, SystemExit, "2"),
        ],
        ids=lambda value: str(value) if isinstance(value, dict) else None,
    )
    def test_bad_arguments_damage_nothing(self, train, copy_of_trained, options, error, message):
        before = _snapshot(copy_of_trained)
        with pytest.raises(error, match=message):
            train(copy_of_trained, overwrite_output_dir=True, **options)
        assert _snapshot(copy_of_trained) == before


class TestLearning:
    def test_sixty_steps_reduce_the_loss(self, train, tmp_path, read_entries):
        options = {"train_batch_size": 8, "learning_rate": 4e-3, "checkpointing_steps": 1000}
        # not whitened: white noise has nothing to learn but what the latents say, which takes longer
        options |= {"octave_exponent": 0, "preemphasis_clip_db": 0}
        losses = []
        for steps in (1, 60):  # the mean over step 1, and over steps 51 to 60
            output = train(tmp_path / str(steps), max_train_steps=steps, **options)
            losses.append([entry["train/velocity"] for entry in read_entries(output) if "train/velocity" in entry][-1])
        assert losses[0] == pytest.approx(1.0, abs=0.25)  # v = 0 at the start, of data of unit variance
        assert losses[1] < 0.9 * losses[0]

    def test_second_phase_goes_on_from_the_first(self, train, trained, tmp_path, differing_weights):
        options = {"pretrained_model_name_or_path": trained, "subset": "full"}
        output = train(tmp_path / "second", max_train_steps=2, **options)
        moved = {name.split(".")[0] for name in differing_weights(trained / "lctg", output / "lctg")}
        assert moved == {"encoder", "decoder", "time_embedder"}
        extractor = "feature_extractor/preprocessor_config.json"
        assert (output / extractor).read_bytes() == (trained / extractor).read_bytes()
        assert (
            json.loads((output / "training.json").read_text())["segments"]
            > json.loads((trained / "training.json").read_text())["segments"]
        )

    def test_seed_decides_everything(self, train, trained, tmp_path, differing_weights):
        torch.manual_seed(123)
        again = train(tmp_path / "again")
        assert differing_weights(again / "lctg", trained / "lctg") == []
        other = train(tmp_path / "other", seed=1)
        assert "decoder.conv_in.weight" in differing_weights(again / "lctg", other / "lctg")
