"""`inspect_data.py`: what it prints and writes, and how it refuses."""

import pytest
from inspect_data import main

from tactile_diffusers.data import prepare_recordings
from tactile_diffusers.virtual import generate_recordings


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    generate_recordings(folder / "r.h5", surfaces=4, seconds=10, explorers=1, seed=2, quiet=True)
    prepare_recordings(folder / "r.h5", folder / "p.h5", validation=1, test=1, quiet=True)
    return folder


def test_card(files, tmp_path, capsys):
    arguments = f"--recordings {files}/r.h5 --prepared {files}/p.h5 --output {tmp_path}/card"
    assert main(f"{arguments} --quiet".split()) == 0
    printed = capsys.readouterr()
    assert "one_explorer" in printed.out and f"wrote {tmp_path}/card/card.md" in printed.out and not printed.err
    assert "| source | virtual surfaces |" in (tmp_path / "card/card.md").read_text()
    assert (tmp_path / "card/surfaces.png").is_file()


def test_without_prepared_the_default_limits_are_used_and_told(files, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("data_card.writing._draw", lambda *_: [])  # slow, and tested elsewhere
    assert main(f"--recordings {files}/r.h5 --output {tmp_path}/card --quiet".split()) == 0
    assert "default limits" in capsys.readouterr().out
    assert "default limits" in (tmp_path / "card/card.md").read_text()
    assert [path.name for path in tmp_path.iterdir()] == ["card"]
    assert not list((tmp_path / "card").glob("*.h5"))


@pytest.mark.parametrize(
    "flags, message",
    [
        ("--recordings {tmp}/no.h5 --output {tmp}/card", "is not a file"),
        ("--recordings {files}/r.h5 --prepared {tmp}/no.h5 --output {tmp}/card", "is not a file"),
        ("--recordings {files}/r.h5", "--output"),
    ],
)
def test_bad_arguments(files, tmp_path, capsys, flags, message):
    with pytest.raises(SystemExit) as exit_info:
        main(flags.format(files=files, tmp=tmp_path).split())
    assert exit_info.value.code == 2 and message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "flags, message",
    [
        ("--recordings {files}/p.h5 --output {tmp}/card", "instead of 'tactile-recordings'"),
        ("--recordings {files}/r.h5 --prepared {files}/r.h5 --output {tmp}/card", "is not a prepared data set"),
        ("--recordings {files}/r.h5 --output {tmp}/no/card", "create it first"),
        ("--recordings {files}/r.h5 --output {files}", "which no data card wrote"),
    ],
)
def test_bad_files(files, tmp_path, capsys, flags, message):
    assert main(flags.format(files=files, tmp=tmp_path).split() + ["--quiet"]) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("inspect_data.py: error:") and message in printed.err
    assert "Traceback" not in printed.err and "default limits" not in printed.err  # they are not at fault
    assert not list(tmp_path.iterdir())
