"""`benchmark.py --suite training`: README's own commands, and the memory of a tree of processes."""

import argparse
import subprocess
import sys
from pathlib import Path

import pytest
import training_time as suite

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("command", (suite.PREPARE, suite.LCTG, suite.DALE))
def test_the_commands_are_those_of_readme(command):
    assert f"examples/{command}\n" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_memory_counts_what_a_command_starts(tmp_path):
    hold = "import time; held = bytearray(100 * 2**20); time.sleep(1.5)"
    alone = suite.watched([sys.executable, "-c", hold], tmp_path)[1]
    child = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {hold!r}])"
    both = suite.watched([sys.executable, "-c", child], tmp_path)[1]
    assert 100 < alone < 160  # MiB: what it holds and Python itself
    assert alone < both < alone + 40


def test_memory_of_a_process_that_has_ended():
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    assert suite.memory(process.pid) != suite.memory(process.pid)  # NaN


def test_a_command_that_fails(tmp_path):
    with pytest.raises(RuntimeError, match="no such option"):
        suite.watched([sys.executable, "-c", "raise SystemExit('no such option')"], tmp_path)


def test_scripts_are_not_here(tmp_path):
    with pytest.raises(ValueError, match="has no train_lctg.py: run examples/benchmarks/benchmark.py"):
        suite.run(argparse.Namespace(scripts=tmp_path, output=tmp_path, surfaces=8), None)
