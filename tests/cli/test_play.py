"""The command play: a trajectory in, force or drive out."""

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactile_diffusers.cli.play import main
from tactile_diffusers.display import DriveProfile
from tactile_diffusers.export import read_wav, write_npz

ABOUT = {"sampling_rate": 10000, "friction_coefficient": 0.5, "ratings": [0, 0, 0], "seed": 3, "reference_speed": 80.0}


@pytest.fixture
def play(tmp_path, pink_noise, monkeypatch):
    """A function of further words and changes of what is stored with the texture."""
    monkeypatch.chdir(tmp_path)
    time = np.arange(125) / 125
    rows = np.column_stack([time, 40 * np.sin(np.pi * time)])
    np.savetxt("t.csv", rows, delimiter=",", header="time,position", comments="")
    rows = np.column_stack([rows, np.zeros(125)])
    np.savetxt("plane.csv", rows, delimiter=",", header="time,x,y", comments="")

    def run(words, **changes):
        write_npz("a.npz", pink_noise(8000, 10000)[0], **{**ABOUT, **changes})
        return main(f"--input a.npz --trajectory t.csv {words}".split())

    return run


def test_wav_without_and_with_mean_friction(play):
    assert play("--output friction.wav") == 0 and play("--output force.wav --mean_friction --rate 8000") == 0
    friction, about = read_wav("friction.wav")
    force, other = read_wav("force.wav")
    assert abs(friction.mean()) < 0.005 and about["sampling_rate"] == 10000 and other["sampling_rate"] == 8000
    # forth and back at 0.5 x 0.5 N, against the motion
    assert force[2000:3500].mean() == pytest.approx(-0.25, abs=0.03)
    assert force[6000:7500].mean() == pytest.approx(0.25, abs=0.03)
    words = [json.loads(Path(f"{name}.wav.json").read_text())["units"]["texture"] for name in ("friction", "force")]
    assert "friction about its mean" in words[0] and "against its motion" in words[1]
    assert other["normal_force"] == 0.5 and 0.01 < other["latency"] < 0.2


def test_an_unknown_mean_friction_is_said(play, capsys):
    assert play("--output a_force.npz", friction_coefficient=np.nan) == 0
    assert "`force` lacks the mean friction" in capsys.readouterr().err


def _display(**changes):
    values = {"gain": 1e-5, "offset": 0.2, "cutoffs": ((80.0, 200.0),), "max_drive": 200.0, "normal_force": 0.5}
    DriveProfile(kind="electroadhesion", **{**values, **changes}).save("display.json")


def test_one_file_holds_when_where_what_and_the_drive(play, capsys):
    assert play("--output a_force.npz") == 0
    told = capsys.readouterr().out
    assert "125 reports, 125 Hz, longest gap 8 ms" in told and "after the last report" in told
    names = {"time", "position", "speed", "force", "friction", "sampling_rate", "latency"}
    with np.load("a_force.npz") as file:
        assert set(file) == names and {file[name].shape for name in file if file[name].ndim} == {file["time"].shape}
        assert file["time"][-1] == pytest.approx(124 / 125 + file["latency"], abs=1e-3)
        assert file["position"][5000] == pytest.approx(40 * np.sin(np.pi * 0.5), abs=0.01)
    _display()
    assert play("--output drive.npz --drive_profile display.json") == 0
    with np.load("drive.npz") as file:
        beside = {"drive", "drive_unit", "max_drive", "gain", "bias", "normal_force", "clipped_share"}
        assert set(file) == names | beside and file["drive_unit"] == "V"
        assert 0 <= file["drive"].min() < file["drive"].max() <= 200
        assert (file["gain"], file["bias"], file["normal_force"], file["clipped_share"]) == (1, 0.2, 0.5, 0)
        assert max(file["drive"][0], file["drive"][-1]) < 1 < 100 < file["drive"][200]  # 20 ms


def test_what_the_display_cannot_make_is_said_once_and_fitted(play, capsys, recwarn):
    _display(max_drive=20.0)
    assert play("--output drive.npz --drive_profile display.json") == 0
    told = capsys.readouterr().out
    gain = float(told.split("--gain ")[1].split(",")[0])
    assert "samples clipped" in told and gain < 1 and not recwarn
    for words in (f"--gain {0.99 * gain:.4f}", "--gain fit"):
        assert play(f"--output drive.npz --drive_profile display.json {words}") == 0
        assert "clipped" not in capsys.readouterr().out
        with np.load("drive.npz") as file:
            assert file["drive"].max() == pytest.approx(20, abs=0.5)


def test_a_drive_is_a_file_of_sixteen_bits(play):
    _display()
    assert play("--output drive.npz --drive_profile display.json") == 0
    assert play("--output drive.wav --drive_profile display.json") == 0
    samples, rate = soundfile.read("drive.wav", dtype="int16")
    about = json.loads(Path("drive.wav.json").read_text())
    with np.load("drive.npz") as file:
        np.testing.assert_allclose(samples * about["drive_per_count"], file["drive"], atol=0.51 * 200 / 32767)
    assert rate == about["sampling_rate"] == 10000 and about["unit"] == "V"
    assert (about["gain"], about["bias"], about["normal_force"], about["clipped_share"]) == (1, 0.2, 0.5, 0)


def test_another_normal_force_than_the_calibration_is_warned_of(play, capsys):
    _display()
    for force, warned in ((0.55, 0), (2, 1)):
        assert play(f"--output drive.npz --drive_profile display.json --normal_force {force}") == 0
        assert capsys.readouterr().err.count("the display was calibrated at 0.5 N") == warned


@pytest.mark.parametrize(("unit", "warned"), [(1.0, 0), (1e-3, 1), (1e3, 1)])
def test_what_the_finger_did_is_told_so_that_another_unit_is_seen(play, capsys, unit, warned):
    time, place = np.loadtxt("t.csv", delimiter=",", skiprows=1).T
    np.savetxt("t.csv", np.column_stack([time, unit * place]), delimiter=",", header="time,position", comments="")
    assert play("--output force.npz") == 0
    told = capsys.readouterr()
    assert told.err.count("positions must be mm") == warned
    if not warned:
        assert "88.3 mm/s where they move" in told.out and "followed at 0 to 126 mm/s, at rest or lifted " in told.out
        assert "peaks: force 0." in told.out and "friction about its mean 0." in told.out


def test_a_plane(play):
    assert play("--output plane.npz --trajectory plane.csv --mean_friction") == 0
    with np.load("plane.npz") as file:
        assert file["force"].shape == (len(file["speed"]), 2)
    assert play("--output plane.wav --trajectory plane.csv") == 0


@pytest.mark.parametrize(
    ("words", "changes", "message"),
    [
        ("--output b.mp3", {}, "must end in .wav or .npz"),
        ("--output b.wav --trajectory a.npz", {}, "a.npz cannot be read as a trajectory"),
        ("--output b.wav", {"reference_speed": np.nan}, "knows no reference_speed"),
        ("--output b.wav --mean_friction", {"friction_coefficient": np.nan}, "knows no friction_coefficient"),
        ("--output b.wav --mean_friction --trajectory plane.csv", {}, "a force of two channels"),
        ("--output b.wav --rate 1000", {}, "`sampling_rate` must be"),
        ("--output b.wav --rate 5000.6", {}, "argument --rate"),
        ("--output b.npz --drive_profile t.csv", {}, "t.csv cannot be read"),
        ("--output b.npz --drive_profile t.csv --mean_friction", {}, "argument --mean_friction"),
        ("--output b.npz --gain 0.5", {}, "argument --gain: it is of a display's drive"),
        ("--output b.npz --drive_profile t.csv --gain 0", {}, "argument --gain"),
    ],
)
def test_bad_requests_are_refused_with_one_line(play, tmp_path, capsys, words, changes, message):
    try:
        code = play(words, **changes)
    except SystemExit as stop:
        code = stop.code
    assert code == 2 and message in capsys.readouterr().err.splitlines()[-1]
    assert {path.name for path in tmp_path.iterdir()} == {"a.npz", "t.csv", "plane.csv"}
