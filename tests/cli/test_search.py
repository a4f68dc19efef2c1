"""The command search: answers in, the next pair and the best out."""

import json

import pytest

from tactile_diffusers.cli.search import main
from tactile_diffusers.export import read_npz


@pytest.fixture
def search(make_pipeline, tmp_path, monkeypatch):
    """A function of further words: one call of the command in tmp_path."""
    pipe = make_pipeline(dale_config={"scalar_width": 16, "distilled_steps": 1})
    pipe.save_pretrained(str(tmp_path / "pipeline"))
    monkeypatch.chdir(tmp_path)
    return lambda words="": main(f"--search s.json --output out --checkpoint pipeline {words}".split())


def _pair():
    """Ratings of the two, as text: NaN is like NaN."""
    return str([read_npz(f"out/{name}.npz")[1]["ratings"] for name in ("first", "second")])


def test_a_search_from_answers_in_a_file(search, tmp_path, capsys):
    assert search("--axes roughness bumpiness --directions 1 --seed 4") == 0
    assert "0 answers" in capsys.readouterr().out
    before = _pair()
    assert search("--answer second") == 0
    assert _pair() != before and "direction 1" in capsys.readouterr().out
    (tmp_path / "words.txt").write_text("first\nneither\n")
    assert search("--answers words.txt") == 0
    content = json.loads((tmp_path / "s.json").read_text())
    assert [entry["answer"] for entry in content["answers"]] == ["second", "first", "neither"]
    assert content["seed"] == 4 and content["axes"] == ["roughness", "bumpiness"]
    assert {path.stem for path in (tmp_path / "out").glob("*.wav")} == {"first", "second", "best"}
    # the same words from the beginning come to the same pair
    reached = _pair()
    (tmp_path / "words.txt").write_text("second first neither")
    (tmp_path / "s.json").unlink()
    assert search("--axes roughness bumpiness --directions 1 --seed 4 --answers words.txt") == 0
    assert _pair() == reached


def test_bad_answers_and_files_lose_nothing(search, tmp_path, capsys):
    assert search() == 0
    before = (tmp_path / "s.json").read_bytes()
    (tmp_path / "words.txt").write_text("first both")
    assert search("--answers words.txt") == 2 and "`answer` must be one of" in capsys.readouterr().err
    assert (tmp_path / "s.json").read_bytes() == before
    (tmp_path / "s.json").write_text("{")
    assert search() == 2 and "s.json cannot be read as a preference search" in capsys.readouterr().err
    assert (tmp_path / "s.json").read_text() == "{"
    assert main(["--search", str(tmp_path / "no" / "s.json"), "--output", str(tmp_path / "out")]) == 2
