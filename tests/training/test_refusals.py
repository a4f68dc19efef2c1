"""How training scripts refuse to start: one line and exit code 2; what comes later keeps its traceback."""

import subprocess
import sys
from pathlib import Path

import pytest

from tactile_diffusers.io.locks import fcntl, locked_folder
from tactile_diffusers.training.refusals import run, starting

EXAMPLES = Path(__file__).parents[2] / "examples"


def _stopped(script, words):
    done = subprocess.run([sys.executable, str(EXAMPLES / script), *words], capture_output=True, text=True, timeout=240)
    told = done.stderr.strip().splitlines()[-1]
    assert done.returncode == 2 and "Traceback" not in done.stderr, done.stderr
    return told


def test_wrong_data_are_told_in_one_line(options_of_a_tiny_training, prepared, tmp_path):
    recordings = prepared.with_name("recordings.h5")
    told = _stopped("train_lctg.py", options_of_a_tiny_training("lctg", tmp_path / "out", train_data_dir=recordings))
    assert told.startswith("train_lctg.py: error: ") and "is no prepared data set" in told


def test_a_missing_model_is_told_in_one_line(options_of_a_tiny_training, tmp_path):
    changes = {"pretrained_model_name_or_path": tmp_path / "nope"}
    told = _stopped("train_dale.py", options_of_a_tiny_training("dale", tmp_path / "out", **changes))
    assert told.endswith(f"--pretrained_model_name_or_path: there is no folder {tmp_path / 'nope'}.")
    assert not (tmp_path / "out").exists()


def test_distilling_refuses_in_one_line_too(options_of_a_tiny_training, tmp_path):
    changes = {"pretrained_model_name_or_path": tmp_path / "nope", "model_config_name_or_path": None}
    words = options_of_a_tiny_training("lctg", tmp_path / "out", **changes)
    told = _stopped("distill_lctg.py", words)
    assert told == (f"distill_lctg.py: error: --pretrained_model_name_or_path: there is no folder {tmp_path / 'nope'}.")
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(fcntl is None, reason="needs flock")
def test_a_folder_in_which_another_process_trains(options_of_a_tiny_training, tmp_path):
    output = tmp_path / "out"
    output.mkdir()
    for name in ("unfinished-checkpoint-2", "checkpoint-1"):
        (output / name).mkdir()
    with locked_folder(output):
        for how in ("--overwrite_output_dir", "--resume_from_checkpoint=latest"):
            told = _stopped("train_lctg.py", [*options_of_a_tiny_training("lctg", output), how])
            assert told.startswith(f"train_lctg.py: error: --output_dir {output} is in use: another process is writing")
    assert sorted(path.name for path in output.iterdir()) == ["checkpoint-1", "unfinished-checkpoint-2"]


@pytest.mark.parametrize("error", [ImportError, FileNotFoundError, ValueError])
def test_only_the_start_is_refused_in_one_line(error, capsys):
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
