"""The one run of all figures: stale where weights changed, resumed where it was cut off."""

import json
import shlex
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "examples" / "results"))
import run

from tactile_diffusers import bundled_checkpoint
from tactile_diffusers.pipelines.folders import folder_digest


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "HERE", tmp_path)
    monkeypatch.setattr(run, "wait_until_idle", lambda: None)
    steps = {"one": run.Step("one.py", "{data}/one", ""), "two": run.Step("two.py --output {data}/two", "{data}/two")}
    monkeypatch.setattr(run, "STEPS", steps)
    return tmp_path


def test_figures_in_the_repository_are_of_the_bundled_weights():
    assert run.main(["--check"]) == 0


def test_figures_of_other_weights_are_found(elsewhere, capsys):
    digest = folder_digest(bundled_checkpoint())
    for found, code in ((digest, 0), ("0" * 64, 1)):
        (elsewhere / "run.json").write_text(json.dumps({"one": {"checkpoint": {"sha256": found}}}))
        assert run.main(["--check"]) == code
    assert "stale: one" in capsys.readouterr().out


def test_a_step_that_is_done_is_not_done_again_and_a_failed_one_ends_the_run(elsewhere, monkeypatch):
    calls, fails = [], {"two.py"}

    def call(words):
        calls.append(Path(words[1]).name)
        if calls[-1] not in fails:  # what fails and writes its figures all the same missed a bound: a result
            (elsewhere / "d" / Path(words[1]).stem).touch()
        return type("Done", (), {"returncode": int(calls[-1] in fails)})

    monkeypatch.setattr(run.subprocess, "run", lambda words, **_: call(words) if "git" not in words[0] else _git())
    assert run.main(["--data", str(elsewhere / "d")]) == 1 and calls == ["one.py", "two.py"]
    fails.clear()
    assert run.main(["--data", str(elsewhere / "d")]) == 0 and calls == ["one.py", "two.py", "two.py"]
    assert set(json.loads((elsewhere / "run.json").read_text())) == {"one", "two"}


def test_a_check_leaves_out_what_takes_long_and_writes_elsewhere(elsewhere, monkeypatch):
    calls = []

    def call(words, **_):
        if "git" in words[0]:
            return _git()
        calls.append(words[1].name)
        (elsewhere / "d" / "one").touch()
        return type("Done", (), {"returncode": 0})

    monkeypatch.setattr(run.subprocess, "run", call)
    assert run.main(["--quick", "--data", str(elsewhere / "d"), "--output", str(elsewhere / "o")]) == 0
    assert calls == ["one.py"] and (elsewhere / "o" / "run.json").is_file() and not (elsewhere / "run.json").exists()


def test_a_line_of_conditions_is_added_to_a_page_and_files_are_copied(elsewhere, monkeypatch):
    data = elsewhere / "d"
    step = run.Step("one.py", "{out}/shown/a.json", "", page="{out}/page.md", shown="{data}/work")
    monkeypatch.setattr(run, "STEPS", {"one": step})

    def call(words, **_):
        if "git" in words[0]:
            return _git()
        (data / "work" / "training").mkdir(parents=True)
        (data / "work" / "a.json").touch()
        (elsewhere / "page.md").write_text("A page.\n")
        return type("Done", (), {"returncode": 0})

    monkeypatch.setattr(run.subprocess, "run", call)
    assert run.main(["--data", str(data)]) == 0
    page = (elsewhere / "page.md").read_text()
    assert page.startswith("A page.\n\n*Checkpoint virtual-surfaces ") and "commit abc" in page
    assert [path.name for path in (elsewhere / "shown").iterdir()] == ["a.json"]


def _git():
    return type("Done", (), {"stdout": "abc"})


def test_every_step_is_a_command_that_is_there():
    for step in run.STEPS.values():
        for words in map(shlex.split, step.words.split("; ")):
            assert (run.EXAMPLES / words[0]).is_file()
