"""Any texture through every format: what comes back is as exact as the format says, with all that belongs to it."""

import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_diffusers.export import FORMATS
from tactile_diffusers.signal import rms

KINDS = ("noise", "sine", "silence", "constant", "impulse")
number = st.one_of(st.just(math.nan), st.floats(0.01, 3))
metadata = st.fixed_dictionaries(
    {
        "friction_coefficient": number,
        "reference_speed": st.floats(10, 400),
        "ratings": st.lists(st.one_of(st.none(), st.just(math.nan), st.floats(-6, 6)), min_size=3, max_size=3),
        "seed": st.integers(0, 2**64 - 1),
    },
    optional={
        "checkpoint": st.one_of(st.none(), st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20))
    },
)
# no separators, and what file systems take: 255 bytes with suffixes, sidecar and the temporary file's
file_names = st.text(
    st.characters(codec="utf-8", exclude_characters="/\0", exclude_categories=["Cs"]), min_size=1, max_size=30
).filter(lambda name: name not in (".", ".."))


@st.composite
def textures(draw, least=1, most=3000):
    samples, rate = draw(st.integers(least, most)), draw(st.sampled_from([2500, 8000, 10_000, 44_100]))
    kind, size = draw(st.sampled_from(KINDS)), 10.0 ** draw(st.floats(-6, 1))
    time = np.arange(samples) / rate
    made = {
        "noise": np.random.default_rng(draw(st.integers(0, 99))).standard_normal(samples),
        "sine": np.sin(2 * np.pi * draw(st.floats(20, 1000)) * time),
        "silence": np.zeros(samples),
        "constant": np.ones(samples),
        "impulse": np.eye(1, samples, samples // 2)[0],
    }[kind]
    return size * made / max(1e-9, np.abs(made).max()), rate


def _there_and_back(folder, name, texture, rate, common, stem="a"):
    form = FORMATS[name]
    path = folder / f"{stem}{form.suffix}"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "Pixels .* mm apart hold")
        form.write(path, texture, sampling_rate=rate, **common)
        found, kept = form.read(path)
    assert sorted(file.name for file in folder.iterdir()) == sorted({path.name} | _sidecar(path))  # nothing left behind
    for file in folder.iterdir():
        file.unlink()
    return found, kept


def _sidecar(path):
    return {f"{path.name}.json"} if path.suffix == ".wav" else set()


def _same(kept, common, rate):
    assert kept["sampling_rate"] == rate and kept["seed"] == common["seed"]
    assert kept["checkpoint"] == (common.get("checkpoint") or None)
    ratings = [math.nan if value is None else value for value in common["ratings"]]
    np.testing.assert_allclose(kept["ratings"], ratings, rtol=1e-6, atol=1e-9)
    for key in ("friction_coefficient", "reference_speed"):
        np.testing.assert_allclose(kept[key], common[key], rtol=1e-6)


@pytest.mark.parametrize("name", FORMATS)
@settings.get_profile("few")
@given(texture=textures(), common=metadata)
def test_all_that_belongs_to_a_texture_comes_back(tmp_path, name, texture, common):
    texture, rate = texture
    found, kept = _there_and_back(tmp_path, name, texture, rate, common)
    assert found.shape == texture.shape and found.dtype == np.float32 and np.isfinite(found).all()
    _same(kept, common, rate)
    if FORMATS[name].kind == "preview" and len(texture) >= 500:
        # a sine of the texture's power: no stronger than the texture
        assert rms(found) <= 3 * rms(texture) + 1e-12
    error = np.abs(found - texture).max()
    if FORMATS[name].kind == "lossless":
        assert error <= 4e-7 * np.abs(texture).max()  # float32
    if name == "wav16":
        assert error <= kept["newtons_per_full_scale"] * (2.0**-16 + 1e-7)  # half a count


@settings.get_profile("many")
@given(stem=file_names, name=st.sampled_from(list(FORMATS)))
def test_odd_file_names(tmp_path, stem, name):
    common = {"friction_coefficient": 0.5, "reference_speed": 80.0, "ratings": [1, None, 0], "seed": 1}
    found, kept = _there_and_back(tmp_path, name, np.sin(np.arange(200.0)), 10_000, common, stem)
    assert len(found) == 200
    _same(kept, common, 10_000)


BAD = {
    "texture": [[], [[1.0]], None, "x", [math.nan], [0, math.inf], [1j], [True], np.zeros((2, 3)), [10**400], [None]],
    "sampling_rate": [0, -1, 2.5, math.nan, math.inf, None, "x", 10**400, [10_000]],
    "friction_coefficient": [0, -0.1, math.inf, None, "x", 10**400, [1.0]],
    "reference_speed": [0, -80, math.inf, None, "x", 10**400, [80.0]],
    "ratings": [[1, 2], [1] * 33, [math.inf, 0, 0], None, "abc", 5, [10**400, 0, 0], [[1], [2], [3]], ["x"] * 3],
    "seed": [0.5, math.nan, math.inf, True, 2**64, -1, "x", "5", [1]],
    "checkpoint": [5, b"x", ["x"]],
}


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("argument", BAD)
def test_bad_arguments_are_refused_by_name_and_nothing_is_written(tmp_path, name, argument):
    good = {"texture": np.ones(30), "sampling_rate": 10_000, "friction_coefficient": 0.5, "reference_speed": 80.0}
    for value in BAD[argument]:
        call = good | {"ratings": [0, 0, 0], "seed": 1, argument: value}
        with pytest.raises((ValueError, TypeError), match=f"`{argument}`"):
            FORMATS[name].write(tmp_path / f"a{FORMATS[name].suffix}", **call)
    assert not list(tmp_path.iterdir())
