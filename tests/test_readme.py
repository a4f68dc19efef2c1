"""The README's Python runs as it stands there."""

import re
from pathlib import Path

import pytest

README = Path(__file__).parents[1] / "README.md"
BLOCKS = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL)


@pytest.mark.parametrize("code", BLOCKS, ids=range(len(BLOCKS)))
def test_blocks_run(code, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # what they write
    exec(compile(code, str(README), "exec"), {"__name__": "__main__"})  # as a script


def test_there_is_a_block_for_each_way_of_use():
    for name in ("TactileTexturePipeline", "TextureStream", "TextureScene"):
        assert any(name in code for code in BLOCKS)
