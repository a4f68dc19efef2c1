"""Generated textures in Parquet: read back, also by others, and nothing half-written passes for whole."""

import json
import sys

import numpy as np
import pytest
from dataset.card import licence_of, write_card
from dataset.shards import open_folder, write_shard

from tactile_diffusers.export import read_generated

SETTINGS = {"num_textures": 7, "textures_per_shard": 3, "seed": 0, "sampling_rate": 10_000, "duration_s": None}
ABOUT = {"checkpoint": "a", "rating_axes": ["roughness", "bumpiness"], "license": "cc-by-4.0"}
FILES = [f"train-0000{number}-of-00003.parquet" for number in range(3)]


def _columns(rows):
    rows = np.asarray(rows)
    textures, ratings = np.outer(rows, np.ones(5)), np.where(rows == 4, np.nan, rows)
    numbers = {"roughness": ratings, "bumpiness": -rows, "level": rows / 10, "friction_coefficient": ratings}
    found = {name: values.astype(np.float32) for name, values in ({"texture": textures} | numbers).items()}
    return found | {"seed": 10 * rows.astype(np.int64)}


def _write(folder, shard):
    rows = np.arange(shard["first"], shard["first"] + shard["count"])
    write_shard(folder / shard["file"], shard["count"], SETTINGS, ABOUT, [_columns(rows[:2]), _columns(rows[2:])])


@pytest.fixture
def folder(tmp_path):
    for shard in open_folder(tmp_path / "set", SETTINGS):
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
    expected = np.float32([[0, 1, 2, 3, np.nan, 5, 6], -np.arange(7)]).T
    np.testing.assert_array_equal(data.column("ratings"), expected)
    np.testing.assert_array_equal(data.column("friction_coefficient"), expected[:, 0])
    assert data.column("ratings").dtype == data.column("level").dtype == np.float32
    with pytest.raises(ValueError, match="'bumpiness', 'level', .*, got 'slipperiness'"):
        data.column("slipperiness")


def test_other_programs_find_types_and_units(folder):
    pq = pytest.importorskip("pyarrow.parquet")
    schema = pq.read_schema(folder / "data" / FILES[1])
    numbers = dict.fromkeys(("roughness", "bumpiness", "level", "friction_coefficient"), "float")
    types = {"texture": "list<element: float>", **numbers, "seed": "int64"}
    assert {field.name: str(field.type) for field in schema} == types
    facts = json.loads(schema.metadata[b"tactile_diffusers"])
    assert facts["units"] == {"texture": "N", "level": "natural log of the RMS in N", "friction_coefficient": "1"} | {
        "roughness": "z-score",
        "bumpiness": "z-score",
    }
    assert facts["settings"] == SETTINGS and facts["about"] == ABOUT
    assert pq.read_table(folder / "data")["roughness"].null_count == 1  # not specified


def test_datasets_loads_the_folder(folder, tmp_path):
    datasets = pytest.importorskip("datasets")
    write_card(folder, SETTINGS, ABOUT)
    data = datasets.load_dataset(str(folder), split="train", cache_dir=str(tmp_path / "cache"))
    numbers = dict.fromkeys(("roughness", "bumpiness", "level", "friction_coefficient"), datasets.Value("float32"))
    types = {"texture": datasets.List(datasets.Value("float32")), **numbers, "seed": datasets.Value("int64")}
    assert dict(data.features) == types and data[4]["roughness"] is None
    arrays, ours = data.with_format("numpy")[:], read_generated(folder)
    np.testing.assert_array_equal(arrays["texture"], ours[:])
    np.testing.assert_array_equal(arrays["seed"], ours.column("seed"))
    (folder / "data" / FILES[2]).unlink()
    with pytest.raises(datasets.exceptions.NonMatchingSplitsSizesError):  # as its card says
        datasets.load_dataset(str(folder), cache_dir=str(tmp_path / "another"))


def test_the_card_is_written_once(folder):
    write_card(folder, SETTINGS, ABOUT)
    card = (folder / "README.md").read_text()
    assert card.startswith("---\nlicense: cc-by-4.0\npretty_name: set\n") and "    num_examples: 7\n" in card
    assert "| duration_s | none |" in card and "(`roughness`, `bumpiness`;" in card and "license |" not in card
    assert licence_of(folder) == {"license": "cc-by-4.0"} and licence_of(folder / "data") == {}
    (folder / "README.md").write_text("mine")
    write_card(folder, SETTINGS, ABOUT)
    assert (folder / "README.md").read_text() == "mine" and licence_of(folder) == {}
    (folder / "README.md").write_text("---\n{\n---\n")
    with pytest.raises(ValueError, match="README.md"):
        licence_of(folder)


def test_missing_and_truncated_shards_are_made_again_and_temporary_files_go(folder):
    assert open_folder(folder, SETTINGS) == []
    (folder / "data" / FILES[0]).unlink()
    whole = (folder / "data" / FILES[1]).read_bytes()
    (folder / "data" / FILES[1]).write_bytes(whole[: len(whole) // 2])
    (folder / "data" / f".{FILES[2]}.123.tmp").write_bytes(b"half")
    (folder / ".README.md.123.tmp").write_bytes(b"half")
    assert [shard["first"] for shard in open_folder(folder, SETTINGS)] == [0, 3]
    assert not list(folder.rglob(".*"))
    (folder / "data" / FILES[1]).write_bytes(whole)
    with pytest.raises(ValueError, match=f"{FILES[0]} is missing: run the command"):
        read_generated(folder)


def test_other_settings_are_refused_by_name(folder):
    before = {path: path.read_bytes() for path in folder.glob("data/*")}
    with pytest.raises(ValueError, match=r"other settings \(seed 0, not 4; duration_s None, not 2.0\)"):
        open_folder(folder, {**SETTINGS, "seed": 4, "duration_s": 2.0})
    assert before == {path: path.read_bytes() for path in folder.glob("data/*")}


@pytest.mark.parametrize("name", ["notes.txt", f"data/{FILES[0]}"])
def test_foreign_folders_are_refused(tmp_path, name):
    (tmp_path / "data").mkdir()
    (tmp_path / name).write_text("mine")
    with pytest.raises(ValueError, match="not empty and holds no generated textures"):
        open_folder(tmp_path, SETTINGS)
    assert (tmp_path / name).read_text() == "mine"
    with pytest.raises((FileNotFoundError, ValueError), match="data/train-"):
        read_generated(tmp_path)


@pytest.mark.parametrize("rows", [2, 4])
def test_a_shard_of_another_size_is_not_written(tmp_path, rows):
    with pytest.raises(ValueError, match=f"hold {rows} rows, not 3"):
        write_shard(tmp_path / "a.parquet", 3, {}, ABOUT, [_columns(np.arange(rows))])
    assert not list(tmp_path.iterdir())


def test_without_pyarrow_one_line_names_the_extra(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(ValueError, match=r'Parquet files need pyarrow: pip install "tactile-diffusers\[parquet\]"'):
        read_generated(folder)
