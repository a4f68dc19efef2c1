"""The Python of README.md and examples/README.md runs as it stands there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BLOCKS = {
    f"{name}-{number}": code
    for name in ("README.md", "examples/README.md")
    for number, code in enumerate(re.findall(r"```python\n(.*?)```", (ROOT / name).read_text(encoding="utf-8"), re.S))
}


@pytest.mark.parametrize("name", BLOCKS)
def test_blocks_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # what they write
    exec(compile(BLOCKS[name], name, "exec"), {"__name__": "__main__"})  # as a script


@pytest.mark.parametrize(
    "name",
    [
        "TactileTexturePipeline",
        "TactileTextureEditPipeline",
        "TextureStream",
        "EndlessStream",
        "TextureScene",
        "fit_drive_profile",
    ],
)
def test_there_is_a_block_for_each_way_of_use(name):
    assert any(name in code for code in BLOCKS.values())
