"""Generating many virtual surfaces: settings, truth, workers, and what a kill leaves behind."""

import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from tactile_diffusers.data import RecordingsFile, RecordingsWriter, prepare_recordings
from tactile_diffusers.virtual import RECIPE_VERSION, VirtualSurface, generate, generate_recordings, rater_settings
from tactile_diffusers.virtual.collection import Collection
from tactile_diffusers.virtual.percepts import reference_friction
from tactile_diffusers.virtual.raters import draw_raters

#: So many that a kill finds some of them still to do.
SURFACES = 80
SETTINGS = {"seconds": 2.0, "explorers": 1, "seed": 5, "quiet": True}


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory):
    """Bytes of a file that was made in one go."""
    path = tmp_path_factory.mktemp("unbroken") / "r.h5"
    generate_recordings(path, SURFACES, **SETTINGS)
    return path.read_bytes()


def parts_of(path):
    return sorted(path.with_name(path.name + ".partial").glob("[0-9]*.h5"))


def wait_for_parts(path, count, seconds=60):
    deadline = time.monotonic() + seconds
    while len(parts_of(path)) < count:
        assert time.monotonic() < deadline, "no surface was finished in time"
        time.sleep(0.001)


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="needs fork")
def test_a_killed_run_goes_on_bit_for_bit(tmp_path, unbroken):
    path = tmp_path / "r.h5"
    # forked, so that the test need not wait for the imports of a new interpreter; it runs numpy on one thread
    process = multiprocessing.get_context("fork").Process(
        target=generate_recordings, args=(path, SURFACES), kwargs=SETTINGS
    )
    process.start()
    wait_for_parts(path, 3)
    process.kill()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    assert not path.exists() and 3 <= len(parts_of(path)) < SURFACES
    finished = {part: part.stat().st_mtime_ns for part in parts_of(path)}
    untouched = list(finished)[:-1]
    list(finished)[-1].write_bytes(list(finished)[-1].read_bytes()[:5000])  # as a power cut leaves it

    explored = []
    with pytest.MonkeyPatch.context() as patch:
        original = generate.write_part
        patch.setattr(generate, "write_part", lambda *task: (explored.append(task[2]), original(*task)))
        generate_recordings(path, SURFACES, **SETTINGS)
    assert len(explored) == SURFACES - len(untouched)  # the finished ones are not explored again, the truncated one is
    assert path.read_bytes() == unbroken
    assert [file.name for file in tmp_path.iterdir()] == ["r.h5"]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_killed_workers_and_a_killed_parent(tmp_path, unbroken):
    path = tmp_path / "r.h5"
    script = tmp_path / "run.py"
    script.write_text(
        "from tactile_diffusers.data import generate_recordings\n"
        f"if __name__ == '__main__':\n    generate_recordings({str(path)!r}, {SURFACES}, workers=2, **{SETTINGS})\n"
    )
    parent = subprocess.Popen([sys.executable, script], cwd=tmp_path)
    wait_for_parts(path, 3)
    family = descendants(parent.pid)
    parent.kill()
    parent.wait()
    deadline = time.monotonic() + 30
    while any(alive(pid) for pid in family):
        assert time.monotonic() < deadline, "workers outlived their parent"
        time.sleep(0.01)
    assert not path.exists() and 3 <= len(parts_of(path)) < SURFACES

    # go on in this process, and now it is a worker that is killed
    def kill_the_newest():
        wait_for_parts(path, done + 1)
        os.kill(max(descendants(os.getpid()), key=started), signal.SIGKILL)

    done = len(parts_of(path))
    killer = threading.Thread(target=kill_the_newest)
    killer.start()
    with pytest.raises(ChildProcessError, match=r"worker process was killed.*kept in .*r\.h5\.partial: call again"):
        generate_recordings(path, SURFACES, workers=2, **SETTINGS)
    killer.join()
    assert not path.exists() and done < len(parts_of(path)) < SURFACES

    generate_recordings(path, SURFACES, workers=2, **SETTINGS)
    assert path.read_bytes() == unbroken


def descendants(pid):
    """Processes below `pid`, Linux only."""
    found = []
    for child in open(f"/proc/{pid}/task/{pid}/children").read().split():
        found += [int(child), *descendants(int(child))]
    return found


def alive(pid):
    try:
        return open(f"/proc/{pid}/stat").read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def started(pid):
    """When a process began, in ticks."""
    return int(open(f"/proc/{pid}/stat").read().rsplit(")", 1)[1].split()[19])


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="needs fork")
def test_a_kill_while_surfaces_are_put_together_litters_nothing(tmp_path, monkeypatch):
    path = tmp_path / "r.h5"
    monkeypatch.setattr(RecordingsWriter, "set_truth", lambda *_: os.kill(os.getpid(), signal.SIGKILL))
    process = multiprocessing.get_context("fork").Process(target=generate_recordings, args=(path, 2), kwargs=SETTINGS)
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    assert [file.name for file in tmp_path.iterdir()] == ["r.h5.partial"] and len(parts_of(path)) == 2
    monkeypatch.undo()
    parts = tmp_path / "r.h5.partial"
    assert list(parts.glob(".*.tmp"))
    generate._check_parts(parts, Collection(seconds=2.0, explorers=1, seed=5))
    assert not list(parts.glob(".*.tmp"))  # so that disk need not hold it beside the next attempt
    generate_recordings(path, 2, **SETTINGS)
    assert [file.name for file in tmp_path.iterdir()] == ["r.h5"]


def test_surfaces_that_a_kill_leaves_at_the_end_do_not_pass_for_others(tmp_path, monkeypatch):
    path, unlink = tmp_path / "r.h5", Path.unlink

    def interrupted(file, **options):
        if file.name == "1.h5":
            raise KeyboardInterrupt
        unlink(file, **options)

    monkeypatch.setattr(Path, "unlink", interrupted)
    with pytest.raises(KeyboardInterrupt):
        generate_recordings(path, 3, **SETTINGS)
    monkeypatch.undo()
    whole = path.read_bytes()
    with pytest.raises(ValueError, match="surfaces of other settings"):
        generate_recordings(path, 3, **{**SETTINGS, "seed": 6})
    generate_recordings(path, 3, **SETTINGS)
    assert path.read_bytes() == whole and [file.name for file in tmp_path.iterdir()] == ["r.h5"]


def test_other_settings_do_not_mix(tmp_path, monkeypatch):
    path = tmp_path / "r.h5"

    def interrupt(parts, collection, index):
        raise KeyboardInterrupt

    monkeypatch.setattr(generate, "write_part", interrupt)
    with pytest.raises(KeyboardInterrupt):
        generate_recordings(path, 3, **SETTINGS)
    monkeypatch.undo()
    for name, value in {"seed": 6, "seconds": 2.5, "rater_moisture": 0.25}.items():
        with pytest.raises(ValueError, match=rf"of other settings, by its collection\.json \({name} .*delete"):
            generate_recordings(path, 3, **{**SETTINGS, name: value})
    generate_recordings(path, 2, **SETTINGS)  # how many is no setting
    with RecordingsFile(path) as file:
        assert len(file) == 2


def test_the_number_of_surfaces_may_change_on_the_way(tmp_path, unbroken):
    monkey, path = pytest.MonkeyPatch(), tmp_path / "r.h5"
    original = generate.write_part

    def five_only(parts, collection, index):
        if index == 5:
            raise KeyboardInterrupt
        original(parts, collection, index)

    with monkey.context() as patch:
        patch.setattr(generate, "write_part", five_only)
        with pytest.raises(KeyboardInterrupt):
            generate_recordings(path, 10, **SETTINGS)
    assert len(parts_of(path)) == 5
    generate_recordings(path, SURFACES, **SETTINGS)
    assert path.read_bytes() == unbroken


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere of r.h5 does not exist"):
        generate_recordings(tmp_path / "nowhere" / "r.h5", 1, **SETTINGS)


def test_attributes_give_the_collection_back(tmp_path):
    settings = {"agreement": 2.0, "raters": 14, "rater_moisture": 0.25, "axis_correlation": 0.5, "duration_spread": 0.4}
    generate_recordings(tmp_path / "r.h5", 4, **SETTINGS, **settings)
    with RecordingsFile(tmp_path / "r.h5") as file:
        attributes = file.attributes
        assert attributes["recipe_version"] == RECIPE_VERSION and attributes["source"] == "virtual surfaces"
        collection = Collection(**{name: attributes[name] for name in Collection.__dataclass_fields__})
        assert rater_settings(attributes).keys() < vars(collection).keys()
        surfaces = [VirtualSurface(5, index) for index in range(4)]
        np.testing.assert_array_equal(file.ratings.values, collection.answers(surfaces))
        assert file.ratings.values.shape == (14, 4, 3)
        np.testing.assert_array_equal(
            file.ratings.values[3, 2],
            surfaces[2].answers(draw_raters(5, 4), 2.0, rater_moisture=0.25, axis_correlation=0.5)[3],
        )
        for index, recording in enumerate(file):
            assert recording.samples == round(collection.duration(index) * 10_000)
            np.testing.assert_array_equal(recording.force, surfaces[index].explore(0, collection.duration(index))[0])


def test_uneven_durations():
    collection = Collection(seconds=30.0, seed=1, duration_spread=0.5)
    seconds = np.array([collection.duration(index) for index in range(2000)])
    assert np.log(seconds).std() == pytest.approx(0.5, rel=0.05)  # standard error 1.6 %
    assert seconds.mean() == pytest.approx(30, rel=0.04)  # standard error 1.2 %
    assert Collection(seconds=30.0, seed=1).duration(3) == 30.0
    assert (
        min(Collection(seconds=1.7, duration_spread=2.0).duration(index) for index in range(50)) == 1.64
    )  # 820 samples of velocity


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"raters": 0}, "`raters`"),
        ({"rater_moisture": -0.1}, "`rater_moisture`"),
        ({"axis_correlation": 1.0}, "`axis_correlation` must be from 0"),
        ({"duration_spread": float("nan")}, "`duration_spread`"),
        ({"workers": 0}, "`workers`"),
    ],
)
def test_bad_settings(tmp_path, arguments, message):
    with pytest.raises(ValueError, match=message):
        generate_recordings(tmp_path / "r.h5", 1, **SETTINGS, **arguments)
    assert not list(tmp_path.iterdir())


def test_truth_is_stored_beside_the_recordings(tmp_path):
    generate_recordings(tmp_path / "r.h5", 12, **SETTINGS)
    surfaces = [VirtualSurface(5, index) for index in range(12)]
    with RecordingsFile(tmp_path / "r.h5") as file:
        truth = file.truth
    assert truth.surfaces == tuple(surface.name for surface in surfaces)
    for index, surface in enumerate(surfaces):
        parameters = surface.parameters
        assert truth.fields["material"][index] == parameters.material
        assert truth.fields["friction_coefficient"][index] == reference_friction(parameters)
        assert truth.fields["compliance"][index] == parameters.compliance
        assert truth.fields["slope"][index] == parameters.slope and truth.fields["stick"][index] == parameters.stick
        expected = parameters.wavelength if parameters.grating_level else np.nan
        np.testing.assert_equal(truth.fields["wavelength"][index], expected)
        np.testing.assert_array_equal(truth.fields["percepts"][index], surface.percepts)
    assert (truth.fields["grating_level"] > 0).any() and (truth.fields["grating_level"] == 0).any()


def test_preparation_never_reads_the_truth(tmp_path, virtual_recordings):
    for name in ("with", "without"):
        shutil.copy(virtual_recordings, tmp_path / f"{name}.h5")
    with h5py.File(tmp_path / "without.h5", "r+") as file:
        del file["truth"]
    contents = []
    for name in ("with", "without"):
        prepare_recordings(tmp_path / f"{name}.h5", tmp_path / f"p-{name}.h5", validation=1, test=1, quiet=True)
        with h5py.File(tmp_path / f"p-{name}.h5") as file:
            datasets = {}
            file.visititems(
                lambda key, item, found=datasets: found.update({key: np.array(item)} if hasattr(item, "dtype") else {})
            )
            contents.append(({key: str(value) for key, value in file.attrs.items()}, datasets))
    (attributes, datasets), (others, other_datasets) = contents
    assert attributes == others and datasets.keys() == other_datasets.keys()
    assert not any("truth" in key for key in (*attributes, *datasets))
    for key, values in datasets.items():
        np.testing.assert_array_equal(values, other_datasets[key])


def write_truth(path, surfaces, fields, recording):
    with RecordingsWriter(path, source="a test", licence="CC0-1.0") as writer:
        writer.add_recording("a", "explorer", "0", **recording)
        writer.set_truth(surfaces, fields)


def test_truth_is_optional_and_checked(tmp_path, recording_maker, recordings_writer):
    recording = recording_maker(seconds=2.0)
    with RecordingsFile(recordings_writer(tmp_path / "none.h5", {"a": recording})) as file:
        assert file.truth is None
    write_truth(tmp_path / "t.h5", ["a"], {"word": ["ä"], "pair": [[1.0, 2.0]], "count": [3]}, recording)
    with RecordingsFile(tmp_path / "t.h5") as file:
        fields = file.truth.fields
    assert fields["word"].tolist() == ["ä"] and fields["pair"].tolist() == [[1.0, 2.0]] and fields["count"] == 3

    for fields, message in (({"x": [1.0, 2.0]}, "'x'.*shape.*1 surfaces"), ({"a/b": [1.0]}, "'a/b' cannot name")):
        with pytest.raises(ValueError, match=message):
            write_truth(tmp_path / "bad.h5", ["a"], fields, recording)
    assert not (tmp_path / "bad.h5").exists()

    write_truth(tmp_path / "other.h5", ["b"], {"x": [1.0]}, recording)
    with RecordingsFile(tmp_path / "other.h5") as file, pytest.raises(ValueError, match="'b'.*no recording"):
        _ = file.truth
    with h5py.File(tmp_path / "t.h5", "r+") as file:
        file["truth/longer"] = [1.0, 2.0]
    with RecordingsFile(tmp_path / "t.h5") as file, pytest.raises(ValueError, match="/truth/longer: has shape"):
        _ = file.truth
