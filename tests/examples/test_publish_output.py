"""Where `examples/publish.py` may write: what it replaces is set aside first, nothing that was given is replaced."""

import publish
import pytest


@pytest.fixture
def given(tmp_path):
    """A trained pipeline with its run, data and, beside them, what was published before."""
    run = tmp_path / "runs" / "dale"
    run.mkdir(parents=True)
    (run / "training.json").write_text("{}")
    (tmp_path / "prepared.h5").write_bytes(b"data")
    (tmp_path / "published").mkdir()
    (tmp_path / "published" / "README.md").write_text("older")
    (tmp_path / "published" / "model_index.json").write_text("{}")
    return tmp_path


def words(given, output):
    run = given / "runs" / "dale"
    return f"--checkpoint {run} --runs {run} --data {given / 'prepared.h5'} --output {output}".split()


@pytest.mark.parametrize("output", ["runs/dale", "runs", ".", "runs/../runs/dale", "prepared.h5"])
def test_what_was_given_is_not_replaced(given, capsys, output):
    with pytest.raises(SystemExit) as stop:
        publish.main(words(given, given / output))
    assert stop.value.code == 2 and "argument --output: " in capsys.readouterr().err
    assert (given / "runs/dale/training.json").is_file() and (given / "prepared.h5").read_bytes() == b"data"


@pytest.mark.parametrize("checkpoint", [False, True])
def test_a_folder_with_anything_else_is_not_replaced(given, capsys, checkpoint):
    """Results of years, or a training: it is a checkpoint with a card, too, but its log would be lost."""
    folder = given / "published"
    (folder / "log.jsonl").write_text("mine")
    if not checkpoint:
        (folder / "model_index.json").unlink()
    with pytest.raises(SystemExit) as stop:
        publish.main(words(given, folder))
    told = capsys.readouterr().err
    assert stop.value.code == 2 and f"--output: {folder} would be replaced" in told and "log.jsonl" in told
    assert "give a new folder, or move what is in it" in told and (folder / "log.jsonl").read_text() == "mine"


def test_what_appears_meanwhile_is_not_replaced(given, monkeypatch, capsys):
    folder = given / "published"
    monkeypatch.setattr(publish, "_fill", lambda *_: (folder / "mine.txt").write_text("mine"))
    assert publish.main(words(given, folder)) == 2
    assert "mine.txt" in capsys.readouterr().err and (folder / "mine.txt").is_file() and not list(given.glob(".*"))


@pytest.mark.parametrize("fails", ["before", "while it is put in place"])
def test_after_a_failure_what_was_published_is_there(given, monkeypatch, capsys, fails):
    def fill(_, folder):
        (folder / "README.md").write_text("new")
        if fails == "before":
            raise ValueError("does not fit")

    replace = publish.os.replace

    def refuse_new(source, target):
        if fails != "before" and str(source).endswith(".tmp"):
            raise PermissionError("somebody has it open")
        replace(source, target)

    monkeypatch.setattr(publish, "_fill", fill)
    monkeypatch.setattr(publish.os, "replace", refuse_new)
    assert publish.main(words(given, given / "published")) == 2
    assert capsys.readouterr().err.startswith("publish.py: error: ")
    assert (given / "published/README.md").read_text() == "older"
    assert not list(given.glob(".*"))


def test_a_link_stays_one_and_what_a_kill_left_is_cleared(given, monkeypatch):
    (given / "link").symlink_to("published")
    (given / ".published.123.tmp").mkdir()
    monkeypatch.setattr(publish, "_fill", lambda _, folder: (folder / "README.md").write_text("new"))
    assert publish.main(words(given, given / "link")) == 0
    assert (given / "link").is_symlink() and (given / "published/README.md").read_text() == "new"
    assert not list(given.glob(".*"))
