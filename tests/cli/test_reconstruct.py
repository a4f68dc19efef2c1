"""`tactile-diffusers reconstruct`: files of several kinds in, the reconstruction and its error out."""

import json
import subprocess
import sys

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


def _write_csv(path, texture, header="t,Fx", rate=DEVICE_RATE):
    columns = np.stack([np.arange(len(texture)) / rate, texture], axis=1)
    np.savetxt(path, columns, delimiter=",", header=header, comments="")


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
        ("r.npy", {}, "does not say its sampling rate, and has no column of time: give --rate"),
        ("stage.csv", {"column": "px_mm"}, "column 'px_mm' is in mm, by its name.*--newtons_per_unit"),
        ("ticks.csv", {"column": "Fx"}, "time stamps of column 'time' have no unit .*: give --rate"),
        ("coarse.csv", {"column": "Fx"}, "column 'time_s' are coarser than the samples: give --rate"),
        ("back.csv", {"column": "Fx"}, "column 'time_s' gives no sampling rate: give --rate.*time runs backward"),
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
    _write_csv(tmp_path / "stage.csv", texture, "time_s,px_mm")
    _write_csv(tmp_path / "ticks.csv", texture, "time,Fx", rate=25)  # or 25 kHz, in ms
    for file, stamps in (("coarse", np.arange(8192) // 10), ("back", np.abs(np.arange(8192) - 4000))):
        rows = np.stack([stamps / DEVICE_RATE, texture], axis=1)
        np.savetxt(tmp_path / f"{file}.csv", rows, delimiter=",", header="time_s,Fx", comments="")
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


@pytest.mark.parametrize(("header", "seconds", "newtons"), [("time_s,Fx_mN", 1, 1e-3), ("time (ms),Fx (N)", 1e-3, 1)])
def test_rate_and_unit_are_those_of_the_table(header, seconds, newtons, texture, tmp_path):
    """Time stamps with jitter; where samples were dropped, there is no number."""
    jitter = np.random.default_rng(0).uniform(-0.1, 0.1, len(texture))
    rows = np.stack([(np.arange(len(texture)) + jitter) / DEVICE_RATE / seconds, texture / newtons], axis=1)
    np.savetxt(tmp_path / "r.csv", rows, delimiter=",", header=header, comments="")
    column = header.split(",")[1]
    found, rate = read_recording(tmp_path / "r.csv", column)
    assert rate == DEVICE_RATE
    np.testing.assert_allclose(found, band_pass(texture - texture.mean(), DEVICE_RATE), atol=1e-9)
    raw, _ = read_recording(tmp_path / "r.csv", column, newtons_per_unit=2.0)  # what is asked for goes before
    np.testing.assert_allclose(raw, found * 2 / newtons, rtol=1e-6)
    np.savetxt(tmp_path / "r.csv", np.delete(rows, [5000, 5001], axis=0), delimiter=",", header=header, comments="")
    with pytest.raises(ValueError, match="has 2 samples that are no number"):
        read_recording(tmp_path / "r.csv", column)


def test_a_json_file_beside_another_kind_is_not_ours(texture, tmp_path):
    _write_csv(tmp_path / "r.csv", texture)
    (tmp_path / "r.csv.json").write_text('{"participant": 7}')
    assert read_recording(tmp_path / "r.csv", "Fx", 10_000)[1] == DEVICE_RATE


@pytest.mark.parametrize("seed", [-1, 2**63, 10**30])
def test_seeds_that_no_generator_takes_are_refused_by_name(tmp_path, capsys, seed):
    with pytest.raises(SystemExit) as stop:
        reconstruct.main(["r.csv", "--output", str(tmp_path / "out"), "--seed", str(seed)])
    assert stop.value.code == 2 and "--seed: must be at least 0 and below 2**63" in capsys.readouterr().err


@pytest.mark.parametrize("silence", ["--quiet", "--json"])
def test_nothing_but_errors_on_stderr(texture, tmp_path, silence):
    """In a process of its own: once a bar is off, it stays off."""
    _write_csv(tmp_path / "r.csv", texture)
    words = ["reconstruct", str(tmp_path / "r.csv"), "--column", "Fx", "--rate", "10000", "--output", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, "-m", "tactile_diffusers_cli", *words, silence],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
