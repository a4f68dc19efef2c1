"""The console command: every command under one name, with the name that it was called by in its messages."""

import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

import tactile_diffusers_cli as entry
from tactile_diffusers.cli import generate
from tactile_diffusers.cli.program import Parser, add_checkpoint_argument, checkpoint_folder, checkpoint_name
from tactile_diffusers.version import __version__

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def called(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["tactile-diffusers"])


def test_usage_names_all_commands(capsys):
    assert entry.main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(f"  {name} " in text for name in entry.COMMANDS)
    assert entry.main([]) == 2 and capsys.readouterr().out == text
    assert entry.main(["--version"]) == 0 and capsys.readouterr().out.strip() == __version__
    assert entry.main(["knit"]) == 2 and "there is no command 'knit'" in capsys.readouterr().err


def test_help_does_not_import_torch():
    code = "import sys, tactile_diffusers_cli as c; c.main(['--help']); c.main(['--version']); c.main(['knit']); "
    code += "assert not {'torch', 'numpy', 'tactile_diffusers'} & set(sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.startswith("usage: tactile-diffusers COMMAND"), done.stderr


@pytest.mark.parametrize("name", entry.COMMANDS)
def test_help_of_every_command(name, capsys):
    with pytest.raises(SystemExit) as stop:
        entry.main([name, "--help"])
    assert stop.value.code == 0
    assert capsys.readouterr().out.startswith(f"usage: tactile-diffusers {name}")
    assert (ROOT / "examples" / f"{entry.COMMANDS[name][0].rpartition(':')[2]}.py").is_file()


def test_a_command_refuses_under_its_name(tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        entry.main(["generate", "--output", str(tmp_path)])
    assert stop.value.code == 2 and "tactile-diffusers generate: error: give either" in capsys.readouterr().err


def test_it_is_declared():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    module, _, function = project["project"]["scripts"]["tactile-diffusers"].partition(":")
    assert getattr(import_module(module), function) is entry.main
    assert module in project["tool"]["setuptools"]["py-modules"]


@pytest.mark.parametrize("spelling", ("--num-inference-steps=7", "--num_inference_steps=7"))
def test_hyphens_and_underscores_are_the_same(spelling, tmp_path):
    found = generate.parse_arguments(["--ratings", "1", "0", "none", "--output", str(tmp_path), spelling])
    assert found.num_inference_steps == 7 and found.ratings["slipperiness"] != found.ratings["slipperiness"]


def test_an_unknown_option_is_refused_as_it_was_written(tmp_path, capsys):
    with pytest.raises(SystemExit):
        generate.parse_arguments(["--ratings", "1", "0", "0", "--output", str(tmp_path), "--no_such-thing"])
    assert "unrecognized arguments: --no_such-thing" in capsys.readouterr().err


class TestCheckpoint:
    @pytest.fixture
    def parse(self):
        parser = Parser(prog="x")
        add_checkpoint_argument(parser)
        return lambda *words: parser.parse_args(words).checkpoint

    def test_a_folder_a_hub_id_or_bundled(self, parse, monkeypatch, tmp_path):
        assert parse() == parse("--checkpoint", "bundled")
        assert checkpoint_folder(parse()) == Path(parse()) and checkpoint_name(parse()) == "virtual-surfaces"
        assert parse("--checkpoint", str(tmp_path)) == str(tmp_path)
        assert checkpoint_name(parse("--checkpoint", "someone/textures")) == "someone/textures"
        monkeypatch.setattr("tactile_diffusers.TactileTexturePipeline.download", lambda name: str(tmp_path / name))
        assert checkpoint_folder("someone/textures") == tmp_path / "someone/textures"

    @pytest.mark.parametrize("word", ["nowhere", "./typo", "/a/b", "a/b/c"])
    def test_anything_else_is_refused(self, parse, word, capsys):
        with pytest.raises(SystemExit):
            parse("--checkpoint", word)
        told = capsys.readouterr().err
        assert f"argument --checkpoint: {word} is neither a folder, nor a Hub id (user/name), nor 'bundled'" in told
