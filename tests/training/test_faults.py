"""What a training says and leaves when something goes wrong: numbers that are none, a full disk, other checkpoints."""

import re
from pathlib import Path

import pytest
import torch
from diffusers import DDIMScheduler

from tactile_diffusers import TactileTexturePipeline
from tactile_diffusers.training import card
from tactile_diffusers.training.checkpoints import checkpoints, clear_unfinished, latest_checkpoint, save_result
from tactile_diffusers.training.record import read_log

WEIGHTS = "dale/diffusion_pytorch_model.safetensors"


def _names(folder):
    return sorted(path.name for path in folder.iterdir())


class TestNumbersThatAreNone:
    @pytest.mark.parametrize("value", [float("nan"), float("inf")])
    @pytest.mark.parametrize("resumed", [False, True])
    def test_the_step_the_segments_and_the_checkpoint_are_named(self, make_trainer, tmp_path, value, resumed):
        options = {"checkpointing_steps": 1, "gradient_accumulation_steps": 2}
        if resumed:  # indices are counted from the beginning of the training
            make_trainer(tmp_path, max_train_steps=1, **options).run()
        fails, seen = 4 if resumed else 6, []
        trainer = make_trainer(
            tmp_path, at={fails: lambda loss: loss * value}, resume_from_checkpoint="latest", **options
        )
        trainer.dataset = _Noting(trainer.dataset, seen)
        with pytest.raises(FloatingPointError, match=rf"The loss is {value} in step 3\..*checkpoint-2\.$") as stop:
            trainer.run()
        assert latest_checkpoint(tmp_path).name == "checkpoint-2"
        assert _segments(stop) == seen[3 * (fails - 1) : 3 * fails]
        assert all(p.isfinite().all() for p in trainer.module.parameters())

    def test_a_gradient_that_is_no_number(self, make_trainer, tmp_path):
        def endless_slope(loss):  # the root's derivative at zero
            return loss + (loss - loss.detach()).abs().sqrt()

        trainer = make_trainer(tmp_path, at={4: endless_slope}, checkpointing_steps=1, gradient_accumulation_steps=2)
        match = r"The norm of the gradient is nan, of a finite loss, in step 2\..*checkpoint-1\.$"
        with pytest.raises(FloatingPointError, match=match) as stop:
            trainer.run()
        assert len(_segments(stop)) == 2 * 3  # one of both batches led to it
        assert all(p.isfinite().all() for p in trainer.module.parameters())

    def test_weights_that_are_no_numbers_are_not_saved(self, make_trainer, tmp_path):
        trainer = make_trainer(tmp_path, checkpointing_steps=2)
        trainer.run()
        before = _names(tmp_path)
        trainer.step, weight = 5, next(trainer.module.parameters())
        weight.data[..., 0] = torch.inf
        with pytest.raises(FloatingPointError, match=r"Weights are not finite after step 5.*checkpoint-4\.$"):
            trainer.save_checkpoint()
        assert _names(tmp_path) == before


class _Noting(torch.utils.data.Dataset):
    """A data set that notes which rows are asked for."""

    def __init__(self, dataset, seen):
        self.dataset, self.seen = dataset, seen

    def __len__(self):
        return len(self.dataset)

    def __getitem__(self, index):
        self.seen.append(index)
        return self.dataset[index]


def _segments(stop):
    return [int(word) for word in re.search(r"indices \[(.*?)\]", str(stop.value))[1].split(",")]


class TestOtherCheckpoints:
    def test_going_on_from_an_older_one_forgets_those_that_came_after(self, make_trainer, tmp_path):
        """They are of another way: `latest` would go back to it, and rotation take the new ones for the oldest."""
        options = {"checkpointing_steps": 1, "checkpoints_total_limit": 4, "max_train_steps": 6}
        make_trainer(tmp_path, **options).run()
        assert [path.name for path in checkpoints(tmp_path)] == [f"checkpoint-{step}" for step in (3, 4, 5, 6)]
        options |= {"checkpoints_total_limit": 2, "max_train_steps": 5, "learning_rate": 1e-3}
        older = tmp_path / "checkpoint-3"
        with pytest.raises(KeyboardInterrupt):
            make_trainer(tmp_path, resume_from_checkpoint=older, at={2: _stop}, **options).run()
        assert [path.name for path in checkpoints(tmp_path)] == ["checkpoint-3", "checkpoint-4"]

    def test_a_validation_that_a_kill_took_is_made_up_for(self, make_trainer, tmp_path):
        options = {"checkpointing_steps": 2, "validation_steps": 2}
        make_trainer(tmp_path / "unbroken", **options).run()

        def dying(model):
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            make_trainer(tmp_path / "killed", validate=dying, **options).run()
        assert latest_checkpoint(tmp_path / "killed").name == "checkpoint-2"
        make_trainer(tmp_path / "killed", resume_from_checkpoint="latest", **options).run()
        told = [[(e["step"], "train/loss" in e) for e in read_log(tmp_path / name)] for name in ("killed", "unbroken")]
        assert told[0] == told[1] == [(2, False), (4, True), (4, False)]

    def test_what_was_left_unfinished_is_cleared_and_nothing_else(self, tmp_path):
        ours = ["unfinished-checkpoint-3", "unfinished-removal-of-checkpoint-1", "unfinished-result"]
        others = ["checkpoint-2", "unfinished-business", "unfinished-checkpoint-best", "lctg"]
        for name in ours + others:
            (tmp_path / name).mkdir()
        (tmp_path / ".log.jsonl.123.tmp").write_text("")
        (tmp_path / "notes.tmp").write_text("")
        clear_unfinished(tmp_path)
        assert _names(tmp_path) == sorted([*others, "notes.tmp"])


def _stop(loss):
    raise KeyboardInterrupt


class TestResult:
    def _save(self, folder, steps):
        DDIMScheduler(num_train_timesteps=steps).save_pretrained(f"{folder}/scheduler")
        Path(folder, "model_index.json").write_text("{}")
        if steps == 30:
            raise RuntimeError("PytorchStreamWriter failed writing file data/3: file write failed")

    def _steps(self, output):
        return DDIMScheduler.from_pretrained(output / "scheduler").config.num_train_timesteps

    def test_it_takes_the_place_of_an_older_one_and_leaves_the_rest(self, tmp_path):
        (tmp_path / "log.jsonl").write_text("")
        for steps in (10, 20):
            save_result(tmp_path, lambda folder, steps=steps: self._save(folder, steps))
            assert self._steps(tmp_path) == steps
            assert _names(tmp_path) == ["log.jsonl", "model_index.json", "scheduler"]

    def test_what_cannot_be_written_leaves_the_older_one(self, tmp_path):
        (tmp_path / "checkpoint-7").mkdir()
        save_result(tmp_path, lambda folder: self._save(folder, 10))
        with pytest.raises(OSError, match=r"trained models could not be written.*MiB are free.*checkpoint-7\."):
            save_result(tmp_path, lambda folder: self._save(folder, 30))
        assert self._steps(tmp_path) == 10 and _names(tmp_path) == ["checkpoint-7", "model_index.json", "scheduler"]


# --- a full disk


@pytest.fixture
def small_quota():
    """`small_quota(size)` forbids this process files of more bytes; `None` allows what was allowed."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)

    def limit(size):
        resource.setrlimit(resource.RLIMIT_FSIZE, before if size is None else (size, before[1]))

    yield limit
    limit(None)


class TestFullDisk:
    OPTIONS = {"checkpointing_steps": 1, "checkpoints_total_limit": 1, "max_train_steps": 3}

    @pytest.fixture
    def unbroken(self, make_trainer, tmp_path):
        make_trainer(tmp_path / "unbroken", **self.OPTIONS).run()
        return tmp_path / "unbroken" / "checkpoint-3"

    def _assert_it_continues(self, make_trainer, output, unbroken, differing_weights):
        make_trainer(output, resume_from_checkpoint="latest", **self.OPTIONS).run()
        assert differing_weights(output / "checkpoint-3" / "dale", unbroken / "dale") == []

    @pytest.mark.parametrize("file", [WEIGHTS, "optimizer.bin"])
    def test_a_quota_that_is_used_up(self, make_trainer, unbroken, small_quota, tmp_path, file, differing_weights):
        output, limit = tmp_path / "output", (unbroken / file).stat().st_size - 1000
        look = {3: lambda loss: small_quota(limit) or loss}  # in step 3
        with pytest.raises(OSError, match=r"The checkpoint of step 3 could not be written.*checkpoint-2\."):
            make_trainer(output, at=look, **self.OPTIONS).run()
        small_quota(None)
        assert [path.name for path in output.glob("*checkpoint*")] == ["checkpoint-2"]
        self._assert_it_continues(make_trainer, output, unbroken, differing_weights)

    @pytest.mark.parametrize(("what", "function"), [("loss.png", "plot_losses"), ("The model card", "write_card")])
    def test_no_room_for_what_tells_of_the_result(
        self, script, run_script, small_quota, monkeypatch, tmp_path, what, function
    ):
        output, original = tmp_path / "output", getattr(card, function)
        with monkeypatch.context() as patch:
            patch.setattr(card, function, lambda *a, **k: small_quota(1000) or original(*a, **k))
            message = rf"^{what} could not be written to .*The training is finished and its models are saved\."
            with pytest.raises(OSError, match=rf"{message}.*--resume_from_checkpoint latest\.$"):
                run_script(script("train_lctg"), "lctg", output, max_train_steps=1)
        small_quota(None)
        TactileTexturePipeline.from_pretrained(str(output))
        assert not list(output.glob(".*")) and not (output / "README.md").exists()
        assert (output / "loss.png").exists() == (what != "loss.png")
        run_script(script("train_lctg"), "lctg", output, max_train_steps=1, resume_from_checkpoint="latest")
        assert {"README.md", "loss.png"} <= set(_names(output))
