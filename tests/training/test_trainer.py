"""`Trainer` on a tiny model without data: accumulation, averaging, interrupted checkpoints, trackers."""

import json

import pytest
import torch
from safetensors.torch import load_file

from tactile_diffusers.io.locks import fcntl, is_locked, unlock_folder
from tactile_diffusers.training.checkpoints import latest_checkpoint


def _state(model):
    return {name: value.detach().clone() for name, value in model.state_dict().items()}


class Killed(Exception):
    pass


def _killed(loss):
    raise Killed


@pytest.mark.parametrize("accumulation", [1, 2])
def test_a_killed_and_resumed_training_equals_an_unbroken_one(make_trainer, tmp_path, accumulation, differing_weights):
    options = {"max_train_steps": 7, "checkpointing_steps": 3, "gradient_accumulation_steps": accumulation}
    unbroken = _state(make_trainer(tmp_path / "unbroken", **options).run())
    with pytest.raises(Killed):
        make_trainer(tmp_path / "killed", at={5 * accumulation: _killed}, **options).run()
    assert latest_checkpoint(tmp_path / "killed").name == "checkpoint-3"
    resumed = make_trainer(tmp_path / "killed", resume_from_checkpoint="latest", **options)
    model = resumed.run()
    assert resumed.module.calls == 4 * accumulation  # steps 4 to 7 only
    assert differing_weights(_state(model), unbroken) == []


def test_noise_depends_on_the_seed(make_trainer, tmp_path):
    drawn = {}
    for name, seed in (("first", 0), ("same", 0), ("other", 1)):
        trainer = make_trainer(tmp_path / name, seed=seed)
        forward, drawn[name] = trainer.module.forward, []

        def look(batch, random, forward=forward, seen=drawn[name]):
            seen.append(torch.randn(3, generator=random.generator.clone_state()))
            return forward(batch, random)

        trainer.module.forward = look
        trainer.run()
    numbers = {name: torch.stack(values) for name, values in drawn.items()}
    assert len(drawn["first"]) == 4 and torch.equal(numbers["first"], numbers["same"])
    # every step of every seed has noise of its own
    assert len(torch.cat([numbers["first"], numbers["other"]]).unique(dim=0)) == 8


def test_averaged_weights_are_validated_and_returned_and_the_raw_ones_trained_on(
    make_trainer, tmp_path, differing_weights
):
    seen = []

    def validate(model):
        assert not model.training and not torch.is_grad_enabled()
        seen.append(_state(model))
        return {"score": 1.0}

    trainer = make_trainer(tmp_path, validate=validate, validation_steps=2, ema_decay=0.9)
    model = trainer.run()
    assert len(seen) == 2 and not model.training
    assert differing_weights(_state(model), seen[-1]) == []
    raw = load_file(tmp_path / "checkpoint-4" / "dale" / "diffusion_pytorch_model.safetensors")
    assert any(not torch.equal(raw[name], value) for name, value in _state(model).items())
    without = make_trainer(tmp_path / "no_validation", validation_steps=1000, ema_decay=0.9).run()
    assert differing_weights(_state(without), _state(model)) == []  # looking changes nothing


def test_weights_learn_and_the_rate_follows_its_schedule(make_trainer, tmp_path):
    trainer = make_trainer(tmp_path, max_train_steps=200, checkpointing_steps=1000, lr_warmup_steps=10)
    trainer.run()
    log = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    losses = [entry["train/loss"] for entry in log if "train/loss" in entry]
    rates = [entry["lr"] for entry in log if "lr" in entry]
    assert losses[-1] < 0.8 * losses[0]
    assert len(rates) == 4 and rates == sorted(rates, reverse=True) and rates[-1] == pytest.approx(0, abs=1e-8)


@pytest.mark.skipif(fcntl is None, reason="needs flock")
def test_a_training_holds_its_folder_from_its_start_to_its_result(make_trainer, script, run_script, tmp_path):
    trainer = make_trainer(tmp_path / "a", max_train_steps=1)
    assert is_locked(tmp_path / "a")
    trainer.run()
    assert is_locked(tmp_path / "a")  # its result is yet to be written
    run_script(script("train_lctg"), "lctg", tmp_path / "b", max_train_steps=1)
    assert not is_locked(tmp_path / "b")
    unlock_folder(tmp_path / "a")


def test_tensorboard_gets_scalars(make_trainer, tmp_path):
    event_accumulator = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    make_trainer(tmp_path, report_to="tensorboard", validate=lambda model: {"score": 0.25}).run()
    files = (tmp_path / "logs").rglob("events.*")  # the hyperparameters have one of their own
    read = [event_accumulator.EventAccumulator(str(file)).Reload() for file in files]
    [events] = [events for events in read if "lr" in events.Tags()["scalars"]]
    assert {"train/loss", "lr", "validation/score"} <= set(events.Tags()["scalars"])
    [score] = events.Scalars("validation/score")
    assert score.step == 4 and score.value == 0.25


def test_epochs_count_updates(make_trainer, tmp_path):
    options = {"max_train_steps": None, "rows": 13, "num_train_epochs": 5}
    assert make_trainer(tmp_path, **options).total_steps == 5 * 4
    assert make_trainer(tmp_path, gradient_accumulation_steps=2, **options).total_steps == 5 * 2
