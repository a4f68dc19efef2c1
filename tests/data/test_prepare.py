"""Options of the preparation: what is held out, what is done about turnarounds, what is refused, and the account."""

import shutil

import h5py
import numpy as np
import pytest

from tactile_diffusers.data import (
    PreparedDataset,
    RecordingsWriter,
    pool_ratings,
    prepare_recordings,
)
from tactile_diffusers.data.recordings import RaterScores
from tactile_diffusers.data.segments import REASONS
from tactile_diffusers.data.splits import SPLITS, HoldOut
from tactile_diffusers.signal import DEVICE_RATE, RATING_AXES

SURFACES = ("0-rubber", "1-wood", "2-wood", "3-metal", "4-rubber", "5-glass", "6-paper")
RATERS = ("r1", "r2", "r3", "r4", "r10")
HARD = HoldOut(surfaces=("*-rubber",), explorers=("e2",), raters=("r4", "r1?"))


@pytest.fixture
def answers():
    return np.random.default_rng(0).integers(0, 9, (len(RATERS), len(SURFACES), 3)).astype(np.float32)


@pytest.fixture
def collection(tmp_path, recording_maker, answers):
    """Seven surfaces of five classes, two explorers, five raters."""
    path = tmp_path / "r.h5"
    with RecordingsWriter(path, source="a test", licence="CC0-1.0") as writer:
        for number, surface in enumerate(SURFACES):
            for explorer in ("e1", "e2"):
                writer.add_recording(surface, explorer, "0", **recording_maker(seconds=3.0, seed=number))
        writer.set_ratings(answers, RATERS, SURFACES, RATING_AXES)
    return path


def members(path, split):
    """Surfaces and explorers of a split."""
    data = PreparedDataset(path, split)
    names = [data.recordings[number].split("/") for number in data.recording_ids]
    return {name[0] for name in names}, {name[1] for name in names}


def test_hard_split_is_new_in_every_respect(collection, tmp_path):
    report = prepare_recordings(collection, tmp_path / "p.h5", hold_out=HARD, quiet=True)
    ordinary = {name: members(tmp_path / "p.h5", name) for name in SPLITS[:3]}
    assert members(tmp_path / "p.h5", "hard") == ({"0-rubber", "4-rubber"}, {"e2"})
    assert set.union(*(surfaces for surfaces, _ in ordinary.values())) == set(SURFACES) - {"0-rubber", "4-rubber"}
    assert all(explorers == {"e1"} for _, explorers in ordinary.values())
    everything = PreparedDataset(tmp_path / "p.h5", "all")
    assert len(everything) == sum(len(PreparedDataset(tmp_path / "p.h5", name)) for name in ordinary)
    assert everything.splits.count("hard") == 2 and everything.attributes["hold_out"]["explorers"] == ["e2"]
    assert report.surfaces == {"train": 3, "validation": 1, "test": 1, "hard": 2}
    assert report.segments["filtered"] == {"train": 6, "validation": 2, "test": 2, "hard": 4}
    assert "hard 2" in str(report)


def test_hard_ratings_are_the_held_out_raters(collection, tmp_path, answers):
    prepare_recordings(collection, tmp_path / "p.h5", hold_out=HARD, quiet=True)
    train, hard = (PreparedDataset(tmp_path / "p.h5", split) for split in ("train", "hard"))
    training = np.array([split == "train" for split in train.splits])
    for data, chosen in ((train, [0, 1, 2]), (hard, [3, 4])):
        names = tuple(RATERS[number] for number in chosen)
        expected = pool_ratings(RaterScores(answers[chosen], names, SURFACES, RATING_AXES), SURFACES, training)
        np.testing.assert_array_equal(data.ratings.mean, expected.mean)
        np.testing.assert_array_equal(data.ratings.raw_mean, expected.raw_mean)
        np.testing.assert_array_equal(data.ratings.reliability.mean_correlation, expected.reliability.mean_correlation)
        assert data.ratings.count.max() == len(chosen)
        np.testing.assert_array_equal(data[0]["ratings"], expected.mean[data.surface_ids[0]])


def test_what_is_held_out_leaves_no_trace_in_ordinary_splits(collection, tmp_path):
    shutil.copy(collection, tmp_path / "other.h5")
    rng = np.random.default_rng(1)
    with h5py.File(tmp_path / "other.h5", "r+") as file:
        # every recording of a held-out surface or explorer, every answer about such a surface or by such a rater
        held = [f"{s}/{e}" for s in SURFACES for e in ("e1", "e2") if e == "e2" or s.endswith("rubber")]
        for name in held:
            force = file[f"recordings/{name}/0/force"]
            force[:, 0] = 2 * force[:, 0] + 0.01 * rng.standard_normal(len(force))
        values = file["ratings/values"][()]
        of_surfaces = np.array([name.endswith("rubber") for name in SURFACES])
        values[:, of_surfaces], values[3:] = 8 - values[:, of_surfaces], 8 - values[3:]
        file["ratings/values"][...] = values
    for name in ("r", "other"):
        prepare_recordings(tmp_path / f"{name}.h5", tmp_path / f"p-{name}.h5", hold_out=HARD, quiet=True)
    for split in (*SPLITS[:3], "all"):
        one, other = (PreparedDataset(tmp_path / f"p-{name}.h5", split) for name in ("r", "other"))
        assert len(one) == len(other) > 0
        for first, second in zip(one, other, strict=True):
            assert first.keys() == second.keys()
            for key in first:
                np.testing.assert_array_equal(first[key], second[key])
        np.testing.assert_array_equal(one.ratings.raw_mean, other.ratings.raw_mean)
        np.testing.assert_array_equal(one.ratings.raw_scale, other.ratings.raw_scale)
    hard = [PreparedDataset(tmp_path / f"p-{name}.h5", "hard") for name in ("r", "other")]
    assert hard[0].levels.mean() + 0.3 < hard[1].levels.mean()
    assert (hard[0].ratings.mean != hard[1].ratings.mean).any()


@pytest.mark.parametrize(
    "hold_out, hard, explorers",
    [
        (HoldOut(surfaces=("*-wood", "3-*")), {"1-wood", "2-wood", "3-metal"}, {"e1", "e2"}),
        (HoldOut(explorers=("e2",)), set(SURFACES), {"e2"}),
        (HoldOut(raters=("r1",)), set(SURFACES), {"e1", "e2"}),
    ],
)
def test_a_kind_without_patterns_is_not_held_out(collection, tmp_path, hold_out, hard, explorers):
    prepare_recordings(collection, tmp_path / "p.h5", hold_out=hold_out, quiet=True)
    assert members(tmp_path / "p.h5", "hard") == (hard, explorers)
    surfaces, who = members(tmp_path / "p.h5", "all")
    assert surfaces == (set(SURFACES) - hard if hold_out.surfaces else set(SURFACES))
    assert who == ({"e1"} if hold_out.explorers else {"e1", "e2"})
    raters = PreparedDataset(tmp_path / "p.h5", "hard").ratings.count.max()
    assert raters == (1 if hold_out.raters else 5)


def test_without_hold_out_there_is_no_hard_split(collection, tmp_path):
    report = prepare_recordings(collection, tmp_path / "p.h5", quiet=True)
    assert "hard" not in str(report)
    few = "1 validation surface and 1 test surface with segments: evaluation needs 2 of each; prepare with --test 2"
    assert f"note: {few}" in str(report)
    assert "evaluation needs" not in str(prepare_recordings(collection, tmp_path / "p.h5", test=2, validation=0))
    with pytest.raises(ValueError, match="no filtered segment in the split 'hard'"):
        PreparedDataset(tmp_path / "p.h5", "hard")


@pytest.mark.parametrize(
    "hold_out, message",
    [
        (dict(surfaces=("*-leather",)), r"`hold_out.surfaces`: '\*-leather' matches none of the 7: 0-rubber, 1-wood"),
        (dict(surfaces=("*-wood", "wood")), r"`hold_out.surfaces`: 'wood' matches none"),
        (dict(surfaces=("*",)), r"`hold_out.surfaces` \('\*',\) match all 7 .*nothing is left for training"),
        (dict(explorers=("E2",)), r"`hold_out.explorers`: 'E2' matches none of the 2: e1, e2"),
        (dict(raters=("r*",)), r"`hold_out.raters` .* match all 5"),
        (dict(surfaces=("[0-4]*",)), "leave none of 2 surfaces for training"),
        (dict(surfaces=("1-wood",), explorers=("e1",), raters=("r1", "r")), "'r' matches none of the 5"),
    ],
)
def test_what_cannot_be_held_out_is_refused(collection, tmp_path, hold_out, message):
    with pytest.raises(ValueError, match=message):
        prepare_recordings(collection, tmp_path / "p.h5", hold_out=HoldOut(**hold_out), quiet=True)
    assert [path.name for path in tmp_path.iterdir()] == ["r.h5"]


@pytest.mark.parametrize("arguments", [{}, {"surfaces": "*-wood"}, {"raters": ("",)}, {"explorers": (3,)}])
def test_hold_out_refuses(arguments):
    with pytest.raises(ValueError, match="pattern"):
        HoldOut(**arguments)


@pytest.fixture
def strokes(tmp_path, recording_maker):
    """Three surfaces; the finger turns at 2 and 5 s of 8 s."""
    path = tmp_path / "strokes.h5"
    with RecordingsWriter(path, source="a test", licence="CC0-1.0") as writer:
        for number, surface in enumerate("abc"):
            recording = recording_maker(seconds=8.0, seed=number)
            backwards = (np.arange(4000) >= 1000) & (np.arange(4000) < 2500)
            recording["velocity"][backwards] *= -1
            recording["force"][np.repeat(backwards, 20), :2] *= -1
            writer.add_recording(surface, "e", "0", **recording)
    return path


def prepared_with(path, turnarounds):
    target = path.with_name(f"{turnarounds}.h5")
    prepare_recordings(path, target, quiet=True, validation=0, test=0, turnarounds=turnarounds)
    return PreparedDataset(target)


def test_keep_and_mask(strokes):
    keep, mask = prepared_with(strokes, "keep"), prepared_with(strokes, "mask")
    assert len(keep) == len(mask) and (keep.segments.turnarounds == mask.segments.turnarounds).all()
    steady = mask.levels[mask.segments.turnarounds == 0].mean()
    np.testing.assert_allclose(mask.levels, steady, atol=0.05)
    assert keep.levels[keep.segments.turnarounds > 0].min() > steady + 0.5
    for name, data in (("keep", keep), ("mask", mask)):
        assert data.attributes["turnarounds"] == name
        # the swing at the turnaround is not part of it; 2 % is what the smoothed direction loses beside it
        np.testing.assert_allclose(data.friction_coefficients, 0.6, rtol=0.02)


def test_seconds_by_reason(tmp_path, recording_maker, recordings_writer):
    recordings = {"a": recording_maker(seconds=5.0), "b": recording_maker(seconds=4.0, speed=20.0, seed=1)}
    recordings["c"] = recording_maker(seconds=4.0, seed=2)
    recordings["c"]["force"][20_000:20_100] = np.nan
    recordings["c"]["force"][30_000:30_100, 0] = 1.0
    path = recordings_writer(tmp_path / "r.h5", recordings)
    report = prepare_recordings(path, tmp_path / "p.h5", validation=0, test=0, quiet=True)
    for subset in ("filtered", "full"):
        seconds = PreparedDataset(tmp_path / "p.h5", subset=subset).seconds_by_reason()
        assert list(seconds.index) == ["a/explorer/0", "b/explorer/0", "c/explorer/0"]
        assert tuple(seconds.columns) == REASONS
        np.testing.assert_allclose(seconds.sum(axis=1), [5, 4, 4])
        assert report.seconds[subset] == pytest.approx(seconds.sum().to_dict())
    filtered = PreparedDataset(tmp_path / "p.h5").seconds_by_reason()
    np.testing.assert_allclose(filtered["speed outside limits"], [0, 3.8, 0])
    np.testing.assert_allclose(filtered["missing (NaN)"], [0, 0, 0.01])
    np.testing.assert_allclose(filtered["saturated"], [0, 0, 0.01])
    np.testing.assert_allclose(filtered["used"].iloc[0], 4.8)
    assert "saturated samples excluded, in 1 recordings, first c/explorer/0 (the first is 30000)" in report.notes
    assert "missing samples (NaN) excluded, in 1 recordings, first c/explorer/0" in report.notes


def test_little_use_and_clocks_apart_are_said(tmp_path, recording_maker, recordings_writer):
    made = {name: recording_maker(seconds=4.0, seed=seed) for seed, name in enumerate("abc")}
    report = prepare_recordings(recordings_writer(tmp_path / "r.h5", made), tmp_path / "p.h5", quiet=True)
    assert "WARNING" not in str(report) and "offset" not in str(report)
    for recording in made.values():
        recording["force"][[10_000, 20_000, 20_001, 20_030]] = np.nan  # 0.1 ms and 0.2 ms
    made["b"]["velocity"] = made["b"]["velocity"] * np.where(np.arange(2000) < 400, -1, 1)[:, None]
    report = prepare_recordings(recordings_writer(tmp_path / "r.h5", made), tmp_path / "p.h5", quiet=True)
    assert "note: bridged by straight lines: gaps of up to 0.001 s in the force (12 samples)" in str(report)
    assert "points with the motion in 20% of the time (in b/explorer/0, the worst): is `offset`" in str(report)
    for name in "ac":
        for start in range(5000, 40_000, 10_000):
            made[name]["force"][start : start + 20] = np.nan
    report = prepare_recordings(recordings_writer(tmp_path / "r.h5", made), tmp_path / "p.h5", quiet=True)
    assert "note: WARNING: only 4 of 12 s within the limits of force and speed are used. Largest cause: missing" in str(
        report
    )


@pytest.mark.parametrize(
    "factor, axes, message", [(1000, "xyz", "divide by 1000"), (1, "zyx", "x looks like the normal")]
)
def test_unusable_forces_leave_no_file(tmp_path, recordings_writer, factor, axes, message):
    angle = 6.0 * np.arange(40_000) / DEVICE_RATE
    force = factor * np.stack([0.3 * np.cos(angle), 0.3 * np.sin(angle), np.full(40_000, 0.5)], axis=-1)
    force = force[:, ["xyz".index(axis) for axis in axes]]
    velocity = 80 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[::20]
    recording = dict(force=force, force_rate=DEVICE_RATE, velocity=velocity, velocity_rate=500)
    path = recordings_writer(tmp_path / "r.h5", {name: recording for name in "abc"})
    with pytest.raises(ValueError, match=f"r.h5, /recordings/a/explorer/0/force: .*{message}"):
        prepare_recordings(path, tmp_path / "p.h5", quiet=True)
    assert [file.name for file in tmp_path.iterdir()] == ["r.h5"]


def test_lateral_force_alone(tmp_path):
    """No normal force and no velocity: limits are skipped, what depends on them is NaN, the rest is there."""
    rng = np.random.default_rng(0)
    with RecordingsWriter(tmp_path / "r.h5", source="a test", licence="CC0-1.0") as writer:
        for surface in "abc":
            lateral = 0.3 + 0.01 * rng.standard_normal(40_000)
            writer.add_recording(surface, "e", "0", lateral=lateral, lateral_rate=DEVICE_RATE)
    report = prepare_recordings(tmp_path / "r.h5", tmp_path / "p.h5", validation=1, test=1, quiet=True)
    for name in ("normal_force", "speed"):
        assert f"no channel for the limits of {name}: skipped, in 3 recordings, first a/e/0" in report.notes
    data = PreparedDataset(tmp_path / "p.h5")
    assert len(data) == len(PreparedDataset(tmp_path / "p.h5", subset="full")) > 0
    assert np.isnan(data.friction_coefficients).all() and np.isnan(data.speeds).all()
    assert data.ratings.reliability is None
    assert np.isfinite(data.levels).all() and np.isfinite(data.textures(range(len(data)))).all()
    assert data.ratings.count.max() == 0


def test_recordings_are_not_replaced_by_what_is_prepared_of_them(tmp_path):
    (tmp_path / "r.h5").write_bytes(b"a recording")
    (tmp_path / "link.h5").symlink_to("r.h5")
    for prepared in (tmp_path / "r.h5", tmp_path / "link.h5"):
        with pytest.raises(ValueError, match="`prepared` is `recordings`, .* and would replace it"):
            prepare_recordings(tmp_path / "r.h5", prepared, quiet=True)
