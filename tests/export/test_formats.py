"""Every format of the table: what is written can be read again, with all that belongs to it."""

import json
import math

import h5py
import numpy as np
import pytest
from PIL import Image

from tactile_diffusers.export import (
    FORMATS,
    read_npz,
    round_trip,
    write_npz,
)
from tactile_diffusers.signal import DEVICE_RATE, SEGMENT_SAMPLES

COMMON = {
    "sampling_rate": DEVICE_RATE,
    "friction_coefficient": 0.62,
    "reference_speed": 80.5,
    "ratings": [1.5, float("nan"), -1.0],
    "seed": 7,
    "checkpoint": "virtual-surfaces",
}
UNKNOWN = {**COMMON, "friction_coefficient": float("nan"), "reference_speed": float("nan"), "checkpoint": None}
#: Pixels so fine that they hold 1 kHz at 80.5 mm/s (0.9 of their Nyquist frequency).
FINE = {"pixel_pitch": 0.03}


@pytest.fixture
def texture(pink_noise):
    return pink_noise(SEGMENT_SAMPLES, DEVICE_RATE)[0].astype(np.float32)


def _write(folder, name, texture, common=COMMON):
    form = FORMATS[name]
    path = folder / f"a{form.suffix}"
    form.write(path, texture, **common, **{key: value for key, value in FINE.items() if key in form.options})
    return path


@pytest.mark.parametrize("name", [name for name, form in FORMATS.items() if not form.spatial])
def test_unknown_metadata_come_back_as_unknown(tmp_path, texture, name):
    _, metadata = FORMATS[name].read(_write(tmp_path, name, texture, {**UNKNOWN, "seed": 2**64 - 1}))
    assert math.isnan(metadata["friction_coefficient"]) and math.isnan(metadata["reference_speed"])
    assert metadata["checkpoint"] is None and metadata["seed"] == 2**64 - 1


@pytest.mark.parametrize(
    ("name", "snr_db", "band_db"),
    [
        ("npz", np.inf, 0),
        ("hdf5", np.inf, 0),
        ("wav", 140, 1e-5),  # float32: 24 bits
        ("wav16", 80, 0.01),  # 16 bits: 98 dB below the peak, which is some 12 dB above the RMS
        ("png", 30, 0.3),  # 8 bits: 48 dB less of the same; thin bands stand less above the noise
        ("hjif", 80, 0.01),  # 5 decimals: 111 dB below the peak; key frames and cubic: 90 dB
        ("hjif-friction", 60, 0.05),  # 5 decimals of the mean friction, which is much larger than the texture
        ("hjif-texture", 80, 0.01),
    ],
)
def test_newtons_come_back(tmp_path, texture, name, snr_db, band_db):
    row = round_trip(_write(tmp_path, name, texture), name, texture, DEVICE_RATE)
    assert row["snr_db"] >= snr_db and row["nine_band_error_db"] <= band_db and row["bands"] == 9


@pytest.mark.parametrize("name", FORMATS)
def test_a_missing_file_is_named(tmp_path, name):
    with pytest.raises(FileNotFoundError, match=f"a{FORMATS[name].suffix}"):
        FORMATS[name].read(tmp_path / f"a{FORMATS[name].suffix}")


@pytest.mark.parametrize("name", [name for name, form in FORMATS.items() if form.spatial])
def test_position_needs_a_speed(tmp_path, texture, name):
    with pytest.raises(ValueError, match=r"`reference_speed` is unknown \(NaN\).*choose a format over time"):
        _write(tmp_path, name, texture, UNKNOWN)
    assert not list(tmp_path.iterdir())


def test_npz_needs_no_pickle_and_nothing_may_be_missing(tmp_path, texture):
    write_npz(tmp_path / "a.npz", texture, **COMMON | {"ratings": [None, 0.5, None]})
    with np.load(tmp_path / "a.npz", allow_pickle=False) as file:
        assert set(file) == {*COMMON, "texture", "units"}
        np.testing.assert_array_equal(file["ratings"], np.float32([np.nan, 0.5, np.nan]))
        np.savez(tmp_path / "b.npz", **{key: file[key] for key in file if key != "texture"})
        np.savez(tmp_path / "c.npz", texture=file["texture"])
    with pytest.raises(ValueError, match="lacks texture"):
        read_npz(tmp_path / "b.npz")
    with pytest.raises(
        ValueError, match="lacks sampling_rate, friction_coefficient, reference_speed, ratings, seed, checkpoint"
    ):
        read_npz(tmp_path / "c.npz")


def test_files_explain_themselves(tmp_path, texture):
    """A program without this package finds what the numbers mean."""
    paths = {name: _write(tmp_path, name, texture) for name in ("npz", "hdf5", "wav", "png")}
    with np.load(paths["npz"]) as npz, h5py.File(paths["hdf5"]) as hdf5, Image.open(paths["png"]) as picture:
        assert (hdf5.attrs["format"], hdf5.attrs["version"]) == ("tactile-texture", 1)
        assert (hdf5["texture"].attrs["rate"], hdf5["texture"].attrs["unit"]) == (DEVICE_RATE, "N")
        assert hdf5.attrs["rating_axes"] == "roughness, bumpiness, slipperiness"
        found = [json.loads(str(npz["units"])), json.loads(hdf5.attrs["units"])]
        found.append(json.loads(picture.text["tactile_diffusers"])["units"])
    found.append(json.loads((tmp_path / "a.wav.json").read_text())["units"])
    for units in found:
        assert units["reference_speed"].startswith("mm/s") and "0.5 N" in units["texture"]


def test_a_short_texture_has_no_bands(tmp_path, texture):
    short = texture[:300]  # no bands of 11 Hz
    assert np.isnan(round_trip(_write(tmp_path, "npz", short), "npz", short, DEVICE_RATE)["nine_band_error_db"])
