"""Files and folders that appear only when they are complete."""

import glob
import os
import secrets
import shutil
from contextlib import contextmanager
from pathlib import Path

from .locks import is_locked, locked_folder


@contextmanager
def atomic_path(path):
    """Yields a temporary path beside `path`, which is renamed to `path` at the end, or removed if the block raises.

    If `path` is a link, its target is replaced: large files often lie on another disk.

    Raises:
        FileNotFoundError: if the folder of `path` does not exist.
    """
    path = Path(os.path.realpath(path))
    check_parent(path)
    temporary = _beside(path, "tmp")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def whole_folder(path, check=None):
    """Yields a new folder beside `path`, which takes the place of `path` at the end, or is removed if the block raises.

    The older folder is set aside and deleted only after the new one is in place. If a process was killed between the
    two, the next call recovers the older folder. If `path` is a link, its target is replaced.

    Args:
        path (`str` or `Path`): the final name.
        check (`Callable`, *optional*): called before anything is replaced; it raises if `path` must not be replaced.

    Raises:
        FileNotFoundError: if the folder of `path` does not exist.
    """
    path = Path(os.path.realpath(path))
    check_parent(path)
    _recover(path)
    temporary, older = _beside(path, "tmp"), _beside(path, "old")
    temporary.mkdir()
    try:
        with locked_folder(temporary):  # so that `clear_left_behind` of another process leaves it alone
            yield temporary
            if check is not None:
                check()
            if path.exists():
                os.replace(path, older)
            os.replace(temporary, path)
    finally:
        if older.exists() and not path.exists():
            os.replace(older, path)
        for leftover in (temporary, older):
            shutil.rmtree(leftover, ignore_errors=True)


def _recover(path):
    """Renames a folder that a killed `whole_folder` set aside back to `path`, or deletes it if `path` exists."""
    for older in path.parent.glob(f".{glob.escape(path.name)}.*.old"):
        if path.exists():
            shutil.rmtree(older, ignore_errors=True)
        else:
            os.replace(older, path)


def check_parent(path):
    """Raises a `FileNotFoundError` if the folder of `path` does not exist."""
    if not path.parent.is_dir():
        raise FileNotFoundError(f"The folder {path.parent} of {path.name} does not exist: create it first.")


def _beside(path, kind):
    # random: threads, and machines that share a disk, may have one process id
    return path.with_name(f".{path.name}.{os.getpid()}-{secrets.token_hex(4)}.{kind}")


def clear_left_behind(path):
    """Removes temporary files of killed calls of `atomic_path` or `whole_folder`, except those still being written."""
    path = Path(os.path.realpath(path))
    for left_behind in path.parent.glob(f".{glob.escape(path.name)}.*.tmp"):
        if is_locked(left_behind):
            continue
        if left_behind.is_dir():
            shutil.rmtree(left_behind, ignore_errors=True)
        else:
            left_behind.unlink(missing_ok=True)


def write_text(path, text):
    """Writes a text file in UTF-8; after a failure the older file is unchanged."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
