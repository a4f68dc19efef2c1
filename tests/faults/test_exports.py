"""Exported files: every format of `FORMATS`, damaged in every way."""

import json

import h5py
import numpy as np
import pytest

from tactile_diffusers.export import FORMATS

TEXT = ("hjif", "hjif-friction", "hjif-texture", "haptic", "ahap")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Format -> a file of a texture of 50 ms."""
    texture = 0.01 * np.random.default_rng(0).standard_normal(500)
    paths = {}
    for name, form in FORMATS.items():
        paths[name] = tmp_path_factory.mktemp(name) / f"texture{form.suffix}"
        about = {"friction_coefficient": 0.5, "reference_speed": 80.0, "ratings": [1.0, np.nan, -1.0], "seed": 3}
        form.write(paths[name], texture, sampling_rate=10_000, checkpoint="tiny", **about)
    return paths


def _sane(result):
    texture, metadata = result
    return (
        texture.ndim == 1
        and texture.dtype.kind == "f"
        and np.isfinite(texture).all()
        and metadata["sampling_rate"] == int(metadata["sampling_rate"]) > 0
        and len(metadata["ratings"]) == 3
    )


@pytest.mark.parametrize("name", FORMATS)
def test_damage(name, exported, damaged, flips, foreign):
    case = damaged(exported[name], FORMATS[name].read, sane=_sane)
    others = [path.read_bytes() for path in exported.values() if path.suffix not in case.path.suffixes]
    case.damage(flips, [*foreign.values(), *others])


@pytest.mark.parametrize("name", ["wav", "wav16"])
def test_the_sidecar_of_a_wav_file(exported, damaged, foreign, flips, name):
    side = exported[name].with_name(exported[name].name + ".json")
    case = damaged(side, lambda path: FORMATS[name].read(path.with_suffix("")), sane=_sane)
    case.damage(flips, foreign.values())


def _places(content, place=()):
    """Paths of all keys and items of a JSON value, the first item alone of each list."""
    if isinstance(content, dict):
        for key, value in content.items():
            yield (*place, key)
            yield from _places(value, (*place, key))
    elif isinstance(content, list) and content:
        yield (*place, 0)
        yield from _places(content[0], (*place, 0))


def _at(content, place):
    for key in place:
        content = content[key]
    return content


@pytest.mark.parametrize("name", TEXT)
def test_a_key_of_a_text_format_is_missing_or_absurd(exported, damaged, refusal, odd_values, name):
    case = damaged(exported[name], FORMATS[name].read, sane=_sane)
    good = json.loads(case.content)
    described = [good, json.loads(good["description"])] if name.startswith("hjif") else [good]
    for number, part in enumerate(described):
        for place in list(_places(part)):
            for absurd in odd_values:
                copy = json.loads(json.dumps(part))
                *above, last = place
                if absurd == "missing":
                    del _at(copy, above)[last]
                else:
                    _at(copy, above)[last] = absurd
                copy = {**good, "description": json.dumps(copy)} if number else copy
                result, message = refusal(case.read, case.put(json.dumps(copy).encode()))
                assert message or _sane(result), (place, absurd)


def test_a_key_of_an_archive_is_missing_or_another(exported, damaged, refusal):
    case = damaged(exported["npz"], FORMATS["npz"].read, sane=_sane)
    arrays = dict(np.load(case.path))
    for name in arrays:
        np.savez(case.path, **{other: value for other, value in arrays.items() if other != name})
        assert refusal(case.read, case.path)[1] or name in ("reference_speed", "checkpoint", "units")
        for odd in (np.array("word"), np.array(np.nan), np.zeros((2, 3)), np.array([{}], dtype=object), np.array(-1)):
            np.savez(case.path, allow_pickle=True, **{**arrays, name: odd})
            result, message = refusal(case.read, case.path)
            assert message or _sane(result), (name, odd)
            assert message or odd.dtype != object


def test_an_attribute_of_hdf5_is_missing_or_another(exported, damaged, refusal):
    case = damaged(exported["hdf5"], FORMATS["hdf5"].read, sane=_sane)
    with h5py.File(case.path) as file:
        attributes = [("/", name) for name in file.attrs] + [("texture", name) for name in file["texture"].attrs]
    for place, name in attributes:
        for odd in (None, "word", np.nan, -1, np.zeros((2, 3))):
            case.fresh()
            with h5py.File(case.path, "r+") as file:
                del file[place].attrs[name]
                if odd is not None:
                    file[place].attrs[name] = odd
            result, message = refusal(case.read, case.path)
            assert message or _sane(result), (place, name, odd)
    for odd in (None, np.zeros((2, 3)), np.array([np.nan]), "word", np.zeros(0)):
        case.fresh()
        with h5py.File(case.path, "r+") as file:
            attributes = dict(file["texture"].attrs)
            del file["texture"]
            if odd is not None:
                file["texture"] = odd
                file["texture"].attrs.update(attributes)
        assert refusal(case.read, case.path)[1], odd


@pytest.mark.parametrize("rate", [0, -1, 44_100])
def test_a_sidecar_of_another_rate(exported, damaged, refusal, rate):
    side = exported["wav"].with_name(exported["wav"].name + ".json")
    case = damaged(side, lambda path: FORMATS["wav"].read(path.with_suffix("")), sane=_sane)
    content = json.loads(case.content)
    assert "wav" in case.refuse(json.dumps({**content, "sampling_rate": rate}).encode())
