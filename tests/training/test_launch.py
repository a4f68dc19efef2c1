"""How training scripts start: refusals in one line with exit code 2, later errors with their traceback, the device."""

import subprocess
import sys
from pathlib import Path

import pytest
import torch

from tactile_diffusers.io.locks import fcntl, locked_folder
from tactile_diffusers.training.launch import on_cpu, run, starting

EXAMPLES = Path(__file__).parents[2] / "examples"


def _refusal(script, words):
    """The last line that a script writes on stderr when it refuses to start."""
    done = subprocess.run([sys.executable, str(EXAMPLES / script), *words], capture_output=True, text=True, timeout=240)
    assert done.returncode == 2 and "Traceback" not in done.stderr, done.stderr
    return done.stderr.strip().splitlines()[-1]


@pytest.mark.parametrize(
    ("name", "changes", "reason"),
    [
        ("train_lctg", {"train_data_dir": "recordings.h5"}, "is not a prepared data set"),
        ("train_dale", {"pretrained_model_name_or_path": "nope"}, "nope"),
        ("distill_lctg", {"pretrained_model_name_or_path": "nope", "model_config_name_or_path": None}, "nope"),
    ],
)
def test_bad_input_is_refused_in_one_line(
    script, options_of_a_tiny_training, prepared, tmp_path, monkeypatch, capsys, name, changes, reason
):
    folder = {"train_data_dir": prepared.parent, "pretrained_model_name_or_path": tmp_path}
    changes = {key: folder[key] / value if key in folder else value for key, value in changes.items()}
    stage = "dale" if name == "train_dale" else "lctg"
    words = options_of_a_tiny_training(stage, tmp_path / "out", **changes)
    monkeypatch.setattr(sys, "argv", [f"{name}.py", *words])
    with pytest.raises(SystemExit) as stop:
        run(script(name).main)
    line = capsys.readouterr().err.strip().splitlines()[-1]
    assert stop.value.code == 2 and line.startswith(f"{name}.py: error: ") and reason in line
    assert name == "train_lctg" or not (tmp_path / "out").exists()


@pytest.mark.skipif(fcntl is None, reason="needs flock")
def test_a_folder_in_which_another_process_trains(options_of_a_tiny_training, tmp_path):
    output = tmp_path / "out"
    output.mkdir()
    for name in ("unfinished-checkpoint-2", "checkpoint-1"):
        (output / name).mkdir()
    with locked_folder(output):
        for how in ("--overwrite_output_dir", "--resume_from_checkpoint=latest"):
            line = _refusal("train_lctg.py", [*options_of_a_tiny_training("lctg", output), how])
            assert line.startswith(f"train_lctg.py: error: --output_dir {output} is in use: another process is writing")
    assert sorted(path.name for path in output.iterdir()) == ["checkpoint-1", "unfinished-checkpoint-2"]


@pytest.mark.parametrize("error", [ImportError, FileNotFoundError, ValueError])
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
