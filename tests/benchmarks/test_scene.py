"""The benchmark of a scene: every figure is there and belongs to what it says; how large it is, no test tells."""

import contextlib
import io
import json

import pytest
import scene as benchmark_scene
from benchmarking import run_child


@pytest.fixture
def checkpoint(pipe, tmp_path):
    pipe.save_pretrained(str(tmp_path / "pipeline"))
    return tmp_path / "pipeline"


def _in_this_process(code, *arguments):
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        benchmark_scene.child(*arguments)
    return printed.getvalue(), 100.0


@pytest.fixture
def command(checkpoint, tmp_path):
    words = f"--checkpoint {checkpoint} --surfaces 5 --repeats 1 --output {tmp_path / 'out'}"
    return words.split()


def test_the_suite_writes_its_tables(command, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(benchmark_scene, "run_child", _in_this_process)
    assert benchmark_scene.main(command) == 0
    report = json.loads((tmp_path / "out" / "scene.json").read_text())
    assert (report["surfaces"], report["touched"]) == (5, 3) and set(report["cases"]) == set(benchmark_scene.CASES)
    for case in ("scene", "scene from a file"):
        row = report["cases"][case]
        assert 0 < row["latents s"] < row["first profile s"] < row["all wanted s"]
    assert "latents s" not in report["cases"]["all decoded"] and report["cases"]["all decoded"]["all wanted s"] > 0
    assert report["file"]["kB per surface"] == pytest.approx(report["file"]["kB"] / 5)
    text = (tmp_path / "out" / "scene.md").read_text()
    assert "scene from a file, 3 touched" in text and text.strip() == capsys.readouterr().out.strip()


def test_what_fails_in_a_child_is_told():
    assert run_child("import sys; print(sys.argv[1])", "word")[0] == "word"
    with pytest.raises(RuntimeError, match="no such thing"):
        run_child("raise ValueError('no such thing')")
