"""recordings.h5 as a folder: nothing lost, nothing half-written, nothing that a file cannot be named."""

import export_folder as script
import h5py
import numpy as np
import pytest
from export_folder import export_folder, main

from tactile_diffusers.data import RecordingsFile, RecordingsWriter, prepare_recordings
from tactile_diffusers.data.folder.convert import convert_folder


def write(path, recordings, ratings=None, **attributes):
    """Writes {(surface, explorer, trial): keyword arguments}; `ratings` are the arguments of `set_ratings`."""
    with RecordingsWriter(path, source="a test", licence="CC0-1.0", **attributes) as writer:
        for name, recording in recordings.items():
            writer.add_recording(*name, **recording)
        if ratings is not None:
            writer.set_ratings(*ratings)
    return path


def datasets(path):
    """All datasets of an HDF5 file: {name: array}."""
    found = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: found.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None)
    return found


def back(folder, tmp_path):
    """Converts an exported folder with its own layout; returns the recordings and the ratings."""
    convert_folder(folder, folder / "layout.toml", tmp_path / "back.h5", quiet=True)
    with RecordingsFile(tmp_path / "back.h5") as file:
        return {recording.name: recording for recording in file}, file.ratings


def test_the_way_back_gives_the_same_recordings_and_segments(virtual_recordings, virtual_prepared, tmp_path):
    """Virtual recordings: every dataset of the recordings, and of the data set prepared from them, bit for bit."""
    export_folder(virtual_recordings, tmp_path / "folder", quiet=True)
    report = convert_folder(tmp_path / "folder", tmp_path / "folder/layout.toml", tmp_path / "back.h5", quiet=True)
    assert not report.left_out and not report.notes
    prepare_recordings(tmp_path / "back.h5", tmp_path / "prepared.h5", validation=1, test=1, quiet=True)
    ours = datasets(tmp_path / "back.h5") | datasets(tmp_path / "prepared.h5")
    theirs = datasets(virtual_recordings) | datasets(virtual_prepared)
    assert len(theirs["segments/filtered/start"]) > 5
    for name in (name for name in theirs if not name.startswith("truth")):
        np.testing.assert_array_equal(ours[name], theirs[name], err_msg=name)


def test_names_gaps_rates_and_counts_survive(tmp_path, recording_maker):
    """Names with what file names may hold, two rates of velocity, samples that are missing, lateral force in counts."""
    first, second = recording_maker(seconds=2), recording_maker(seconds=2, seed=1)
    first["force"][100:110], second["velocity"] = np.nan, second["velocity"][::2]
    second["velocity_rate"] = 250
    recordings = {("Leder, 3 µm {rau}", "P_1", "trial-1"): first, ("01", "P_2", "2_force"): second}
    export_folder(write(tmp_path / "r.h5", recordings), tmp_path / "folder", quiet=True)
    found, ratings = back(tmp_path / "folder", tmp_path)
    assert set(found) == {"/".join(name) for name in recordings} and ratings is None
    for name, recording in recordings.items():
        other = found["/".join(name)]
        np.testing.assert_array_equal(other.force, np.float32(recording["force"]))
        np.testing.assert_array_equal(other.velocity, np.float32(recording["velocity"]))
        assert other.velocity_rate == recording["velocity_rate"]
    counts = np.random.default_rng(0).integers(-2000, 2000, 5000).astype(float)
    alone = dict(lateral=counts, lateral_rate=2200, unit="1")
    both = alone | dict(velocity=np.ones((500, 2)), velocity_rate=200)
    path = write(tmp_path / "r.h5", {("a", "robot", "0"): both, ("b", "robot", "0"): alone})
    export_folder(path, tmp_path / "counts", quiet=True)
    found, _ = back(tmp_path / "counts", tmp_path)
    for name in "ab":
        np.testing.assert_array_equal(found[f"{name}/robot/0"].lateral, np.float32(counts))
    assert found["b/robot/0"].velocity is None and found["b/robot/0"].unit == "1"


def test_ratings_with_gaps_and_further_axes(tmp_path, recording_maker):
    rng = np.random.default_rng(0)
    values = rng.uniform(0, 8, (3, 2, 4)).astype(np.float32)
    values[0, 1], values[1, 0, 2] = np.nan, np.nan
    names = ["NA", "Dr. B, jr.", "3"], ["a", "b"], ["bumpiness", "warm-cold", "roughness", "slipperiness"]
    recordings = {(surface, "e", "0"): recording_maker(seconds=2) for surface in "ab"}
    export_folder(write(tmp_path / "r.h5", recordings, (values, *names)), tmp_path / "folder", quiet=True)
    _, ratings = back(tmp_path / "folder", tmp_path)
    assert ratings.raters == tuple(names[0]) and ratings.surfaces == ("a", "b")
    order = [names[2].index(axis) for axis in ratings.axes]
    assert sorted(order) == [0, 1, 2, 3]
    np.testing.assert_allclose(ratings.values, values[:, :, order], rtol=2**-23)


def test_only_what_can_be_read_back_is_written(tmp_path, recording_maker, monkeypatch):
    """No seed and no ground truth; the README's code reads the folder."""
    with RecordingsWriter(tmp_path / "r.h5", source="a test", licence="CC0-1.0", seed=7) as writer:
        writer.add_recording("a", "e", "0", **recording_maker(seconds=2))
    (tmp_path / "folder").mkdir()  # an empty folder is filled
    export_folder(tmp_path / "r.h5", tmp_path / "folder", quiet=True)
    files = sorted(path.relative_to(tmp_path / "folder").as_posix() for path in (tmp_path / "folder").rglob("*.*"))
    assert files == ["README.txt", "a/e/0_force_10000Hz.csv", "a/e/0_velocity_500Hz.csv", "layout.toml"]
    assert "truth" not in (tmp_path / "folder/layout.toml").read_text()
    comment, code = (tmp_path / "folder/README.txt").read_text().splitlines()
    monkeypatch.chdir(tmp_path / "folder")
    exec(code, {})
    with RecordingsFile("recordings.h5") as file:
        assert file.names == ["a/e/0"] and "recordings.h5" in comment


def test_nothing_is_left_after_a_failure(tmp_path, recording_maker, monkeypatch):
    path = write(tmp_path / "r.h5", {(surface, "e", "0"): recording_maker(seconds=2) for surface in "ab"})
    real = script._write_csv

    def full(place, *arguments):
        if "b/" in str(place):
            raise OSError("No space left on device")
        real(place, *arguments)

    monkeypatch.setattr(script, "_write_csv", full)
    with pytest.raises(OSError, match="No space left"):
        export_folder(path, tmp_path / "folder", quiet=True)
    assert [item.name for item in tmp_path.iterdir()] == ["r.h5"]


def test_bad_places_are_refused(tmp_path, recording_maker):
    path = write(tmp_path / "r.h5", {("a", "e", "0"): recording_maker(seconds=2)})
    for source, folder, message in (
        (path, path, "`folder` must be new or empty, .*r.h5 exists"),
        (path, tmp_path, "`folder` must be new or empty, .* exists: remove it"),
        (path, tmp_path / "nowhere" / "folder", "The folder .*nowhere of folder does not exist: create it"),
        (tmp_path / "absent.h5", tmp_path / "folder", "absent.h5"),
    ):
        with pytest.raises((ValueError, FileNotFoundError), match=message):
            export_folder(source, folder, quiet=True)
    assert [item.name for item in tmp_path.iterdir()] == ["r.h5"]


@pytest.mark.parametrize("name", ["..", ".hidden", "__a", "a\\b", "a\nb", "without velocity"])
def test_what_no_folder_can_hold_is_refused(tmp_path, recording_maker, name):
    recording, message = recording_maker(seconds=2), "r.h5: .* cannot name a file: name surfaces, explorers and trials"
    if name == "without velocity":
        del recording["velocity"], recording["velocity_rate"]
        message = "has 3-D `force` but no `velocity`, which a layout cannot describe"
    path = write(tmp_path / "r.h5", {(name, "e", "0"): recording})
    with pytest.raises(ValueError, match=message):
        export_folder(path, tmp_path / "folder", quiet=True)
    assert [item.name for item in tmp_path.iterdir()] == ["r.h5"]


def test_as_a_command(tmp_path, recording_maker, capsys):
    path = write(tmp_path / "r.h5", {("a", "e", "0"): recording_maker(seconds=2)})
    assert main(["--recordings", str(path), "--output", str(tmp_path / "folder"), "--quiet"]) == 0
    assert (tmp_path / "folder/layout.toml").is_file() and "wrote" in capsys.readouterr().out
    assert main(["--recordings", str(path), "--output", str(tmp_path), "--quiet"]) == 2
