"""The benchmark of training: the commands of the documentation, and the memory of a tree of processes."""

import subprocess
import sys
from pathlib import Path

import pytest
import training_time

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("command", (training_time.PREPARE, training_time.LCTG, training_time.DALE))
def test_the_commands_are_those_of_the_documentation(command):
    assert f"examples/{command}\n" in (ROOT / "examples" / "README.md").read_text(encoding="utf-8")


def test_memory_counts_what_a_command_starts(tmp_path):
    hold = "import time; held = bytearray(100 * 2**20); time.sleep(0.8)"
    alone = training_time.watched([sys.executable, "-c", hold], tmp_path)[1]
    child = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {hold!r}])"
    both = training_time.watched([sys.executable, "-c", child], tmp_path)[1]
    assert 100 < alone < 160  # MiB: what it holds and Python itself
    assert alone < both < alone + 40


def test_memory_of_a_process_that_has_ended():
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    assert training_time.memory(process.pid) != training_time.memory(process.pid)  # NaN


def test_a_command_that_fails(tmp_path):
    with pytest.raises(RuntimeError, match="no such option"):
        training_time.watched([sys.executable, "-c", "raise SystemExit('no such option')"], tmp_path)
