"""Locks on folders: one process at a time may write to a folder, or clean it up."""

import os
from contextlib import contextmanager
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

#: Folders that this process has locked: resolved path -> descriptor.
_locked = {}


def lock_folder(folder, argument="The folder"):
    """Locks a folder until `unlock_folder`, or until this process ends.

    The lock is the kernel's (flock), on the folder itself: no file is left behind, and a kill frees it. It is advisory.
    Locking a folder twice in one process changes nothing. Where the system or the file system has no such locks,
    nothing is locked.

    Args:
        folder (`str` or `Path`): an existing folder.
        argument (`str`): the argument that the message names.

    Raises:
        ValueError: if another process has locked the folder.
    """
    if fcntl is None or _is_ours(folder):
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise ValueError(
            f"{argument} {folder} is in use: another process is writing there. Wait until it has ended, end it, or "
            "give another folder."
        ) from None
    except OSError:  # a file system without such locks, or one that locks files alone
        os.close(handle)
        return
    unlock_folder(folder)  # an older folder of this name that has been removed
    _locked[Path(folder).resolve()] = handle


def unlock_folder(folder):
    """Frees a folder that `lock_folder` locked; does nothing for others."""
    handle = _locked.pop(Path(folder).resolve(), None)
    if handle is not None:
        os.close(handle)


@contextmanager
def locked_folder(folder, argument="The folder"):
    """Locks a folder for the length of a block, in which it may be removed."""
    before = _is_ours(folder)
    lock_folder(folder, argument)
    try:
        yield
    finally:
        if not before:
            unlock_folder(folder)


def is_locked(path):
    """Whether anyone has locked a file or folder; HDF5 locks the files that it writes."""
    if fcntl is None:
        return False
    try:
        handle = os.open(path, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(handle)
    return False


def _is_ours(folder):
    handle = _locked.get(Path(folder).resolve())
    return handle is not None and os.path.samestat(os.fstat(handle), os.stat(folder))


def _close_inherited():
    """In a forked child: inherited descriptors would keep the parent's locks for as long as the child lives."""
    while _locked:
        os.close(_locked.popitem()[1])


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_close_inherited)
