"""The laws of virtual surfaces as they are measured, the table of measured hands, and the command that reports them."""

import json

import numpy as np
import pytest
from laws import LAWS, Check, Law, hands, measured, page
from validate_virtual import HUMAN, main, markdown

from tactile_diffusers.virtual import friction, laws, relief

SLOW = {"levels", "compliant_grating", "exploration"}


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
        ("catches", relief, "RELEASE_LENGTH", 0.2),
        ("noise_in_time", friction, "TEMPORAL_NOISE_N", 1.0e-3),
        ("stick_slip", friction, "PERIOD_JITTER", 0.1),
        ("stick_slip", friction, "BURST_SPREAD", 0.2),
        ("stick_slip_comes_and_goes", laws, "STICKS_WHEN_MOIST", 0.0),
        ("onset", laws, "FIRST_SLIP", 0.0),
        ("finger_low_pass", laws, "CUTOFF_PER_SPEED", 11.0),
    ],
)
def test_a_changed_law_is_found(name, where, constant, value, monkeypatch):
    monkeypatch.setattr(where, constant, value)  # where it acts; the check keeps its own copy of what is intended
    assert not LAWS[name](quick=True).ok


def test_a_check_compares_absolutely():
    assert Check("x", 1.0, 1.1, 0.11).ok and not Check("x", 1.0, 0.8, 0.11).ok
    assert not Check("x", 1.0, float("nan"), 0.11).ok


def test_the_command_writes_a_table_and_json(tmp_path, capsys):
    output = tmp_path / "new" / "folder"
    chosen = ["noise_in_time", "harmonic_decay", "onset"]
    assert main(["--output", str(output), "--quick", "--quiet", "--laws", *chosen]) == 0
    assert capsys.readouterr().err == ""
    results = json.loads((output / "validation.json").read_text())
    assert results["ok"] and list(results["laws"]) == chosen and results["quick"]
    check = results["laws"]["noise_in_time"]["checks"][0]
    assert check["intended"] == -1 and abs(check["measured"] + 1) <= check["tolerance"]
    table = (output / "validation.md").read_text()
    assert table.count("| yes |") == sum(len(law["checks"]) for law in results["laws"].values())


def test_a_law_that_is_off_is_said(tmp_path, capsys, monkeypatch):
    wrong = Law("A title", "a source", (Check("some number", 1.0, 2.0, 0.5, "mN"),))
    monkeypatch.setitem(LAWS, "amplitude", lambda quick: wrong)
    assert main(["--output", str(tmp_path), "--quiet", "--laws", "amplitude"]) == 1
    assert "off: amplitude: some number" in capsys.readouterr().out
    assert not json.loads((tmp_path / "validation.json").read_text())["ok"]
    assert "| some number, mN | 1 | 2 | 0.5 | **no** |" in markdown({"amplitude": wrong})


def test_output_must_be_a_folder(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    with pytest.raises(SystemExit):
        main(["--output", str(tmp_path / "file")])
    assert "is a file; give a folder" in capsys.readouterr().err


def test_folder_of_measured_data_must_hold_them(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["--output", str(tmp_path / "out"), "--human", str(tmp_path)])
    assert "has no hatt_summary.json" in capsys.readouterr().err


def _answers(textures=40):
    """Six raters in three trials: slipperiness is roughness turned, and half of every answer is noise."""
    rng = np.random.default_rng(0)
    shared = rng.standard_normal(textures)[:, None] * (1, -1)
    return shared + rng.standard_normal((6, 3, textures, 2))


def test_statistics_of_ratings_on_planted_answers():
    found = measured.rating_statistics(_answers(4000))
    assert found["rough_single"] == pytest.approx(0.5, abs=0.03)
    assert found["slippery_retest"] == pytest.approx(0.5, abs=0.03)
    assert found["rough_means"] == pytest.approx(0.75, abs=0.03)  # Spearman-Brown over three trials
    assert found["within"] == pytest.approx(-0.75, abs=0.03)
    assert found["pooled"] == pytest.approx(-18 / 19, abs=0.03)


def test_range_over_sets_is_that_of_a_mean_of_so_many():
    values = np.random.default_rng(0).standard_normal(5000)
    middle, low, high = hands.over_sets(5000, lambda chosen: {"mean": values[chosen].mean()}, 50, 300)["mean"]
    assert middle == pytest.approx(0, abs=0.05) and (high - low) == pytest.approx(2 * 1.96 / np.sqrt(50), rel=0.15)


def test_a_row_is_inside_if_the_ranges_meet():
    inside = [hands.Row("", "", pair, (0.5, 0.4, 0.6)).inside for pair in ((0.4, 0.4), (0.1, 0.45), (0.7, 0.9))]
    assert inside == [True, True, False] and hands.Row("", "", (0.0, np.inf), (0.5, 0.4, 0.6)).inside


def test_the_page_of_hands_and_its_pictures(tmp_path):
    surfaces, textures, friction_logs, levels = hands.explore_surfaces(6)
    assert len(surfaces) == len(textures) == len(friction_logs) == len(levels) >= 4
    page.draw_shapes(textures, tmp_path / "shapes.png")
    page.draw_segments(surfaces, textures, tmp_path / "segments.png", stroke=textures[0])
    for path, most in (("shapes.png", 60_000), ("segments.png", 100_000)):
        picture = (tmp_path / path).read_bytes()
        assert picture.startswith(b"\x89PNG") and len(picture) < most
    rows = [hands.Row("a law", "HaTT", (2.0, np.inf), (1.0, 0.5, 1.5), "a note", "a reason")]
    names = ("percepts", "plain_percepts", "impressions", "pooled", "plain_pooled", "onset_time", "onset_travel")
    facts = dict.fromkeys(names, 0.125)
    text = page.markdown(rows, facts, 3)
    assert "| a law | > 2 | 1.00 [0.50, 1.50] | **no** | HaTT | a note; a reason |" in text
    assert "0 of 1 rows" in text and "12.5%" in text


@pytest.mark.slow
def test_the_command_compares_with_measured_hands(tmp_path, capsys):
    main(["--output", str(tmp_path), "--quick", "--quiet", "--laws", "hands"])
    results = json.loads((tmp_path / "hands.json").read_text())
    assert "Infinity" not in (tmp_path / "hands.json").read_text()
    assert len(results["rows"]) > 20 and sum(row["inside"] for row in results["rows"]) > 15
    assert not (tmp_path / "validation.md").exists()


@pytest.mark.skipif(not HUMAN.is_dir(), reason="needs the measured data, which may not be published")
def test_quoted_numbers_are_those_of_the_data():
    assert measured.measure_hands(HUMAN) == pytest.approx(measured.QUOTED, abs=0.002)
