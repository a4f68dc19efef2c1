"""`tactile-diffusers reconstruct`: files of several kinds in, the reconstruction and its error out."""

import json

import numpy as np
import pytest
import soundfile

from tactile_diffusers.cli import reconstruct
from tactile_diffusers.cli.recording import read_recording
from tactile_diffusers.export import read_wav, write_wav
from tactile_diffusers.signal import DEVICE_RATE, band_pass


@pytest.fixture
def texture(pink_noise):
    return pink_noise(8192, DEVICE_RATE)[0]


def _write_csv(path, texture):
    columns = np.stack([np.arange(len(texture)) / DEVICE_RATE, texture], axis=1)
    np.savetxt(path, columns, delimiter=",", header="t,Fx", comments="")


def test_a_recording_comes_back(texture, tmp_path, capsys):
    _write_csv(tmp_path / "r.csv", texture)
    words = [str(tmp_path / "r.csv"), "--column", "Fx", "--rate", "10000", "--output", str(tmp_path / "out"), "--json"]
    assert reconstruct.main(words) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["seconds"] == pytest.approx(0.8192) and len(report["files"]) == 3
    # pink noise is no texture of the training set, but its low end is kept as it is and its band levels are restored
    assert report["nine_band_error_db"] < 1.5 and report["snr_db"] > 3
    made, metadata = read_wav(report["files"][1])
    assert made.shape == (8192,) and metadata["sampling_rate"] == DEVICE_RATE


def test_kinds_of_files(texture, tmp_path):
    heard = band_pass(texture - texture.mean(), DEVICE_RATE)
    soundfile.write(tmp_path / "plain.wav", texture, DEVICE_RATE, subtype="DOUBLE")
    np.save(tmp_path / "r.npy", texture)
    common = {"sampling_rate": DEVICE_RATE, "friction_coefficient": 1.0, "ratings": [0.0] * 3, "seed": 0}
    write_wav(tmp_path / "ours.wav", texture, **common)
    for name, options in (("plain.wav", {}), ("r.npy", {"rate": 10_000}), ("ours.wav", {})):
        found, rate = read_recording(tmp_path / name, **options)
        assert rate == DEVICE_RATE
        np.testing.assert_allclose(found, heard, atol=np.abs(texture).max() / 2**14)  # 16 bits


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("missing.csv", {}, "There is no file"),
        ("r.txt.zip", {}, "of no kind that can be read"),
        ("r.npy", {}, "does not say its sampling rate"),
        ("r.npy", {"rate": 1500.0}, "must be a whole number of at least 2500 Hz, got 1500"),
        ("r.npy", {"rate": float("nan")}, "must be a whole number"),
        ("two.csv", {"rate": 10_000}, "several columns; say which one is the force: t, Fx"),
        ("two.csv", {"rate": 10_000, "column": "Fz"}, "has no column 'Fz'"),
        ("short.npy", {"rate": 10_000}, "at least 0.25 s are needed"),
        ("holes.npy", {"rate": 10_000}, "has 1 samples that are no number"),
    ],
)
def test_what_cannot_be_read_is_refused(name, options, message, texture, tmp_path):
    (tmp_path / "r.txt.zip").write_text("")
    np.save(tmp_path / "r.npy", texture)
    np.save(tmp_path / "short.npy", texture[:100])
    np.save(tmp_path / "holes.npy", np.where(np.arange(8192) == 7, np.nan, texture))
    _write_csv(tmp_path / "two.csv", texture)
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        read_recording(tmp_path / name, **options)


def test_nothing_is_written_for_what_is_refused(tmp_path, capsys):
    assert reconstruct.main([str(tmp_path / "none.csv"), "--output", str(tmp_path / "out")]) == 2
    assert "reconstruct.py: error: There is no file" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_numbers_that_are_not_newtons(texture, tmp_path, capsys):
    soundfile.write(tmp_path / "loud.wav", texture / np.abs(texture).max(), DEVICE_RATE, subtype="FLOAT")
    words = [str(tmp_path / "loud.wav"), "--output", str(tmp_path / "out"), "--json"]
    assert reconstruct.main(words) == 0
    assert "Give --newtons_per_unit if these are not newtons" in capsys.readouterr().err
    scale = str(np.abs(texture).max())
    assert reconstruct.main([*words, "--newtons_per_unit", scale]) == 0
    said = capsys.readouterr()
    assert "warning" not in said.err and json.loads(said.out)["rms_mn"] == pytest.approx(10, rel=0.1)  # of `pink_noise`
    with pytest.raises(SystemExit):
        reconstruct.main([*words, "--newtons_per_unit", "-1"])
