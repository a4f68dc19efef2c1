"""The data card: its numbers against independent ones, its warnings, and what it may overwrite."""

import copy
import json
import re
from functools import reduce
from operator import getitem

import h5py
import numpy as np
import pytest
from data_card import describe, write_card
from data_card.advice import warnings_of
from data_card.measure import describe_answers, relate
from scipy.stats import spearmanr

from tactile_diffusers.data import PreparedDataset, RaterScores, RecordingsWriter, SegmentLimits, prepare_recordings
from tactile_diffusers.data.folder import ConversionReport
from tactile_diffusers.data.splits import HoldOut
from tactile_diffusers.signal import DEVICE_RATE, RATING_AXES


@pytest.fixture(scope="module")
def card_folder(virtual_recordings, virtual_prepared, tmp_path_factory):
    folder = tmp_path_factory.mktemp("card") / "card"
    write_card(virtual_recordings, folder, virtual_prepared, quiet=True)
    return folder


@pytest.fixture(scope="module")
def stored(card_folder):
    return json.loads((card_folder / "card.json").read_text(), parse_constant=pytest.fail)


@pytest.fixture
def card(stored):
    return copy.deepcopy(stored)


@pytest.fixture
def undrawn(monkeypatch):
    """Cards without pictures: they take a second, and other tests look at them."""
    monkeypatch.setattr("data_card.writing._draw", lambda *_: [])


@pytest.fixture
def slides(tmp_path, recording_maker, recordings_writer):
    """Recordings and prepared file of steady slides: {surface: changes of `make_recording`}."""

    def make(surfaces, ratings=None, **options):
        path, prepared = tmp_path / "slides.h5", tmp_path / "slides_prepared.h5"
        recordings_writer(path, {name: recording_maker(**changes) for name, changes in surfaces.items()}, ratings)
        prepare_recordings(path, prepared, validation=0, test=0, quiet=True, **options)
        return path, prepared

    return make


def test_folder_is_complete(card_folder, stored):
    names = {path.name for path in card_folder.iterdir()}
    assert names == set(stored["files"]) and "surfaces.png" in names
    text = (card_folder / "card.md").read_text()
    assert set(re.findall(r"\]\((\S+\.png)\)", text)) == {name for name in names if name.endswith(".png")}
    assert all(1000 < path.stat().st_size < 120_000 for path in card_folder.glob("*.png"))


def test_time_is_accounted_for_once(stored, virtual_prepared):
    kept, seconds = stored["kept"], stored["recordings"]["seconds"]
    used = PreparedDataset(virtual_prepared, "all").seconds_by_reason()["used"].sum()
    # numbers have six significant digits
    assert sum(kept["seconds"].values()) == pytest.approx(seconds, rel=1e-5) and seconds == 6 * 12
    assert kept["seconds"]["used"] == pytest.approx(used, rel=1e-5)
    assert kept["kept_share"] == pytest.approx(used / seconds, rel=1e-5)
    assert sum(row["kept_seconds"] for row in stored["surfaces"]) == pytest.approx(used, rel=1e-4)


def test_surfaces_are_those_of_the_index(stored, virtual_prepared):
    data = PreparedDataset(virtual_prepared, "all")
    for number, row in enumerate(stored["surfaces"]):
        mine = data.surface_ids == number
        assert (row["name"], row["split"], row["segments"]) == (data.surfaces[number], data.splits[number], mine.sum())
        assert sum(row["explorers"].values()) == row["segments"]
        rms = np.sqrt(np.mean(np.square(data.textures(np.flatnonzero(mine)), dtype=np.float64), axis=1))
        assert row["level_db"] == pytest.approx(np.mean(20 * np.log10(rms)), abs=1e-3)  # float32 levels
        assert row["friction"] == pytest.approx(data.friction_coefficients[mine].mean(), rel=1e-4)
        assert list(row["ratings"].values()) == pytest.approx(data.ratings.mean[number].tolist(), rel=1e-4)
    counts = stored["preparation"]["segments"]
    assert sum(split["segments"] for split in counts.values()) == len(data)
    assert {name: split["surfaces"] for name, split in counts.items()} == {"train": 4, "validation": 1, "test": 1}


def test_bands_of_white_noise(slides):
    recordings, prepared = slides({"a": {"seconds": 40, "seed": 1}, "b": {"seconds": 40, "seed": 2, "friction": 0.9}})
    numbers = describe(recordings, prepared, quiet=True)
    edges = 20 * 50 ** (np.arange(10) / 9)
    density = 0.01**2 / (DEVICE_RATE / 2)  # one-sided, N^2/Hz
    expected = 10 * np.log10(density * np.diff(edges))
    for row in numbers["surfaces"]:
        # away from the band's edges; 12 s of noise leave 0.6 dB in the narrowest band shown (17 Hz): four sigma is 1.2
        np.testing.assert_allclose(row["bands_db"][1:-1], expected[1:-1], atol=1.2)
    assert [row["friction"] for row in numbers["surfaces"]] == pytest.approx([0.6, 0.9], rel=1e-3)


def test_quantiles_of_speed_and_force_weigh_time(tmp_path, recording_maker, undrawn):
    slow, fast = recording_maker(seconds=32, speed=20.0), recording_maker(seconds=8, speed=80.0, normal_force=0.5)
    with RecordingsWriter(tmp_path / "r.h5", source="a test", licence="CC0-1.0") as writer:
        writer.add_recording("a", "slow", "0", **slow)
        writer.add_recording("a", "fast", "0", **fast)
    card = write_card(tmp_path / "r.h5", tmp_path / "card", quiet=True)
    speed = card["conditions"]["speed"]
    assert list(speed["explorers"]) == ["all", "fast", "slow"] and speed["limits"] == [66, 99]
    for who, values in (("slow", [20] * 5), ("fast", [80] * 5), ("all", [20, 20, 20, 20, 80])):
        assert speed["explorers"][who]["quantiles"] == pytest.approx(values)
    assert speed["explorers"]["all"]["share_inside"] == pytest.approx(0.2)
    assert card["conditions"]["normal_force"]["explorers"]["all"]["share_inside"] == pytest.approx(1)
    assert card["preparation"]["prepared_by"].startswith("this card, with the default limits")
    assert "explorer_without_segment" in {warning["name"] for warning in card["warnings"]}


def test_turnarounds_on_a_line_swing_and_are_masked(tmp_path):
    rng, rate = np.random.default_rng(0), 500
    time = np.arange(60 * rate) / rate
    # strokes of 1 s to and fro in the second half of each 20 s
    swing = np.tanh(np.cos(np.pi * time) / 0.05)
    velocity = 80 * np.where(time % 20 < 10, 1.0, swing)
    at_force_rate = np.interp(np.arange(60 * DEVICE_RATE) / DEVICE_RATE, time, velocity)
    lateral = 0.3 * np.tanh(at_force_rate / 20) + 0.01 * rng.standard_normal(60 * DEVICE_RATE)
    force = np.stack([lateral, 0 * lateral, np.full_like(lateral, 0.5)], axis=-1)
    with RecordingsWriter(tmp_path / "r.h5", source="a test", licence="CC0-1.0") as writer:
        velocity = np.stack([velocity, 0 * velocity], axis=-1)
        writer.add_recording("a", "e", "0", force=force, force_rate=DEVICE_RATE, velocity=velocity, velocity_rate=rate)
    limits = SegmentLimits(speed=None)
    report = {}
    for treatment in ("keep", "mask"):
        prepared = tmp_path / f"{treatment}.h5"
        prepare_recordings(tmp_path / "r.h5", prepared, limits, validation=0, test=0, turnarounds=treatment, quiet=True)
        report[treatment] = describe(tmp_path / "r.h5", prepared, quiet=True)
    assert report["keep"]["bands"]["turnaround_db"] > 1 > abs(report["mask"]["bands"]["turnaround_db"])
    names = {treatment: {w["name"] for w in numbers["warnings"]} for treatment, numbers in report.items()}
    assert "turnarounds" in names["keep"] and "turnarounds" not in names["mask"]


def planted_scores():
    """Five raters who agree, one of whom has `bumpiness` the other way round; rater 4 skipped half of the surfaces."""
    rng = np.random.default_rng(3)
    truth = rng.uniform(1, 7, (20, 3))
    values = np.clip(np.round(truth + rng.normal(0, 0.7, (5, 20, 3))), 0, 8)
    values[2, :, 1] = 8 - values[2, :, 1]
    values[4, ::2] = np.nan
    names = tuple(f"s{i}" for i in range(20))
    return RaterScores(values.astype(np.float32), tuple("abcde"), names, RATING_AXES)


def test_answers_are_counted():
    scores = planted_scores()
    answers = describe_answers(scores, (*scores.surfaces, "unheard of"))
    assert answers["surfaces_unrated"] == ["unheard of"] and answers["surfaces_rated"] == 20
    for number, axis in enumerate(RATING_AXES):
        entry, values = answers["axes"][axis], scores.values[:, :, number]
        known = values[~np.isnan(values)]
        assert entry["counts"].tolist() == np.bincount(known.astype(int), minlength=9).tolist()
        assert entry["missing_share"] == pytest.approx(10 / 100)
        assert (entry["fewest_raters"], entry["most_raters"]) == (4, 5)
        assert entry["low_end_share"] == pytest.approx(np.mean(known == 0))
    with_others = answers["axes"]["bumpiness"]["with_others"]
    assert with_others["c"] < -0.5 and min(with_others[who] for who in "abde") > 0.3
    assert min(answers["axes"]["roughness"]["with_others"].values()) > 0.8


def test_relation_is_spearmans_and_knows_chance():
    rng = np.random.default_rng(0)
    ratings = rng.normal(size=(40, 3))
    level, friction = ratings[:, 0] ** 3, rng.normal(size=40)
    friction[5] = np.nan
    relation = relate(ratings, {"level": level, "friction": friction, "nowhere known": np.full(40, np.nan)})
    known = ~np.isnan(friction)
    assert relation["surfaces"] == 39 and list(relation["spearman"]) == ["level", "friction"]
    for number, axis in enumerate(RATING_AXES):
        expected = spearmanr(friction[known], ratings[known, number]).statistic
        assert relation["spearman"]["friction"][axis] == pytest.approx(expected, abs=1e-12)
    assert relation["spearman"]["level"]["roughness"] == pytest.approx(1) and relation["unrelated"] < 1e-9
    assert relate(ratings, {"friction": rng.normal(size=40)})["unrelated"] > 0.05
    assert relate(ratings, {"level": np.ones(40)})["unrelated"] == 1
    assert relate(ratings[:7], {"level": level[:7]}) is None


def _relation(quantity, axis, rho, unrelated=0.001):
    return {"surfaces": 9, "largest": abs(rho), "unrelated": unrelated, "spearman": {quantity: {axis: rho}}}


@pytest.mark.parametrize(
    "path, value, name, said",
    [
        ("recordings/unit", "1", "uncalibrated", "relative"),
        ("recordings/channels", {"lateral": 6, "velocity": 6}, "lateral_only", "6 of 6"),
        ("recordings/channels/velocity", 4, "no_velocity", "2 of 6"),
        ("kept/kept_share", 0.05, "little_kept", "5.0 %"),
        ("kept/seconds/saturated", 0.25, "saturation", "0.25 s"),
        ("kept/seconds/missing (NaN)", 3.0, "missing_samples", "3 s"),
        ("kept/explorers", {"a": {"used": 1.0}, "b": {"used": 0.0}}, "explorer_without_segment", "b."),
        ("surfaces/1/segments", 0, "surface_without_segment", "1 of 6"),
        ("surfaces/1/segments", 2, "few_segments", "fewer than 10"),
        ("surfaces/1/friction", None, "unknown_friction", "1 of 6"),
        ("surfaces/1/friction", 12.0, "strange_friction", "outside"),
        ("bands/turnaround_db", 2.5, "turnarounds", "2.5 dB"),
        ("ratings", None, "no_ratings", "DALE"),
        ("ratings/answers/surfaces_unrated", ["x"], "unrated", "x"),
        ("ratings/answers/axes/bumpiness/alpha", 0.6, "low_reliability", "bumpiness 0.60"),
        ("ratings/answers/axes/bumpiness/alpha", None, "low_reliability", "bumpiness unknown"),
        ("ratings/answers/axes/bumpiness/most_raters", 3, "few_raters", "bumpiness 3"),
        ("ratings/answers/axes/bumpiness/missing_share", 0.2, "missing_answers", "bumpiness 20%"),
        ("ratings/answers/axes/bumpiness/low_end_share", 0.4, "clipped_ratings", "lowest"),
        ("ratings/answers/axes/bumpiness/high_end_share", 0.4, "clipped_ratings", "highest"),
        ("ratings/answers/axes/bumpiness/with_others", {"me": -0.9}, "contrary_raters", "me"),
        ("ratings/pooled/correlation/1/0", -0.95, "correlated_axes", "-0.95"),
        ("ratings/relation", _relation("level", "roughness", 0.3, 0.5), "unrelated", "9 surfaces"),
        ("ratings/relation", _relation("level", "roughness", -0.93), "roughness_turned", "falls with the level"),
        (
            "ratings/relation",
            _relation("friction coefficient", "slipperiness", 0.8),
            "slipperiness_turned",
            "rises with the friction",
        ),
        ("preparation/segments/test/surfaces", 1, "few_held_out", "--test 2 --validation 2"),
    ],
)
def test_each_warning(card, path, value, name, said):
    for row in card["surfaces"]:
        row["segments"] = 50  # twelve seconds a surface are few
    card["ratings"]["relation"] = None
    for entry in card["ratings"]["answers"]["axes"].values():
        entry |= {"low_end_share": 0.1, "high_end_share": 0.1, "with_others": {"me": 0.5}, "alpha": 0.9}
    card["ratings"]["pooled"]["correlation"] = np.eye(3).tolist()
    card["bands"]["turnaround_db"] = 0.1
    for split in ("validation", "test"):
        card["preparation"]["segments"][split]["surfaces"] = 2
    assert [warning["name"] for warning in warnings_of(card)] == ["one_explorer"]
    *parents, last = [int(key) if key.isdigit() else key for key in path.split("/")]
    reduce(getitem, parents, card)[last] = value
    texts = {warning["name"]: warning["text"] for warning in warnings_of(card)}
    assert said in texts[name]
    assert set(texts) <= {"one_explorer", name}


def test_lateral_only_uncalibrated_unrated_single_surface(tmp_path):
    noise = np.random.default_rng(0).normal(size=30_000)
    with RecordingsWriter(tmp_path / "r.h5", source="counts", licence="CC0-1.0") as writer:
        writer.add_recording("only", "robot", "0", lateral=noise, lateral_rate=4000, unit="1")
    card = write_card(tmp_path / "r.h5", tmp_path / "card", quiet=True)
    expected = {"uncalibrated", "lateral_only", "no_velocity", "one_explorer", "one_surface", "few_segments"}
    assert {w["name"] for w in card["warnings"]} == expected | {"unknown_friction", "no_ratings"}
    assert card["conditions"] == {"normal_force": None, "speed": None} and card["ratings"] is None
    assert card["surfaces"][0]["friction"] is None and card["bands"]["turnaround_share"] == 0
    text = (tmp_path / "card" / "card.md").read_text()
    assert "relative to one count" in text and "| nan" not in text and "| None" not in text
    assert "ratings.png" not in card["files"]


def test_surface_outside_the_limits_is_named_with_its_reason(slides):
    recordings, prepared = slides({"good": {}, "pressed": {"normal_force": 2.0}})
    numbers = describe(recordings, prepared, quiet=True)
    pressed = numbers["surfaces"][1]
    assert (pressed["segments"], pressed["level_db"], pressed["kept_seconds"]) == (0, None, 0)
    assert "normal_force" in pressed["mostly_dropped"]
    text = {w["name"]: w["text"] for w in numbers["warnings"]}["surface_without_segment"]
    assert "1 of 2" in text and "pressed" in text and "normal_force" in text


def test_held_out_surfaces_are_counted_apart(slides):
    recordings, prepared = slides({"a": {}, "b": {}, "held": {}}, hold_out=HoldOut(surfaces=("held",)))
    numbers = describe(recordings, prepared, quiet=True)
    segments = numbers["preparation"]["segments"]
    assert segments["hard"] == {"surfaces": 1, "segments": segments["train"]["segments"] // 2}
    assert "surface_without_segment" not in {warning["name"] for warning in numbers["warnings"]}


def test_prepared_from_others_is_refused(virtual_recordings, slides, tmp_path):
    _, prepared = slides({"a": {}})
    with pytest.raises(ValueError, match="slides_prepared.h5 was not prepared from .*recordings.h5.*--prepared"):
        write_card(virtual_recordings, tmp_path / "card", prepared, quiet=True)
    assert not (tmp_path / "card").exists() and not list(tmp_path.glob(".card*"))


def test_what_the_conversion_noted_is_told(slides, tmp_path, undrawn):
    recordings, prepared = slides({"a": {}})
    report = ConversionReport(recordings=1, left_out={"b/0/0": "no file with force"})
    report.note("samples saturated, NaN", 40, "a.csv at 0.2 s")
    with h5py.File(recordings, "a") as file:
        file.attrs["conversion"] = str(report)
    write_card(recordings, tmp_path / "card", prepared, quiet=True)
    text = (tmp_path / "card/card.md").read_text()
    for line in ("40 samples saturated, NaN; first a.csv at 0.2 s", "left out: b/0/0: no file with force"):
        assert line in text


def test_older_card_is_replaced_and_nothing_else(slides, tmp_path, undrawn):
    recordings, prepared = slides({"a": {}})
    output = tmp_path / "card"
    output.mkdir()  # empty: may be taken
    write_card(recordings, output, prepared, quiet=True)
    first = (output / "card.md").stat().st_ino
    write_card(recordings, output, prepared, quiet=True)
    assert (output / "card.md").stat().st_ino != first

    (output / "notes.txt").write_text("mine")
    with pytest.raises(ValueError, match="notes.txt.*which no data card wrote: give a new folder"):
        write_card(recordings, output, prepared, quiet=True)
    assert (output / "notes.txt").read_text() == "mine" and (output / "card.md").exists()
    with pytest.raises(ValueError, match="is a file"):
        write_card(recordings, output / "notes.txt", prepared, quiet=True)
    with pytest.raises(FileNotFoundError, match="create it first"):
        write_card(recordings, tmp_path / "no" / "card", prepared, quiet=True)
    assert {path.name for path in tmp_path.iterdir()} == {"card", "slides.h5", "slides_prepared.h5"}


def test_failure_leaves_the_older_card(slides, tmp_path, undrawn, monkeypatch):
    recordings, prepared = slides({"a": {}})
    write_card(recordings, tmp_path / "card", prepared, quiet=True)
    before = (tmp_path / "card" / "card.json").read_bytes()
    monkeypatch.setattr("data_card.writing._draw", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_card(recordings, tmp_path / "card", prepared, quiet=True)
    assert (tmp_path / "card" / "card.json").read_bytes() == before and not list(tmp_path.glob(".card*"))
