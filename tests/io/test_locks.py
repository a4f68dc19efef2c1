"""Locks on folders: who comes second is refused, and whatever ends the first frees it."""

import errno
import os
import shutil
import signal
import subprocess
import sys

import h5py
import pytest

from tactile_diffusers.io import locks
from tactile_diffusers.io.files import atomic_path, clear_left_behind
from tactile_diffusers.io.locks import is_locked, lock_folder, locked_folder, unlock_folder

pytestmark = pytest.mark.skipif(locks.fcntl is None, reason="needs flock")
#: Holds a folder until it is killed, or told to end; nothing is imported that takes long.
HOLDER = """
import runpy, sys
lock_folder = runpy.run_path(sys.argv[1])["lock_folder"]
lock_folder(sys.argv[2])
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def holder(tmp_path):
    """A process that holds `tmp_path / "taken"`."""
    (tmp_path / "taken").mkdir()
    words = [sys.executable, "-c", HOLDER, locks.__file__, str(tmp_path / "taken")]
    process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.communicate()


def test_the_second_is_refused_until_the_first_is_killed(holder, tmp_path):
    taken = tmp_path / "taken"
    with pytest.raises(ValueError, match=r"^--output_dir .*taken is in use: another process is writing there\. Wait"):
        lock_folder(taken, "--output_dir")
    lock_folder(tmp_path)  # the folder around it is another
    with locked_folder(tmp_path):
        lock_folder(os.path.relpath(tmp_path))  # what is locked already stays so
    assert is_locked(tmp_path) and is_locked(taken) and not list(taken.iterdir())
    os.kill(holder.pid, signal.SIGKILL)
    holder.wait()
    with locked_folder(taken):
        assert is_locked(taken)
    assert not is_locked(taken)
    unlock_folder(tmp_path)


def test_a_folder_that_was_made_again_is_locked_again(tmp_path):
    for _ in range(2):
        (tmp_path / "a").mkdir()
        lock_folder(tmp_path / "a")
        assert is_locked(tmp_path / "a")
        shutil.rmtree(tmp_path / "a")
    unlock_folder(tmp_path / "a")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_forked_child_does_not_hold_what_its_parent_held(tmp_path):
    """A killed training leaves workers of its loader for seconds."""
    lock_folder(tmp_path)
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.write(writing, b".")
        signal.pause()  # lives on
    try:
        assert os.read(reading, 1) == b"." and is_locked(tmp_path)
        unlock_folder(tmp_path)
        assert not is_locked(tmp_path)
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        os.close(reading)
        os.close(writing)


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EOPNOTSUPP, errno.EBADF])
def test_without_such_locks_everything_goes_on(tmp_path, monkeypatch, number):
    def refusing(*_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(locks.fcntl, "flock", refusing)
    lock_folder(tmp_path)
    assert not is_locked(tmp_path)
    monkeypatch.setattr(locks, "fcntl", None)
    lock_folder(tmp_path)
    assert not is_locked(tmp_path)


def test_a_file_that_is_being_written_is_not_cleared_away(tmp_path):
    with atomic_path(tmp_path / "prepared.h5") as temporary:
        with h5py.File(temporary, "w") as file:
            if not is_locked(temporary):
                pytest.skip("HDF5 does not lock files here")
            file["a"] = 1
            clear_left_behind(tmp_path / "prepared.h5")
            assert temporary.exists()
        shutil.copy(temporary, tmp_path / ".prepared.h5.1.tmp")
        clear_left_behind(tmp_path / "other.h5")
        assert temporary.exists()
        clear_left_behind(tmp_path / "prepared.h5")
        assert not list(tmp_path.iterdir())
        temporary.touch()
