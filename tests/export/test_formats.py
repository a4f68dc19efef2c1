"""What is written can be read again, and says the same."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
import soundfile
from matplotlib.figure import Figure
from PIL import Image

from tactile_diffusers.export import FORMATS, read_wav, write_figure, write_npz, write_wav
from tactile_diffusers.io.files import atomic_path

RATE = 10000
COMMON = {"sampling_rate": RATE, "friction_coefficient": 0.62, "ratings": [1.5, float("nan"), -1.0]}


@pytest.fixture
def texture():
    return 0.009 * np.random.default_rng(0).normal(size=4000)


def test_npz_round_trip(tmp_path, texture):
    write_npz(tmp_path / "a.npz", texture, seed=7, reference_speed=82.5, **COMMON)
    with np.load(tmp_path / "a.npz", allow_pickle=False) as file:
        assert set(file) == {
            "texture",
            "sampling_rate",
            "friction_coefficient",
            "ratings",
            "seed",
            "reference_speed",
            "checkpoint",
            "units",
        }
        assert file["checkpoint"] == ""
        assert file["texture"].dtype == np.float32
        np.testing.assert_array_equal(file["texture"], texture.astype(np.float32))
        np.testing.assert_array_equal(file["ratings"], np.float32([1.5, np.nan, -1.0]))
        assert (file["sampling_rate"], file["seed"], file["reference_speed"]) == (RATE, 7, 82.5)
        assert file["friction_coefficient"] == np.float32(0.62)


def test_npz_keeps_what_is_unknown_and_large_seeds(tmp_path, texture):
    unknown = {**COMMON, "friction_coefficient": float("nan"), "ratings": [None, 0.5, None]}
    write_npz(tmp_path / "a.npz", texture, seed=2**64 - 1, reference_speed=float("nan"), **unknown)
    with np.load(tmp_path / "a.npz", allow_pickle=False) as file:
        assert np.isnan(file["friction_coefficient"]) and np.isnan(file["reference_speed"])
        np.testing.assert_array_equal(file["ratings"], [np.nan, 0.5, np.nan])
        assert int(file["seed"]) == 2**64 - 1


@pytest.mark.parametrize(
    ("subtype", "tolerance"),
    [("PCM_16", 1.01 * 2**-16), ("FLOAT", 2**-23)],  # half a count, or float32, of full scale
)
def test_wav_times_scale_gives_newtons(tmp_path, texture, subtype, tolerance):
    write_wav(tmp_path / "a.wav", texture, seed=7, subtype=subtype, **COMMON)
    read, metadata = read_wav(tmp_path / "a.wav")
    scale = metadata["newtons_per_full_scale"]
    assert read.dtype == np.float32
    np.testing.assert_allclose(read, texture, rtol=0, atol=tolerance * scale)
    # any other reader arrives at the same
    samples, rate = soundfile.read(tmp_path / "a.wav")
    assert rate == RATE and soundfile.info(tmp_path / "a.wav").subtype == subtype
    assert 0.9999 < np.abs(samples).max() <= 1
    np.testing.assert_allclose(samples * scale, texture, rtol=0, atol=tolerance * scale)
    assert (metadata["unit"], metadata["sampling_rate"], metadata["seed"]) == ("N", RATE, 7)
    assert metadata["friction_coefficient"] == 0.62
    np.testing.assert_array_equal(metadata["ratings"], [1.5, np.nan, -1.0])


def test_sidecar_is_standard_json(tmp_path, texture):
    write_wav(tmp_path / "a.wav", texture, seed=7, **{**COMMON, "friction_coefficient": float("nan")})

    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    sidecar = json.loads((tmp_path / "a.wav.json").read_text(encoding="utf-8"), parse_constant=refuse)
    assert sidecar["ratings"] == [1.5, None, -1.0] and sidecar["friction_coefficient"] is None
    assert np.isnan(read_wav(tmp_path / "a.wav")[1]["friction_coefficient"])


def test_silence_and_full_scale_peaks_survive_a_wav(tmp_path):
    for texture in (np.zeros(100), np.array([-0.03, 0.03] * 50), np.full(100, -5.0)):
        write_wav(tmp_path / "a.wav", texture, seed=0, **COMMON)
        read, metadata = read_wav(tmp_path / "a.wav")
        np.testing.assert_allclose(read, texture, rtol=1e-6, atol=metadata["newtons_per_full_scale"] / 2**16)


def test_wav_without_its_sidecar_is_refused(tmp_path, texture):
    with pytest.raises(FileNotFoundError, match="does not exist"):
        read_wav(tmp_path / "a.wav")
    write_wav(tmp_path / "a.wav", texture, seed=0, **COMMON)
    sidecar = tmp_path / "a.wav.json"
    metadata = json.loads(sidecar.read_text())
    sidecar.write_text(json.dumps({**metadata, "sampling_rate": 8000}))
    with pytest.raises(ValueError, match="10000 Hz, but its sidecar says 8000 Hz"):
        read_wav(tmp_path / "a.wav")
    del metadata["newtons_per_full_scale"]
    sidecar.write_text(json.dumps(metadata))
    with pytest.raises(ValueError, match="lacks newtons_per_full_scale"):
        read_wav(tmp_path / "a.wav")
    sidecar.unlink()
    with pytest.raises(FileNotFoundError, match=r"a\.wav\.json, which holds the scale"):
        read_wav(tmp_path / "a.wav")


def test_figure_is_a_png_of_the_size_of_a_page(tmp_path, texture):
    for name, signal in (("noise", texture), ("silence", np.zeros(1000))):
        write_figure(tmp_path / f"{name}.png", signal, **COMMON)
        header = (tmp_path / f"{name}.png").read_bytes()[:24]
        assert header.startswith(b"\x89PNG")
        assert int.from_bytes(header[16:20]) > 1000 and int.from_bytes(header[20:24]) > 600


def test_figure_of_a_reconstruction_shows_the_original(tmp_path, texture, monkeypatch):
    drawn = []
    save = lambda figure, path, **_: drawn.append(figure) or Path(path).write_bytes(b"png")  # noqa: E731
    monkeypatch.setattr(Figure, "savefig", save)
    write_figure(tmp_path / "a.png", 0.5 * texture, **COMMON | {"ratings": [float("nan")] * 3}, original=texture)
    waveform, spectrum, *_ = drawn[0].axes
    for panel in (waveform, spectrum):
        assert panel.lines[0].get_label() == "original" and len(panel.lines) == 2
    np.testing.assert_allclose(waveform.lines[0].get_ydata(), 1e3 * texture)
    assert drawn[0].get_suptitle().startswith("reconstruction, RMS ") and "specified" not in drawn[0].get_suptitle()


def test_figure_of_a_few_samples_is_refused(tmp_path):
    with pytest.raises(ValueError, match="too short to draw"):
        write_figure(tmp_path / "a.png", np.zeros(100), **COMMON)
    assert list(tmp_path.iterdir()) == []


def test_existing_file_survives_a_failed_write(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(RuntimeError), atomic_path(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    with atomic_path(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_wav_files_that_belong_together_share_a_scale(tmp_path, texture):
    """Players that ignore sidecars then keep the levels; what would be clipped is refused."""
    full_scale = 2 * np.abs(texture).max()
    for name, gain in (("loud", 1.0), ("quiet", 0.5)):
        write_wav(tmp_path / f"{name}.wav", gain * texture, seed=0, full_scale=full_scale, **COMMON)
    loud, quiet = (soundfile.read(tmp_path / f"{name}.wav")[0] for name in ("loud", "quiet"))
    np.testing.assert_allclose(quiet, 0.5 * loud, atol=2**-15)  # half a count of 16 bits each
    np.testing.assert_allclose(read_wav(tmp_path / "quiet.wav")[0], 0.5 * texture, atol=1.01 * 2**-16 * full_scale)
    with pytest.raises(ValueError, match="would be clipped"):
        write_wav(tmp_path / "a.wav", 3 * texture, seed=0, full_scale=full_scale, **COMMON)
    with pytest.raises(ValueError, match="`full_scale` must be above zero"):
        write_wav(tmp_path / "a.wav", texture, seed=0, full_scale=0.0, **COMMON)
    assert not (tmp_path / "a.wav").exists()


def test_files_explain_themselves(tmp_path, pink_noise):
    """A program without this package finds what the numbers mean."""
    texture = pink_noise(4000, RATE)[0]
    common = {"sampling_rate": RATE, "friction_coefficient": 0.5, "reference_speed": 80.0, "seed": 0}
    for name in ("npz", "hdf5", "wav", "png"):
        form = FORMATS[name]
        options = {"pixel_pitch": 0.03} if name == "png" else {}
        form.write(tmp_path / f"a{form.suffix}", texture, **common, ratings=[0.0] * 3, **options)
    with np.load(tmp_path / "a.npz") as file:
        found = [json.loads(str(file["units"]))]
    with h5py.File(tmp_path / "a.h5") as file:
        found.append(json.loads(file.attrs["units"]))
    found.append(json.loads((tmp_path / "a.wav.json").read_text())["units"])
    with Image.open(tmp_path / "a.friction.png") as picture:
        found.append(json.loads(picture.text["tactile_diffusers"])["units"])
    for units in found:
        assert units["reference_speed"].startswith("mm/s") and "0.5 N" in units["texture"]
