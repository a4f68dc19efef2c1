"""The command play: a trajectory in, force or drive out."""

import numpy as np
import pytest

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


def test_npz_and_drive(play):
    assert play("--output a_force.npz --mean_friction") == 0
    with np.load("a_force.npz") as file:
        assert set(file) == {"force", "speed", "sampling_rate", "unit"} and file["unit"] == "N"
    profile = DriveProfile(
        kind="electroadhesion", gain=1e-5, offset=0.2, cutoffs=((80.0, 200.0),), max_drive=200.0, normal_force=0.5
    )
    profile.save("display.json")
    assert play("--output drive.npz --drive_profile display.json") == 0
    with np.load("drive.npz") as file:
        assert file["unit"] == "V" and 0 <= file["drive"].min() < file["drive"].max() <= 200


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
        ("--output b.npz --drive_profile t.csv", {}, "t.csv cannot be read"),
        ("--output b.npz --drive_profile t.csv --mean_friction", {}, "argument --mean_friction"),
    ],
)
def test_bad_requests_are_refused_with_one_line(play, tmp_path, capsys, words, changes, message):
    try:
        code = play(words, **changes)
    except SystemExit as stop:
        code = stop.code
    assert code == 2 and message in capsys.readouterr().err.splitlines()[-1]
    assert {path.name for path in tmp_path.iterdir()} == {"a.npz", "t.csv", "plane.csv"}
