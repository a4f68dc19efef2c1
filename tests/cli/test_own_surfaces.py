"""README's way from a folder of recordings to a pipeline that knows its surfaces, command by command."""

import importlib
import re
import shlex
import shutil
from pathlib import Path

from export_folder import export_folder

from tactile_diffusers import TactileTexturePipeline

README = Path(__file__).parents[2] / "README.md"


def test_three_commands_lead_from_a_folder_to_a_pipeline(virtual_recordings, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    section = README.read_text(encoding="utf-8").split("## Your own surfaces")[1]
    commands = re.findall(r"^    python examples/(\w+)\.py (.*)$", section.split("With hundreds")[0], re.M)
    assert [name for name, _ in commands] == ["prepare_data", "prepare_data", "adapt"]
    export_folder(virtual_recordings, tmp_path / "my_folder", quiet=True)
    for name, words in commands:
        assert not importlib.import_module(f"tactile_diffusers.cli.{name}").main(shlex.split(words)), (
            capsys.readouterr()
        )
        if "--draft" in words:
            assert "roughness" in Path("layout.toml").read_text()
            shutil.copy("my_folder/layout.toml", "layout.toml")  # a person fills in what the draft leaves open
    assert "surfaces left out" in capsys.readouterr().out
    assert TactileTexturePipeline.from_pretrained("adapted").dale.config.calibration
