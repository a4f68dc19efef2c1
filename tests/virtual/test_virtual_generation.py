"""Generating virtual surfaces: settings, workers, and what a kill leaves behind."""

import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from tactile_diffusers.data import RecordingsFile
from tactile_diffusers.virtual import RECIPE_VERSION, VirtualSurface, generate_recordings
from tactile_diffusers.virtual.collection import Collection
from tactile_diffusers.virtual.raters import draw_raters

#: So many that a kill finds some of them still to do.
SURFACES = 80
SETTINGS = {"seconds": 2.0, "explorers": 1, "seed": 5, "quiet": True}


def test_an_interrupted_call_leaves_the_older_file(tmp_path, monkeypatch):
    path = tmp_path / "r.h5"
    generate_recordings(path, 2, **SETTINGS)
    before, explore = path.read_bytes(), VirtualSurface.explore

    def interrupted(surface, *arguments):
        if surface.index == 1:
            raise KeyboardInterrupt
        return explore(surface, *arguments)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(VirtualSurface, "explore", interrupted)
        generate_recordings(path, 3, **SETTINGS)
    assert path.read_bytes() == before and [file.name for file in tmp_path.iterdir()] == ["r.h5"]
    generate_recordings(path, 3, **SETTINGS)
    with RecordingsFile(path) as file:
        assert len(file) == 3


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_killed_workers_and_a_killed_parent(tmp_path):
    """Workers end with their parent, a killed worker is reported, and the result does not depend on workers."""
    path, script = tmp_path / "r.h5", tmp_path / "run.py"
    script.write_text(
        "from tactile_diffusers.virtual import generate_recordings\n"
        f"if __name__ == '__main__':\n    generate_recordings({str(path)!r}, {SURFACES}, workers=2, **{SETTINGS})\n"
    )
    parent = subprocess.Popen([sys.executable, script], cwd=tmp_path)
    wait_for_workers(parent.pid)
    family = descendants(parent.pid)
    parent.kill()
    parent.wait()
    deadline = time.monotonic() + 30
    while any(alive(pid) for pid in family):
        assert time.monotonic() < deadline, "workers outlived their parent"
        time.sleep(0.01)
    assert not path.exists()

    parent = subprocess.Popen([sys.executable, script], cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    wait_for_workers(parent.pid)
    os.kill(max(descendants(parent.pid), key=started), signal.SIGKILL)
    told = parent.communicate(timeout=60)[1]
    assert re.search("ChildProcessError.*a worker process was killed.*use fewer `workers`", told), told
    assert not path.exists()

    generate_recordings(path, SURFACES, workers=2, **SETTINGS)
    generate_recordings(tmp_path / "one.h5", SURFACES, **SETTINGS)
    assert path.read_bytes() == (tmp_path / "one.h5").read_bytes()


def wait_for_workers(pid, count=4, seconds=60):
    """The fork server, the tracker of resources and both workers."""
    deadline = time.monotonic() + seconds
    while len(descendants(pid)) < count:
        assert time.monotonic() < deadline, "no worker began in time"
        time.sleep(0.001)


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


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere of r.h5 does not exist"):
        generate_recordings(tmp_path / "nowhere" / "r.h5", 1, **SETTINGS)


def test_attributes_give_the_collection_back(tmp_path):
    correlation = (0.3, -0.7, -0.1)
    settings = {"agreement": 2.0, "raters": 14, "rating_correlation": correlation, "impulsiveness": 2.0}
    generate_recordings(tmp_path / "r.h5", 4, **SETTINGS, **settings)
    with RecordingsFile(tmp_path / "r.h5") as file:
        attributes = file.attributes
        assert attributes["recipe_version"] == RECIPE_VERSION and attributes["source"] == "virtual surfaces"
        collection = Collection.from_attributes(attributes)
        surfaces = [VirtualSurface(5, index, 2.0) for index in range(4)]
        np.testing.assert_array_equal(file.ratings.values, collection.answers(surfaces))
        assert file.ratings.values.shape == (14, 4, 3)
        np.testing.assert_array_equal(
            file.ratings.values[3, 2], surfaces[2].answers(draw_raters(5, 4), 2.0, correlation)[3]
        )
        for index, recording in enumerate(file):
            np.testing.assert_array_equal(recording.force, surfaces[index].explore(0, collection.seconds)[0])


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"raters": 0}, "`raters`"),
        ({"rating_correlation": (0.9, -0.9, 0.9)}, "`rating_correlation` .* impossible"),
        ({"impulsiveness": -1}, "`impulsiveness`"),
        ({"agreement": float("nan")}, "`agreement`"),
        ({"workers": 0}, "`workers`"),
    ],
)
def test_bad_settings(tmp_path, arguments, message):
    with pytest.raises(ValueError, match=message):
        generate_recordings(tmp_path / "r.h5", 1, **SETTINGS, **arguments)
    assert not list(tmp_path.iterdir())
