"""`tactile-diffusers reconstruct`: files of several kinds in, the reconstruction and its error out."""

import json
import subprocess
import sys

import h5py
import numpy as np
import pytest
import soundfile

from tactile_diffusers.cli import reconstruct
from tactile_diffusers.cli.recording_file import read_recording_file
from tactile_diffusers.data import RecordingsFile
from tactile_diffusers.data.folder import read_recording
from tactile_diffusers.export import read_wav, write_hdf5, write_wav
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


def _as_texture(force, rate):
    return band_pass(force - force.mean(), rate)


def test_kinds_of_files(texture, tmp_path):
    soundfile.write(tmp_path / "plain.wav", texture, DEVICE_RATE, subtype="DOUBLE")
    np.save(tmp_path / "r.npy", texture)
    for name, options in (("plain.wav", {}), ("r.npy", {"rate": 10_000})):
        found, rate, notes = read_recording(tmp_path / name, **options)
        assert rate == DEVICE_RATE and not notes
        np.testing.assert_allclose(found, texture, atol=1e-9)
    common = {"sampling_rate": DEVICE_RATE, "friction_coefficient": 1.0, "ratings": [0.0] * 3, "seed": 0}
    write_wav(tmp_path / "ours.wav", texture, **common)
    arguments = reconstruct.parse_arguments([str(tmp_path / "ours.wav"), "--output", str(tmp_path)])
    found = read_recording_file("reconstruct.py", arguments)
    np.testing.assert_allclose(
        found.texture, _as_texture(texture, found.rate), atol=np.abs(texture).max() / 2**14
    )  # 16 bits
    write_hdf5(tmp_path / "ours.h5", texture, **common)
    arguments = reconstruct.parse_arguments([str(tmp_path / "ours.h5"), "--output", str(tmp_path)])
    found = read_recording_file("reconstruct.py", arguments)
    assert found.friction_coefficient == 1.0
    np.testing.assert_allclose(found.texture, _as_texture(texture, found.rate), atol=1e-8)
    arguments = reconstruct.parse_arguments(
        [str(tmp_path / "ours.h5"), "--column", "texture", "--rate", "5000", "--output", str(tmp_path)]
    )
    assert read_recording_file("reconstruct.py", arguments).rate == 5000


def test_a_store_of_recordings(virtual_recordings, tmp_path, capsys):
    with RecordingsFile(virtual_recordings) as file:
        names, stored = file.names, file.read(file.names[1])
    found, rate, notes = read_recording(virtual_recordings)
    assert rate == stored.rate and f"{names[0]} is used, the first of {len(names)} recordings" in notes[0]
    found, rate, notes = read_recording(virtual_recordings, recording=names[1])
    assert not notes and found.shape == (stored.samples,) and 0 < found.mean() < np.abs(stored.force).max()
    with pytest.raises(ValueError, match="has no recording 'x'; it has"):
        read_recording(virtual_recordings, recording="x")


def test_one_table_in_a_file_of_arrays(texture, tmp_path):
    with h5py.File(tmp_path / "one.h5", "w") as file:
        file["trial/force"] = texture
        file["trial"].attrs["rate"] = DEVICE_RATE
    np.testing.assert_array_equal(read_recording(tmp_path / "one.h5")[0], texture)
    np.savez(tmp_path / "two.npz", **{"a/force": texture, "b/force": 2 * texture})
    with pytest.raises(ValueError, match="several tables; give one of 'a', 'b' "):
        read_recording(tmp_path / "two.npz", rate=10_000)
    np.testing.assert_array_equal(read_recording(tmp_path / "two.npz", rate=10_000, recording="b")[0], 2 * texture)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("missing.csv", {}, "There is no file"),
        ("r.txt.zip", {}, "of no kind that can be read"),
        ("r.npy", {}, "does not state its sampling rate, and has no column of time: give `rate`"),
        ("stage.csv", {"column": "px_mm"}, "column 'px_mm' is in mm, by its name.*`newtons_per_unit`"),
        ("ticks.csv", {"column": "Fx"}, "time stamps of column 'time' have no unit .*: give `rate`"),
        ("coarse.csv", {"column": "Fx"}, "column 'time_s' are coarser than the samples: give `rate`"),
        ("back.csv", {"column": "Fx"}, "column 'time_s' gives no sampling rate: give `rate`.*time runs backward"),
        ("r.npy", {"rate": 1500.0}, "must be a whole number of at least 2500 Hz, got 1500"),
        ("axes.csv", {"rate": 10_000}, "several columns; say which one is the force: Fx, Fy"),
        ("axes.csv", {"rate": 10_000, "column": "Fz"}, "has no column 'Fz'"),
        ("short.npy", {"rate": 10_000}, "at least 0.25 s are needed"),
        ("nothing.npy", {"rate": 10_000}, "the force holds no number"),
    ],
)
def test_what_cannot_be_read_is_refused(name, options, message, texture, tmp_path):
    (tmp_path / "r.txt.zip").write_text("")
    np.save(tmp_path / "r.npy", texture)
    np.save(tmp_path / "short.npy", texture[:100])
    np.save(tmp_path / "nothing.npy", np.nan * texture)
    _write_csv(tmp_path / "axes.csv", texture, "Fx,Fy")
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


@pytest.mark.parametrize(
    ("header", "seconds", "newtons"),
    [("time_s,Fx_mN", 1, 1e-3), ("time (ms),Fx (N)", 1e-3, 1), ("Time / s,Friction in gf", 1, 9.80665e-3)],
)
def test_rate_and_unit_are_those_of_the_table(header, seconds, newtons, texture, tmp_path):
    """Time stamps with jitter; the only column beside them is the force."""
    jitter = np.random.default_rng(0).uniform(-0.1, 0.1, len(texture))
    rows = np.stack([(np.arange(len(texture)) + jitter) / DEVICE_RATE / seconds, texture / newtons], axis=1)
    np.savetxt(tmp_path / "r.csv", rows, delimiter=",", header=header, comments="")
    column = header.split(",")[1]
    found, rate, notes = read_recording(tmp_path / "r.csv")
    assert rate == DEVICE_RATE and notes == [f"{tmp_path / 'r.csv'}: column {column!r} is used as the lateral force"]
    np.testing.assert_allclose(found, texture, atol=1e-9)
    raw, _, _ = read_recording(tmp_path / "r.csv", column, newtons_per_unit=2.0)  # an option goes before
    np.testing.assert_allclose(raw, found * 2 / newtons, rtol=1e-6)


@pytest.mark.parametrize("lost, samples", [(20, 8192), (2000, 5092)])
def test_short_gaps_are_bridged_and_long_ones_left_out(texture, tmp_path, lost, samples):
    """Conversion bridges 0.1 s, too."""
    rows = np.stack([np.arange(len(texture)) / DEVICE_RATE, texture], axis=1)
    rows = np.delete(rows, slice(1100, 1100 + lost), axis=0)
    np.savetxt(tmp_path / "r.csv", rows, delimiter=",", header="t_s,Fx_N", comments="")
    found, _, notes = read_recording(tmp_path / "r.csv")
    assert len(found) == samples and any(f"{lost} samples dropped (gaps" in note for note in notes)
    np.testing.assert_allclose(found[-4000:], texture[-4000:], atol=1e-9)
    wanted = "20 samples that are missing or no number are bridged" if lost == 20 else "0.310 to 0.819 s are used"
    assert any(wanted in note for note in notes)


def test_bad_options_are_refused_by_name(tmp_path, capsys):
    for option in ("--newtons_per_unit -1", "--num_inference_steps 0", "--checkpoint nowhere"):
        with pytest.raises(SystemExit) as stop:
            reconstruct.main(["r.csv", "--output", str(tmp_path / "out"), *option.split()])
        assert stop.value.code == 2 and f"argument {option.split()[0]}: " in capsys.readouterr().err


@pytest.mark.slow
def test_nothing_but_errors_on_stderr(texture, tmp_path):
    """In a process of its own: once a bar is off, it stays off."""
    _write_csv(tmp_path / "r.csv", texture)
    words = ["reconstruct", str(tmp_path / "r.csv"), "--column", "Fx", "--rate", "10000", "--output", str(tmp_path)]
    command = [sys.executable, "-m", "tactile_diffusers_cli", *words, "--json"]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stderr == ""
