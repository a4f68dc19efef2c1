"""The store of recordings: what goes in comes out, what is wrong is named."""

import subprocess
import sys

import h5py
import numpy as np
import pytest

from tactile_diffusers.data import RecordingsFile, RecordingsWriter, SegmentLimits, prepare_recordings
from tactile_diffusers.signal import RATING_AXES
from tactile_diffusers.signal.constants import LEAST_RECORDING


def test_roundtrip(tmp_path, recording_maker, recordings_writer):
    recording = recording_maker(heading=0.7)
    ratings = np.array([[[1, 2, 3], [4, 5, np.nan]]], dtype=np.float32)
    path = recordings_writer(tmp_path / "r.h5", {"a": recording, "b": recording_maker(seed=1)}, ratings)
    with RecordingsFile(path) as file:
        first, second = list(file)
        assert file.surfaces == ("a", "b") and file.unit == "N" and file.attributes["licence"] == "CC0-1.0"
        np.testing.assert_array_equal(file.ratings.values, ratings)
        assert file.ratings.axes == RATING_AXES
    assert (first.name, first.rate, first.velocity_rate) == ("a/explorer/0", 10_000, 500.0)
    np.testing.assert_array_equal(first.force, np.float32(recording["force"]))
    np.testing.assert_array_equal(first.velocity, np.float32(recording["velocity"]))
    assert first.force.dtype == np.float32 and second.lateral is None


def test_interrupted_writer_leaves_the_old_file(tmp_path, recording_maker, recordings_writer):
    path = recordings_writer(tmp_path / "r.h5", {"old": recording_maker()})
    before = path.read_bytes()
    with pytest.raises(KeyboardInterrupt):
        with RecordingsWriter(path, source="a test", licence="CC0-1.0") as writer:
            writer.add_recording("new", "explorer", "0", **recording_maker())
            raise KeyboardInterrupt
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["r.h5"]


def test_what_was_measured_tells_wrong_units_and_short_runs(tmp_path, recording_maker, recordings_writer):
    recording = recording_maker()
    recording["force"] = recording["force"] / 1000
    path = recordings_writer(tmp_path / "r.h5", {name: recording for name in "abc"})
    with pytest.raises(ValueError, match=r"median 0.0005 N, limits 0.4 to 0.6 N: is the unit right\? \(--normal-force"):
        prepare_recordings(path, tmp_path / "p.h5", quiet=True)
    assert [file.name for file in tmp_path.iterdir()] == ["r.h5"]
    recording = recording_maker()
    recording["velocity"] = recording["velocity"].copy()
    recording["velocity"][(np.arange(2000) % 350) < 75] = [20.0, 0.0]  # 0.55 s inside the limits, 0.15 s slower
    path = recordings_writer(tmp_path / "r.h5", {name: recording for name in "abc"})
    with pytest.raises(ValueError) as raised:
        prepare_recordings(path, tmp_path / "p.h5", quiet=True)
    assert "runs within the limits: median 0.55 s, longest 0.55 s; a segment lasts 1.64 s" in str(raised.value)
    assert "between two runs: median 0.15 s; up to 0.1 s outside the limits are bridged (--longest" in str(raised.value)
    assert "is the unit right" not in str(raised.value)
    report = prepare_recordings(path, tmp_path / "p.h5", SegmentLimits(longest_excursion=0.3), quiet=True)
    assert report.segments["filtered"]["train"]


@pytest.mark.parametrize(("seconds", "segment"), [(1.5, 0.5), (0.25, 0.05)])
def test_short_recordings_give_short_segments(tmp_path, recording_maker, recordings_writer, seconds, segment):
    recording = recording_maker()
    for name, rate in (("force", 10_000), ("velocity", 500)):
        recording[name] = recording[name][: int(seconds * rate)]
    path = recordings_writer(tmp_path / "r.h5", {name: recording for name in "abc"})
    report = prepare_recordings(path, tmp_path / "p.h5", SegmentLimits(seconds=segment, overlap=0), quiet=True)
    assert report.segments["full"]["train"] == (2 if seconds == 1.5 else 1)  # 0.1 s at each end are the filter's
    with pytest.raises(ValueError, match="a segment lasts 1.64 s"):
        prepare_recordings(path, tmp_path / "p.h5", quiet=True)


FORCE, VELOCITY = "recordings/a/explorer/0/force", "recordings/a/explorer/0/velocity"


def stored_as(change):
    """A damage: the force is stored as `change` of it, with its attributes."""

    def damage(file):
        values, attributes = file[FORCE][()], dict(file[FORCE].attrs)
        del file[FORCE]
        file.create_dataset(FORCE, data=change(values)).attrs.update(attributes)

    return damage


def replaced_group(file):
    del file["recordings"]
    file["recordings"] = np.zeros(4)


@pytest.mark.parametrize(
    "damage, message",
    [
        (lambda file: file.attrs.__delitem__("source"), "r.h5, /: it lacks the attribute `source`"),
        (lambda file: file.attrs.update(format="other"), "r.h5, /: format='other'.*Convert the source"),
        (
            lambda file: file[FORCE].attrs.__delitem__("rate"),
            f"r.h5, /{FORCE}: the rate must be a positive number of Hz, got None",
        ),
        (lambda file: file[FORCE].attrs.update(rate="10000"), f"/{FORCE}: the rate must be a positive"),
        (lambda file: file[VELOCITY].attrs.update(rate=[500.0] * 2), f"/{VELOCITY}: the rate must be a positive"),
        (
            lambda file: file[VELOCITY].attrs.__delitem__("unit"),
            f"/{VELOCITY}: the unit must be one of .* got None: convert",
        ),
        (
            stored_as(lambda values: values.astype("S20")),
            rf"/{FORCE}: it holds \|S20, not real numbers: store it as float32",
        ),
        (
            stored_as(lambda values: values[: int(LEAST_RECORDING * 10_000) - 1]),
            f"/{FORCE}: it lasts 0.25 s, the filter needs 0.25 s: leave it out",
        ),
        (lambda file: file.__delitem__(FORCE), r"explorer/0: it has \['velocity'\]: store exactly one of `force`"),
        (lambda file: file.move(FORCE, "recordings/a/force"), "/recordings/a: it is not a group of groups"),
        (lambda file: file.__delitem__("recordings/a"), "r.h5, /recordings: there is no recording"),
        (replaced_group, "r.h5, /recordings: there is no recording"),
        (lambda file: file["ratings/values"].__setitem__((0, 0, 0), 9), "/ratings/values:.*1 ratings lie outside 0-8"),
        (lambda file: file["ratings/surfaces"].__setitem__(0, "nobody"), r"/ratings/surfaces: \['nobody'\] have no"),
    ],
)
def test_bad_files_are_named_when_opened(tmp_path, recording_maker, recordings_writer, damage, message):
    path = recordings_writer(tmp_path / "r.h5", {"a": recording_maker()}, np.full((2, 1, 3), 4.0))
    with h5py.File(path, "r+") as file:
        damage(file)
    with pytest.raises(ValueError, match=message):
        RecordingsFile(path)


def test_attributes_as_matlab_and_c_programs_write_them(tmp_path, recording_maker, recordings_writer):
    """Strings of fixed length, padded, and every number an array of one."""
    path = recordings_writer(tmp_path / "r.h5", {"a": recording_maker()}, np.full((1, 1, 3), 4.0))
    with RecordingsFile(path) as file:
        expected, attributes = next(iter(file)), file.attributes
    with h5py.File(path, "r+") as file:
        nodes = [file, *(file[f"recordings/a/explorer/0/{name}"] for name in ("force", "velocity"))]
        for node in nodes:
            for name, value in dict(node.attrs).items():
                text = isinstance(value, str)
                node.attrs[name] = np.array(value.encode() + b"  ") if text else np.array([[value]], np.float64)
        for name in ("raters", "surfaces", "axes"):
            strings = [value.decode() for value in file[f"ratings/{name}"][()]]
            del file[f"ratings/{name}"]
            file[f"ratings/{name}"] = np.array(strings, dtype="S20")
    with RecordingsFile(path) as file:
        found = next(iter(file))
        assert file.ratings.surfaces == ("a",) and file.ratings.axes == RATING_AXES
        assert file.attributes == attributes and file.unit == "N" and file.rate(file.names[0]) == expected.rate
    np.testing.assert_array_equal(found.force, expected.force)
    for name in ("rate", "velocity_rate", "unit", "notes"):
        assert getattr(found, name) == getattr(expected, name)


def test_truncated_file(tmp_path, recording_maker, recordings_writer):
    path = recordings_writer(tmp_path / "r.h5", {"a": recording_maker()})
    path.write_bytes(path.read_bytes()[:10_000])
    with pytest.raises(ValueError, match="r.h5 is truncated or not an HDF5 file.*Copy it again"):
        RecordingsFile(path)
    with pytest.raises(FileNotFoundError, match="absent.h5"):
        RecordingsFile(tmp_path / "absent.h5")


def test_locked_file(tmp_path, recording_maker, recordings_writer):
    path = recordings_writer(tmp_path / "r.h5", {"a": recording_maker()})
    code = "import h5py, sys; f = h5py.File(sys.argv[1], 'r+'); print('open', flush=True); sys.stdin.read()"
    writer = subprocess.Popen([sys.executable, "-c", code, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        assert writer.stdout.readline() == b"open\n"
        with pytest.raises(ValueError, match="r.h5 is locked: another process has it open for writing"):
            RecordingsFile(path)
    finally:
        writer.communicate()
    RecordingsFile(path).close()


def test_swapped_axes_and_suspicious_forces(tmp_path, recording_maker, recordings_writer):
    swapped, glitch = recording_maker(), recording_maker()
    swapped["force"] = swapped["force"][:, [2, 1, 0]]
    swapped["force"][:15_000, 2] *= -1  # friction turns with the finger, the normal force does not
    glitch["force"][1234, 1] = 1e4
    path = recordings_writer(tmp_path / "r.h5", {"a": swapped, "b": glitch})
    with RecordingsFile(path) as file:
        with pytest.raises(
            ValueError, match="/recordings/a/explorer/0/force: z changes sign .* x looks like the normal"
        ):
            file.read("a/explorer/0")
        assert file.read("b/explorer/0").notes == ("samples above 100 N excluded (1, first at sample 1234)",)


def test_infinite_values_are_missing(tmp_path, recording_maker, recordings_writer):
    recording = recording_maker()
    recording["force"][:2, 2] = np.inf, -np.inf
    recording["velocity"][7, 1] = np.inf
    with RecordingsFile(recordings_writer(tmp_path / "r.h5", {"a": recording})) as file:
        read = next(iter(file))
    assert np.argwhere(np.isnan(read.force)).tolist() == [[0, 2], [1, 2]] and not np.isinf(read.force).any()
    assert np.argwhere(np.isnan(read.velocity)).tolist() == [[7, 1]] and read.notes == ()


@pytest.mark.parametrize(
    "change, message",
    [
        ({"force": None}, "exactly one of `force`"),
        ({"lateral": np.zeros(20_000), "lateral_rate": 10_000}, "exactly one of `force`"),
        ({"force_rate": None}, "`force`: the rate must be a positive"),
        ({"velocity_rate": 0}, "`velocity`: the rate must be a positive"),
        ({"velocity": np.zeros(2000)}, "`velocity`: the shape must be"),
        ({"unit": "mN"}, "`force`: the unit must be one of.*convert"),
    ],
)
def test_writer_refuses(tmp_path, recording_maker, change, message):
    with pytest.raises(ValueError, match=message):
        with RecordingsWriter(tmp_path / "r.h5", source="a test", licence="CC0-1.0") as writer:
            writer.add_recording("a", "explorer", "0", **{**recording_maker(), **change})
    assert not list(tmp_path.iterdir())


def test_writer_refuses_names_with_slash_and_ratings_off_scale(tmp_path, recording_maker):
    with pytest.raises(ValueError, match="without '/'"):
        with RecordingsWriter(tmp_path / "r.h5", source="a test", licence="CC0-1.0") as writer:
            writer.add_recording("a/b", "explorer", "0", **recording_maker())
    with pytest.raises(ValueError, match="lie outside 0-8"):
        with RecordingsWriter(tmp_path / "r.h5", source="a test", licence="CC0-1.0") as writer:
            writer.set_ratings(np.full((1, 1, 3), -1), ["r"], ["a"], RATING_AXES)
    with pytest.raises(FileNotFoundError, match="does not exist"):
        with RecordingsWriter(tmp_path / "nowhere" / "r.h5", source="a test", licence="CC0-1.0"):
            pass
