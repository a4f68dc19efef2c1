"""Shards of generated textures: what is written is read back, and nothing half-written passes for whole."""

import json

import h5py
import numpy as np
import pytest

from tactile_diffusers.export import read_generated
from tactile_diffusers.export.generated import open_folder, write_shard

SETTINGS = {"num_textures": 7, "textures_per_shard": 3, "seed": 0, "sampling_rate": 10_000, "duration_s": None}


def _columns(rows):
    rows = np.asarray(rows)
    return {"textures": np.outer(rows, np.ones(5)).astype(np.float32), "seed": 10 * rows.astype(np.int64)}


def _write(folder, shard):
    rows = np.arange(shard["first"], shard["first"] + shard["count"])
    write_shard(folder / shard["file"], shard["count"], SETTINGS, [_columns(rows[:2]), _columns(rows[2:])])


@pytest.fixture
def folder(tmp_path):
    for shard in open_folder(tmp_path / "set", SETTINGS, {"ratings": "none"}):
        _write(tmp_path / "set", shard)
    return tmp_path / "set"


@pytest.mark.parametrize("index", [0, -1, slice(None), slice(2, 5), slice(6, 0, -2), [5, 0, 5, 2], [], [True] * 7])
def test_rows_are_read_as_from_one_array(folder, index):
    data, expected = read_generated(folder), np.outer(np.arange(7), np.ones(5)).astype(np.float32)
    assert data.shape == (7, 5) and len(data) == 7 and data.dtype == np.float32 and data.sampling_rate == 10_000
    index = np.array(index, dtype=int) if index == [] else index
    np.testing.assert_array_equal(data[index], expected[index])
    assert data[index].dtype == np.float32


def test_columns_and_iteration(folder):
    data = read_generated(folder)
    assert [row[0] for row in data] == list(range(7))
    assert data.column("seed").tolist() == [0, 10, 20, 30, 40, 50, 60]
    with pytest.raises(ValueError, match=r"\['seed', 'textures'\], got 'level'"):
        data.column("level")
    with h5py.File(folder / "textures-00001.h5") as file:
        assert file["textures"].attrs["unit"] == "N"
        assert file.attrs["seed"] == 0 and file.attrs["duration_s"] == "none"


def test_missing_and_truncated_shards_are_made_again_and_temporary_files_go(folder):
    assert open_folder(folder, SETTINGS, {}) == []
    (folder / "textures-00000.h5").unlink()
    whole = (folder / "textures-00001.h5").read_bytes()
    (folder / "textures-00001.h5").write_bytes(whole[: len(whole) // 2])
    (folder / ".textures-00002.h5.123.tmp").write_bytes(b"half")
    assert [shard["first"] for shard in open_folder(folder, SETTINGS, {})] == [0, 3]
    assert not list(folder.glob(".*"))
    with pytest.raises(ValueError, match="1 of 3 shards are missing .* textures-00000.h5"):
        read_generated(folder)


def test_other_settings_are_refused_by_name(folder):
    before = {path: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(ValueError, match=r"other settings \(seed 0, not 4; duration_s None, not 2.0\)"):
        open_folder(folder, {**SETTINGS, "seed": 4, "duration_s": 2.0}, {})
    assert before == {path: path.read_bytes() for path in folder.iterdir()}


def test_foreign_folders_are_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(ValueError, match="not empty and holds no generated textures"):
        open_folder(tmp_path, SETTINGS, {})
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    with pytest.raises(FileNotFoundError, match="manifest.json"):
        read_generated(tmp_path)
    for text in ("{", "[]", json.dumps({"format": "x", "version": 1})):
        (tmp_path / "manifest.json").write_text(text)
        with pytest.raises(ValueError, match="manifest"):
            read_generated(tmp_path)


@pytest.mark.parametrize("rows", [2, 4])
def test_a_shard_of_another_size_is_not_written(tmp_path, rows):
    with pytest.raises(ValueError, match=f"hold {rows} rows, not 3"):
        write_shard(tmp_path / "a.h5", 3, {}, [_columns(np.arange(rows))])
    assert not list(tmp_path.iterdir())
