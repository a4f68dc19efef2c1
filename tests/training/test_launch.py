"""How training scripts start: refusals in one line with exit code 2, later errors with their traceback, the device."""

import os
import sys

import pytest
import torch

from tactile_diffusers.io.locks import fcntl
from tactile_diffusers.training.launch import on_cpu, run, starting


@pytest.fixture
def refusal(script, options_of_a_tiny_training, monkeypatch, capsys):
    """`refusal("train_lctg", output, **changes)` is the last line on stderr of a script that refuses to start."""

    def run_script(name, output, **changes):
        words = options_of_a_tiny_training("dale" if name == "train_dale" else "lctg", output, **changes)
        monkeypatch.setattr(sys, "argv", [f"{name}.py", *words])
        with pytest.raises(SystemExit) as stop:
            run(script(name).main)
        assert stop.value.code == 2
        return capsys.readouterr().err.strip().splitlines()[-1]

    return run_script


@pytest.mark.parametrize(
    ("name", "changes", "reason"),
    [
        ("train_lctg", {"train_data_dir": "recordings.h5"}, "is not a prepared data set"),
        ("train_dale", {"pretrained_model_name_or_path": "nope"}, "nope"),
        ("distill", {"pretrained_model_name_or_path": "nope", "model_config_name_or_path": None}, "nope"),
    ],
)
def test_bad_input_is_refused_in_one_line(refusal, prepared, tmp_path, name, changes, reason):
    folder = {"train_data_dir": prepared.parent, "pretrained_model_name_or_path": tmp_path}
    changes = {key: folder[key] / value if key in folder else value for key, value in changes.items()}
    line = refusal(name, tmp_path / "out", **changes)
    assert line.startswith(f"{name}.py: error: ") and reason in line
    assert name == "train_lctg" or not (tmp_path / "out").exists()


@pytest.mark.parametrize(("name", "value"), [("train_batch_size", 10**6), ("resume_from_checkpoint", "nope")])
def test_what_the_loop_cannot_take_is_refused_before_it(refusal, tmp_path, name, value):
    line = refusal("train_lctg", tmp_path / "out", **{name: value})
    assert line.startswith("train_lctg.py: error: ") and name in line and str(value) in line


@pytest.mark.skipif(fcntl is None, reason="needs flock")
@pytest.mark.parametrize("how", [{"overwrite_output_dir": True}, {"resume_from_checkpoint": "latest"}], ids=str)
def test_a_folder_in_which_another_process_trains(refusal, tmp_path, how):
    for name in ("unfinished-checkpoint-2", "checkpoint-1"):
        (tmp_path / name).mkdir()
    handle = os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)  # the kernel takes every other descriptor for another process's
    line = refusal("train_lctg", tmp_path, **how)
    os.close(handle)
    assert line.startswith(f"train_lctg.py: error: --output_dir {tmp_path} is in use: another process is writing")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["checkpoint-1", "unfinished-checkpoint-2"]


@pytest.mark.parametrize("error", [FileNotFoundError, ValueError])
def test_only_errors_of_the_start_are_refusals(error, capsys):
    def refusing():
        with starting():
            raise error("not\nso")

    with pytest.raises(SystemExit) as stopped:
        run(refusing)
    assert stopped.value.code == 2 and capsys.readouterr().err.endswith(": error: not so\n")

    def failing():
        with starting():
            pass
        raise error("a fault of ours")

    with pytest.raises(error, match="a fault of ours"):
        run(failing)


@pytest.mark.parametrize(
    ("flag", "gpu", "answer"), [(None, True, False), (None, False, True), ("true", True, True), ("false", True, False)]
)
def test_the_cpu_is_used_on_demand_and_where_there_is_no_gpu(flag, gpu, answer, monkeypatch):
    monkeypatch.delenv("ACCELERATE_USE_CPU", raising=False)
    if flag is not None:
        monkeypatch.setenv("ACCELERATE_USE_CPU", flag)
    monkeypatch.setattr(torch.accelerator, "is_available", lambda: gpu)
    assert on_cpu() is answer
