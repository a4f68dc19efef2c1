"""What a profile may hold, and that it survives its files."""

import json

import numpy as np
import pytest

from tactile_diffusers.display import DriveProfile

KINDS = ("electroadhesion", "ultrasonic")


@pytest.mark.parametrize("kind", KINDS)
def test_round_trip(tmp_path, make_profile, noise_texture, kind):
    profile = make_profile(kind, cutoffs=[(20.0, 90.1), (80.0, 1 / 3 * 1000)], max_gain_db=9.0)
    profile.save(tmp_path / "display.json")
    read = DriveProfile.load(tmp_path / "display.json")
    assert read == profile
    texture = noise_texture()[:100]
    np.testing.assert_array_equal(read.drive(texture, 50.0)[0], profile.drive(texture, 50.0)[0])
    names = {path.name for path in tmp_path.iterdir()}
    assert names == ({"display.json"} if kind == "electroadhesion" else {"display.json", "display.lookup.csv"})
    content = json.loads((tmp_path / "display.json").read_text(encoding="utf-8"))
    assert content["units"]["drive"] == profile.drive_unit and content["normal_force"] == 0.5
    assert [speed for speed, _ in content["cutoffs"]] == [20.0, 80.0]


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        ("electroadhesion", {"max_gain_db": 1.0}, r"`max_gain_db` must be 0 \(no inverse\) or at least 3 dB, got 1"),
        ("electroadhesion", {"cutoffs": [(80.0, -300.0)]}, "`cutoffs` must hold speeds and corners above zero"),
        ("electroadhesion", {"cutoffs": [(80, 300), (20, 90)]}, r"`cutoffs`.*increasing.*speed, got \[80.0, 20.0\]"),
        ("electroadhesion", {"lookup": [(0, 0), (0.5, 0.1), (1, 0.2)]}, "`max_drive` of 180 is beyond the lookup"),
        ("ultrasonic", {"lookup": [(0, 0), (0.5, 0.2), (1, 0.1)]}, "friction_reduction, got 0.2 and 0.1 in rows 1 and"),
        ("ultrasonic", {"lookup": [(0, 0), (0.5, 0.1), (0.5, 0.2)]}, r"of amplitude, got \[0.5, 0.5\] in rows 1"),
        ("ultrasonic", {"lookup": [(0, 0), (60, 0.1), (120, 0.2)]}, "amplitudes from 0 to 1, got 120. Divide them"),
        ("ultrasonic", {"lookup": [(0.1, 0), (0.5, 0.1), (1, 0.2)]}, r"`lookup` must start at \(0, 0\)"),
        ("ultrasonic", {"lookup": [(0, 0), (0.4, 0.1), (0.8, 0.2)]}, "`max_drive` of 1 is beyond the lookup.*at 0.8"),
        ("ultrasonic", {"offset": 0.1}, "`offset` of 0.1 N is less than the 0.1667 N that the drive takes away"),
    ],
)
def test_what_no_profile_can_hold(make_profile, kind, change, message):
    with pytest.raises(ValueError, match=message):
        make_profile(**{"kind": kind, **change})


def _replace(old, new):
    return lambda text: text.replace(old, new)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("display.json", _replace('"version": 1', '"version": 2'), '"version": 1'),
        ("display.json", _replace('"force": "N"', '"force": "mN"'), "`units` must be.*'force': 'N'.*got.*'mN'"),
        ("display.json", _replace('"offset"', '"ofset"'), r"lacks \['offset'\] and has unknown \['ofset'\]"),
        ("display.json", _replace('"ultrasonic"', '["ultrasonic"]'), "`kind` must be one of"),
        ("display.json", _replace('"offset": 0.3', '"offset": NaN'), r"display.json cannot .*\(`offset` must be"),
        ("display.json", _replace("display.lookup.csv", "../x.csv"), "`lookup` must be the name of a CSV"),
        (
            "display.json",
            _replace("display.lookup.csv", "x.csv"),
            "x.csv, which .*names as its `lookup`, does not exist",
        ),
        (
            "display.lookup.csv",
            lambda text: "",
            "display.lookup.csv cannot be read as CSV.*its header is empty, not amplitude,friction_reduction",
        ),
        ("display.lookup.csv", _replace("friction_reduction", "friction"), "its header is amplitude,friction, not"),
        ("display.lookup.csv", lambda text: text.split()[0], "has no rows below its header"),
        ("display.lookup.csv", lambda text: text + "x,1", "cannot be read as CSV.*could not convert string 'x'"),
        ("display.lookup.csv", lambda text: text + "0.5,0.1", r"display.json cannot .*`lookup` must have incr"),
    ],
)
def test_damaged_files_are_refused(tmp_path, make_profile, name, change, message):
    make_profile("ultrasonic").save(tmp_path / "display.json")
    text = (tmp_path / name).read_text(encoding="utf-8")
    assert change(text) != text
    (tmp_path / name).write_text(change(text), encoding="utf-8")
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        DriveProfile.load(tmp_path / "display.json")


def test_a_lookup_from_a_spreadsheet(tmp_path, make_profile):
    profile, table = make_profile("ultrasonic"), tmp_path / "display.lookup.csv"
    profile.save(tmp_path / "display.json")
    table.write_bytes(table.read_text(encoding="utf-8").replace("\n", "\r\n").encode("utf-8-sig") + b"\r\n")
    assert DriveProfile.load(tmp_path / "display.json") == profile


def test_a_failed_save_leaves_the_old_files(tmp_path, make_profile, monkeypatch):
    path = tmp_path / "display.json"
    make_profile("ultrasonic").save(path)
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}

    def fail(*_, **__):
        raise OSError("disk full")

    monkeypatch.setattr("tactile_diffusers.display.drive_files._json", fail)
    with pytest.raises(OSError, match="disk full"):
        make_profile("ultrasonic", offset=0.4).save(path)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_a_static_curve_that_saturates_is_all_that_is_known(tmp_path, response):
    """Ten points of volts and newtons, no corner: steady forces go there and back, and nothing is inverted."""
    volts = np.linspace(0, 180, 10)
    curve = np.column_stack([volts, 0.12 * np.tanh((volts / 90) ** 2) + 1e-4 * volts])
    profile = DriveProfile(
        kind="electroadhesion", gain=1.0, offset=0.3, max_drive=180.0, normal_force=0.5, lookup=curve
    )
    profile.save(tmp_path / "display.json")
    assert (tmp_path / "display.lookup.csv").read_text().startswith("voltage,friction_increase\n")
    profile = DriveProfile.load(tmp_path / "display.json")
    assert profile.force_range == pytest.approx((0, curve[-1, 1]))
    force = np.linspace(0, curve[-1, 1], 50)
    np.testing.assert_allclose(profile.steady_force(profile.steady_drive(force)), force, atol=1e-6)
    np.testing.assert_allclose(profile.steady_force(-volts), curve[:, 1], atol=1e-12)  # -V pulls as V does
    found = response(profile, np.array([20.0, 200.0, 1000.0]), 80.0)
    np.testing.assert_allclose(np.abs(found), 1, atol=0.02)
