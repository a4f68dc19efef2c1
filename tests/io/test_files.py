"""Files and folders that are whole or absent: links, threads, and folders that are not there."""

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from tactile_diffusers.export import FORMATS
from tactile_diffusers.io.files import atomic_path, whole_folder, write_text
from tactile_diffusers.io.hdf5 import whole_file

ABOUT = dict(sampling_rate=10_000, friction_coefficient=0.4, ratings=[1, 0, 0], seed=0)


def test_what_a_link_points_to_is_replaced(tmp_path):
    (tmp_path / "disk").mkdir()
    (tmp_path / "disk" / "large.h5").write_text("old")
    link = tmp_path / "data.h5"
    link.symlink_to("disk/large.h5")
    write_text(link, "new")
    assert link.is_symlink() and (tmp_path / "disk" / "large.h5").read_text() == "new"
    assert os.listdir(tmp_path / "disk") == ["large.h5"]


def test_threads_may_write_one_file(tmp_path):
    path = tmp_path / "settings.json"
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda number: write_text(path, f"{number:05d}" * 100), range(400)))
    text = path.read_text()
    assert text == text[:5] * 100 and os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("context", [atomic_path, whole_file, whole_folder])
def test_a_missing_folder_is_named(tmp_path, context):
    with pytest.raises(FileNotFoundError, match=r"The folder .*nowhere of a.wav does not exist: create it first."):
        with context(tmp_path / "nowhere" / "a.wav"):
            pass


@pytest.mark.filterwarnings("ignore:Pixels")
@pytest.mark.parametrize("name", FORMATS)
def test_every_writer_names_a_missing_folder(tmp_path, name):
    with pytest.raises(FileNotFoundError, match="nowhere of a.file"):
        FORMATS[name].write(tmp_path / "nowhere" / "a.file", np.ones(1000), reference_speed=80.0, **ABOUT)


class TestWholeFolder:
    def test_what_was_there_goes_only_when_the_new_one_is_in_place(self, tmp_path):
        folder = tmp_path / "card"
        folder.mkdir()
        (folder / "old").touch()
        with whole_folder(folder) as new:
            (new / "new").touch()
            assert (folder / "old").exists()
        assert os.listdir(folder) == ["new"] and os.listdir(tmp_path) == ["card"]

    @pytest.mark.parametrize("replaced", [False, True])
    def test_what_a_kill_left_aside_is_put_back_or_goes(self, tmp_path, replaced):
        aside, folder = tmp_path / ".card.123-abc.old", tmp_path / "card"
        aside.mkdir()
        (aside / "old").touch()
        if replaced:
            folder.mkdir()
            (folder / "new").touch()
        with pytest.raises(RuntimeError), whole_folder(folder):
            raise RuntimeError("it did not get far")
        assert os.listdir(tmp_path) == ["card"] and os.listdir(folder) == ["new" if replaced else "old"]

    def test_a_check_at_the_end_keeps_it(self, tmp_path):
        folder = tmp_path / "card"
        folder.mkdir()
        (folder / "old").touch()

        def check():
            raise ValueError("there is something else")

        with pytest.raises(ValueError, match="something else"), whole_folder(folder, check):
            pass
        assert os.listdir(folder) == ["old"] and os.listdir(tmp_path) == ["card"]
