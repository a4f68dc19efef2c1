"""recordings.h5 as a folder: nothing lost, nothing half-written, nothing that a file cannot be named."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactile_diffusers.data import RecordingsFile, RecordingsWriter
from tactile_diffusers.data.folder import folder_export
from tactile_diffusers.data.folder.convert import convert_folder
from tactile_diffusers.data.folder.folder_export import EXPORT_KINDS, export_folder
from tactile_diffusers.data.folder.layout import load_layout
from tactile_diffusers.data.folder.tables import read_table


def write(path, recordings, ratings=None, **attributes):
    """Writes {(surface, explorer, trial): keyword arguments}; `ratings` are the arguments of `set_ratings`."""
    with RecordingsWriter(path, source="a test", licence="CC0-1.0", **attributes) as writer:
        for name, recording in recordings.items():
            writer.add_recording(*name, **recording)
        if ratings is not None:
            writer.set_ratings(*ratings)
    return path


def back(folder, tmp_path):
    """Converts an exported folder with its own layout; returns the recordings and the ratings."""
    convert_folder(folder, folder / "layout.toml", tmp_path / "back.h5", quiet=True)
    with RecordingsFile(tmp_path / "back.h5") as file:
        return {recording.name: recording for recording in file}, file.ratings


@pytest.mark.parametrize("kind", EXPORT_KINDS)
def test_names_gaps_and_rates_survive(tmp_path, recording_maker, kind):
    # Names with what file names may hold, two rates of velocity, samples that are missing.
    first, second = recording_maker(seconds=2), recording_maker(seconds=2, seed=1)
    first["force"][100:110], second["velocity"] = np.nan, second["velocity"][::2]
    second["velocity_rate"] = 250
    recordings = {("Leder, 3 µm {rau}", "P_1", "trial-1"): first, ("01", "P_2", "2_force"): second}
    export_folder(write(tmp_path / "r.h5", recordings), tmp_path / "folder", kind, quiet=True)
    found, ratings = back(tmp_path / "folder", tmp_path)
    assert set(found) == {"/".join(name) for name in recordings} and ratings is None
    for name, recording in recordings.items():
        other = found["/".join(name)]
        np.testing.assert_array_equal(other.force, np.float32(recording["force"]))
        np.testing.assert_array_equal(other.velocity, np.float32(recording["velocity"]))
        assert other.velocity_rate == recording["velocity_rate"]


@pytest.mark.parametrize("kind", EXPORT_KINDS)
def test_lateral_force_alone_in_counts(tmp_path, kind):
    counts = np.random.default_rng(0).integers(-2000, 2000, 5000).astype(float)
    velocity = np.ones((500, 2))
    both = dict(lateral=counts, lateral_rate=2200, velocity=velocity, velocity_rate=200, unit="1")
    alone = dict(lateral=counts[::-1], lateral_rate=2200, unit="1")
    path = write(tmp_path / "r.h5", {("a", "robot", "0"): both, ("b", "robot", "0"): alone})
    export_folder(path, tmp_path / "folder", kind, quiet=True)
    found, _ = back(tmp_path / "folder", tmp_path)
    np.testing.assert_array_equal(found["a/robot/0"].lateral, np.float32(counts))
    np.testing.assert_array_equal(found["a/robot/0"].velocity, velocity)
    np.testing.assert_array_equal(found["b/robot/0"].lateral, np.float32(counts[::-1]))
    assert found["b/robot/0"].velocity is None and found["b/robot/0"].unit == "1"


def test_ratings_with_gaps_and_further_axes(tmp_path, recording_maker):
    rng = np.random.default_rng(0)
    values = rng.uniform(0, 8, (3, 2, 4)).astype(np.float32)
    values[0, 1], values[1, 0, 2] = np.nan, np.nan
    names = ["NA", "Dr. B, jr.", "3"], ["a", "b"], ["bumpiness", "warm-cold", "roughness", "slipperiness"]
    recordings = {(surface, "e", "0"): recording_maker(seconds=2) for surface in "ab"}
    path = write(tmp_path / "r.h5", recordings, (values, *names))
    export_folder(path, tmp_path / "folder", "npy", quiet=True)
    _, ratings = back(tmp_path / "folder", tmp_path)
    assert ratings.raters == tuple(names[0]) and ratings.surfaces == ("a", "b")
    order = [names[2].index(axis) for axis in ratings.axes]
    assert sorted(order) == [0, 1, 2, 3]
    # the way through the scale of the layout costs at most one rounding
    np.testing.assert_allclose(ratings.values, values[:, :, order], rtol=2**-23)


@given(arrays(np.float32, (7, 3), elements=st.floats(width=32, allow_infinity=False)))
@settings(max_examples=200, deadline=None)
def test_every_float32_survives_in_text(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("float") / "t.csv"
    folder_export._write_csv(path, {"force": folder_export._Channel(values, ["fx_N", "fy_N", "fz_N"], 1, "N")})
    table = read_table(path, header=1)
    for column, expected in zip(table.names, values.T, strict=True):
        np.testing.assert_array_equal(np.float32(table.numbers(column)), expected)


def test_what_is_for_evaluation_only_stays(tmp_path, recording_maker):
    with RecordingsWriter(tmp_path / "r.h5", source="a test", licence="CC0-1.0", seed=7) as writer:
        writer.add_recording("a", "e", "0", **recording_maker(seconds=2))
        writer.set_truth(["a"], {"friction_coefficient": np.array([0.6])})
    export_folder(tmp_path / "r.h5", tmp_path / "folder", "npy", quiet=True)
    files = sorted(path.relative_to(tmp_path / "folder").as_posix() for path in (tmp_path / "folder").rglob("*.*"))
    assert files == ["README.txt", "a/e/0_force_10000Hz.npy", "a/e/0_velocity_500Hz.npy", "layout.toml"]
    assert "truth" not in (tmp_path / "folder/layout.toml").read_text()


def test_readme_says_how_to_get_back(tmp_path, recording_maker, monkeypatch):
    path = write(tmp_path / "r.h5", {("a", "e", "0"): recording_maker(seconds=2)})
    export_folder(path, tmp_path / "folder", quiet=True)
    comment, code = (tmp_path / "folder/README.txt").read_text().splitlines()
    assert "recordings.h5" in comment
    monkeypatch.chdir(tmp_path / "folder")
    exec(code, {})
    with RecordingsFile("recordings.h5") as file:
        assert file.names == ["a/e/0"]


def test_an_empty_folder_is_filled_and_a_full_one_refused(tmp_path, recording_maker):
    path = write(tmp_path / "r.h5", {("a", "e", "0"): recording_maker(seconds=2)})
    (tmp_path / "folder").mkdir()
    export_folder(path, tmp_path / "folder", "hdf5", quiet=True)
    assert load_layout(tmp_path / "folder/layout.toml").source == "a test"
    before = sorted((tmp_path / "folder").rglob("*"))
    with pytest.raises(ValueError, match="`folder` must be new or empty, .*folder exists: remove it"):
        export_folder(path, tmp_path / "folder", "hdf5", quiet=True)
    with pytest.raises(ValueError, match="`folder` must be new or empty, .*r.h5 exists"):
        export_folder(path, path, quiet=True)
    assert sorted((tmp_path / "folder").rglob("*")) == before


def test_nothing_is_left_after_a_failure(tmp_path, recording_maker, monkeypatch):
    path = write(tmp_path / "r.h5", {(surface, "e", "0"): recording_maker(seconds=2) for surface in "ab"})
    real = np.save

    def full(place, values):
        if "b/" in str(place):
            raise OSError("No space left on device")
        real(place, values)

    monkeypatch.setattr(np, "save", full)
    with pytest.raises(OSError, match="No space left"):
        export_folder(path, tmp_path / "folder", "npy", quiet=True)
    assert [item.name for item in tmp_path.iterdir()] == ["r.h5"]


def test_bad_arguments(tmp_path, recording_maker):
    path = write(tmp_path / "r.h5", {("a", "e", "0"): recording_maker(seconds=2)})
    with pytest.raises(ValueError, match="`kind` must be one of csv, npy, hdf5, mat, got 'xlsx'"):
        export_folder(path, tmp_path / "folder", "xlsx", quiet=True)
    with pytest.raises(FileNotFoundError, match="The folder .*nowhere of folder does not exist: create it"):
        export_folder(path, tmp_path / "nowhere" / "folder", quiet=True)
    with pytest.raises(FileNotFoundError, match="absent.h5"):
        export_folder(tmp_path / "absent.h5", tmp_path / "folder", quiet=True)
    assert not (tmp_path / "folder").exists()


@pytest.mark.parametrize("name", ["..", ".hidden", "__a", "a\\b", "a\nb"])
def test_names_that_no_file_can_have(tmp_path, recording_maker, name):
    path = write(tmp_path / "r.h5", {(name, "e", "0"): recording_maker(seconds=2)})
    with pytest.raises(ValueError, match="r.h5: .* cannot name a file: name surfaces, explorers and trials without"):
        export_folder(path, tmp_path / "folder", quiet=True)
    assert [item.name for item in tmp_path.iterdir()] == ["r.h5"]


def test_force_without_velocity_cannot_be_described(tmp_path, recording_maker):
    recording = recording_maker(seconds=2)
    del recording["velocity"], recording["velocity_rate"]
    path = write(tmp_path / "r.h5", {("a", "e", "0"): recording})
    with pytest.raises(ValueError, match="a/e/0 has 3-D `force` but no `velocity`, which a layout cannot describe"):
        export_folder(path, tmp_path / "folder", quiet=True)
    assert [item.name for item in tmp_path.iterdir()] == ["r.h5"]
