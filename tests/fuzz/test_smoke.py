"""The fuzzing harness works: good files are read, and a few hundred damaged ones break no promise."""

import subprocess
import sys
from pathlib import Path

import pytest


def test_every_seed_is_a_good_file(readers, tmp_path):
    for name, target in readers.TARGETS.items():
        for number, seed in enumerate(target.seeds()):
            folder = tmp_path / f"{name}-{number}"
            folder.mkdir()
            (folder / f"a{target.suffix}").write_bytes(target.pack(seed))
            target.read(folder / f"a{target.suffix}")


@pytest.mark.slow
def test_two_hundred_inputs_break_no_promise(tmp_path):
    pytest.importorskip("atheris")
    harness = Path(__file__).parent / "fuzz_readers.py"
    command = [sys.executable, harness, "all", "-runs=200", "-seed=1", f"-artifact_prefix={tmp_path}/"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=300)
    assert done.returncode == 0, done.stderr[-3000:]
