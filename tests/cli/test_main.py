"""The entry point: every command under one name, with the name that it was called by in its messages."""

import importlib.metadata
import subprocess
import sys
from pathlib import Path

import pytest

from tactile_diffusers.cli import generate
from tactile_diffusers.cli import main as entry
from tactile_diffusers.version import __version__


@pytest.fixture(autouse=True)
def called(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["tactile-diffusers"])


def test_usage_names_all_commands(capsys):
    assert entry.main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(f"  {name} " in text for name in entry.COMMANDS)
    assert entry.main([]) == 2 and capsys.readouterr().out == text
    assert entry.main(["--version"]) == 0 and capsys.readouterr().out.strip() == __version__


def test_an_unknown_command(capsys):
    assert entry.main(["knit"]) == 2
    assert "there is no command 'knit'" in capsys.readouterr().err


@pytest.mark.parametrize("name", entry.COMMANDS)
def test_help_of_every_command(name, capsys):
    with pytest.raises(SystemExit) as stop:
        entry.main([name, "--help"])
    assert stop.value.code == 0
    assert capsys.readouterr().out.startswith(f"usage: tactile-diffusers {name}")


def test_a_command_refuses_under_its_name(tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        entry.main(["generate", "--output", str(tmp_path)])
    assert stop.value.code == 2 and "tactile-diffusers generate: error: give either" in capsys.readouterr().err


def test_it_is_installed():
    (script,) = importlib.metadata.entry_points(group="console_scripts", name="tactile-diffusers")
    assert script.load() is entry.main


def test_every_command_has_a_script_beside_it():
    root = Path(__file__).parents[2]
    for module, _ in entry.COMMANDS.values():
        assert (root / "examples" / f"{module.split('.')[0]}.py").is_file()


def test_as_a_process():
    done = subprocess.run(
        [sys.executable, "-m", "tactile_diffusers.cli.main", "--help"], capture_output=True, text=True
    )
    assert done.returncode == 0 and done.stdout.startswith("usage: tactile-diffusers COMMAND")


@pytest.mark.parametrize("spelling", ("--latent-steps=7", "--latent_steps=7"))
def test_hyphens_and_underscores_are_the_same(spelling, tmp_path):
    found = generate.parse_arguments(["--ratings", "1", "0", "none", "--output", str(tmp_path), spelling])
    assert found.latent_steps == 7 and found.ratings[2] != found.ratings[2]


def test_a_word_that_no_spelling_makes_an_option_is_refused_as_it_was_written(tmp_path, capsys):
    with pytest.raises(SystemExit):
        generate.parse_arguments(["--ratings", "1", "0", "0", "--output", str(tmp_path), "--no_such-thing"])
    assert "unrecognized arguments: --no_such-thing" in capsys.readouterr().err
