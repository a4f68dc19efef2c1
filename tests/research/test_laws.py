"""The laws of virtual surfaces as they are measured, and the command that reports them."""

import json

import pytest
from laws import LAWS, Check, Law
from validate_virtual import main, markdown

from tactile_diffusers.virtual import exploration, friction, laws

SLOW = {"levels", "compliant_grating", "raters", "exploration"}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in LAWS]
)
def test_law_is_as_intended(name):
    # tolerances and their reasons stand beside the measurements
    law = LAWS[name](quick=True)
    assert law.checks and [check for check in law.checks if not check.ok] == []


@pytest.mark.parametrize(
    "name, where, constant, value",
    [
        ("amplitude", laws, "AMPLITUDE_LOAD_EXPONENT", 0.7),
        ("noise_in_time", friction, "TEMPORAL_NOISE_N", 1.0e-3),
        ("stick_slip", friction, "PERIOD_JITTER", 0.1),
        ("finger_low_pass", laws, "CUTOFF_PER_SPEED", 11.0),
        ("further_explorers", exploration, "EXPLORERS", exploration.EXPLORERS[:1]),
    ],
)
def test_a_changed_law_is_found(name, where, constant, value, monkeypatch):
    monkeypatch.setattr(where, constant, value)  # where it acts; the check keeps its own copy of what is intended
    assert not LAWS[name](quick=True).ok


def test_the_command_writes_pictures_tables_and_json(tmp_path, capsys):
    output = tmp_path / "new" / "folder"
    chosen = ["noise_in_time", "harmonic_decay", "further_explorers"]
    assert main(["--output", str(output), "--quick", "--quiet", "--laws", *chosen]) == 0
    assert capsys.readouterr().err == ""
    results = json.loads((output / "validation.json").read_text())
    assert results["ok"] and list(results["laws"]) == chosen and results["quick"]
    check = results["laws"]["noise_in_time"]["checks"][0]
    assert check["intended"] == -1 and abs(check["measured"] + 1) <= check["tolerance"]
    table = (output / "validation.md").read_text()
    for name in chosen:
        assert f"({name}.png)" in table
        picture = (output / f"{name}.png").read_bytes()
        assert picture.startswith(b"\x89PNG") and len(picture) < 60_000
    assert table.count("| yes |") == sum(len(law["checks"]) for law in results["laws"].values())


def test_a_law_that_is_off_is_said(tmp_path, capsys, monkeypatch):
    wrong = Law("A title", "a source", (Check("some number", 1.0, 2.0, 0.5, "mN"),), 1, lambda panels: None)
    monkeypatch.setitem(LAWS, "amplitude", lambda quick: wrong)
    assert main(["--output", str(tmp_path), "--quiet", "--laws", "amplitude"]) == 1
    assert "off: amplitude: some number" in capsys.readouterr().out
    assert not json.loads((tmp_path / "validation.json").read_text())["ok"]
    assert "| some number, mN | 1 | 2 | 0.5 | **no** |" in markdown({"amplitude": wrong})
