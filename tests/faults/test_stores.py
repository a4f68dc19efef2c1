"""Recordings, prepared data, generated textures and scenes: the files that this package makes for itself."""

import h5py
import numpy as np
import pytest

from tactile_diffusers.data import PreparedDataset, RecordingsFile, RecordingsWriter, prepare_recordings
from tactile_diffusers.export import read_generated
from tactile_diffusers.export.generated import open_folder, plan_shards, write_shard
from tactile_diffusers.playback import TextureScene
from tactile_diffusers.virtual import generate_recordings

SETTINGS = {"num_textures": 5, "textures_per_shard": 3, "seed": 0, "sampling_rate": 10_000, "duration_s": None}


@pytest.fixture(scope="module")
def stores(tmp_path_factory):
    """Recordings of virtual surfaces, short ones of noise for bit flips, and the prepared file of the first."""
    folder = tmp_path_factory.mktemp("stores")
    virtual = folder / "virtual" / "recordings.h5"
    virtual.parent.mkdir()
    generate_recordings(virtual, surfaces=4, seconds=6, explorers=1, seed=3, quiet=True)
    prepared = folder / "prepared" / "prepared.h5"
    prepared.parent.mkdir()
    prepare_recordings(virtual, prepared, validation=1, test=1, quiet=True)
    short = folder / "short" / "recordings.h5"
    short.parent.mkdir()
    force = 0.3 + 0.01 * np.random.default_rng(0).standard_normal(5000)
    with RecordingsWriter(short, source="a test", licence="CC0-1.0") as writer:
        for surface in ("a", "b"):
            writer.add_recording(surface, "0", "0", lateral=force, lateral_rate=2500)
        writer.set_ratings(np.full((2, 2, 3), 4.0), ["r", "s"], ["a", "b"], ["roughness", "bumpiness", "slipperiness"])
    return {"recordings": short, "prepared": prepared}


def _recordings(path):
    with RecordingsFile(path) as file:
        found = [part for one in file for part in (one.force, one.lateral, one.velocity) if part is not None]
        ratings = [] if file.ratings is None else [np.nan_to_num(file.ratings.values)]
    return found + ratings


def _prepared(path):
    data = PreparedDataset(path, "all")
    first = data[0]
    return [
        data.textures(np.arange(len(data))),
        data.levels,
        first["texture"].numpy(),
        data.seconds_by_reason().to_numpy(),
    ]


READERS = {"recordings": _recordings, "prepared": _prepared}


def _sane(arrays):
    """NaN stands for what was not measured or is unknown; infinity never comes through."""
    return all(not np.isinf(array).any() for array in arrays if array.dtype.kind == "f")


@pytest.fixture(params=READERS)
def case(request, stores, damaged):
    return damaged(stores[request.param], READERS[request.param], sane=_sane)


def test_damage(case, flips, foreign, stores):
    others = [path.read_bytes() for path in stores.values() if path.name != case.path.name]
    case.damage(flips, [*foreign.values(), *others])


@pytest.mark.parametrize(
    "values",
    [(None,), pytest.param((None, "word", np.float32(np.inf), np.zeros((2, 3)), np.zeros(0)), marks=pytest.mark.slow)],
    ids=["missing", "odd"],
)
def test_a_place_is_missing_or_of_another_kind(case, refusal, values):
    """Every group, dataset and attribute in turn; of many recordings alike the first."""
    places = []
    with h5py.File(case.path) as file:
        file.visititems(lambda name, node: places.append((name, None)))
        places += [("/", name) for name in file.attrs]
        file.visititems(lambda name, node: places.extend((name, attribute) for attribute in node.attrs))
    for name, attribute in places:
        for odd in values:
            case.fresh()
            with h5py.File(case.path, "r+") as file:
                if attribute is not None:
                    del file[name].attrs[attribute]
                    if odd is not None:
                        file[name].attrs[attribute] = odd
                else:
                    kept = dict(file[name].attrs)
                    del file[name]
                    if odd is not None:
                        file[name] = odd
                        file[name].attrs.update(kept)
            result, message = refusal(case.read, case.path)
            assert message or _sane(result), (name, attribute, odd)


def _write_generated(folder, shard, **changes):
    rows = np.arange(shard["first"], shard["first"] + shard["count"])
    columns = {"texture": np.outer(rows, np.ones(50)).astype(np.float32), "seed": rows, "level": rows / 10}
    write_shard(folder / shard["file"], shard["count"], SETTINGS, {"rating_axes": []}, [columns | changes])


@pytest.fixture(scope="module")
def generated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("generated") / "set"
    for shard in open_folder(folder, SETTINGS):
        _write_generated(folder, shard)
    return folder


def _generated(path):
    data = read_generated(path.parents[1])
    return [data[:], data.column("seed"), data.column("level")]


@pytest.mark.parametrize("number", [0, 1])
def test_generated_textures(generated, damaged, foreign, flips, number):
    def sane(arrays):
        return arrays[0].shape == (5, 50) and np.isfinite(arrays[0]).all() and len(arrays[1]) == len(arrays[2]) == 5

    file = generated / f"data/train-0000{number}-of-00002.parquet"
    case = damaged(file, _generated, sane=sane, root=generated)
    case.damage(flips, foreign.values())


def test_shards_of_another_form_are_refused(generated, damaged):
    case = damaged(generated / "data/train-00001-of-00002.parquet", _generated, root=generated)
    _, shard = plan_shards(5, 3)
    for textures in (np.zeros((2, 49), np.float32), np.zeros(2), np.full((2, 50), np.nan)):
        _write_generated(case.fresh().parents[1], shard, texture=textures)
        with pytest.raises(ValueError, match="train-00001-of-00002.parquet"):
            _generated(case.path)
    _write_generated(case.fresh().parents[1], {**shard, "count": 1})
    with pytest.raises(ValueError, match="holds 1 textures, not 2"):
        _generated(case.path)


@pytest.fixture
def scene(pipe, tmp_path):
    scene = TextureScene({"table": [0.5, -0.5, 0.0], "film": None}, pipe)
    (tmp_path / "scene").mkdir()
    scene.save(tmp_path / "scene" / "scene.safetensors")
    return tmp_path / "scene" / "scene.safetensors"


def test_a_scene(scene, pipe, damaged, foreign, flips):
    """Latents are half-precision numbers: a flipped bit of one is noticed only where it is no number any more."""

    def read(path):
        state = TextureScene.load(path, pipe)._state
        return [*state.latents, state.level, state.friction_coefficient]

    case = damaged(scene, read)
    case.damage(flips, foreign.values())
