"""One process at a time may write to a folder: what two do at once, or clean up, would destroy each other's work."""

import os
from contextlib import contextmanager
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

#: Folders that this process holds: resolved path -> descriptor.
_held = {}


def lock_folder(folder, named="The folder"):
    """Keeps other processes out of a folder until `unlock_folder`, or until this process ends, however it does.

    The lock is the kernel's (flock), on the folder itself: no file is left behind, and a kill frees it. Only those who
    ask for it are kept out. A folder that this process holds already stays its own. Where the system or the file system
    has no such locks, nothing is locked.

    Args:
        folder (`str` or `Path`): exists.
        named (`str`): what it is called in the message: an argument.

    Raises:
        ValueError: if another process holds it.
    """
    if fcntl is None or _holds(folder):
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(handle)
        raise ValueError(
            f"{named} {folder} is in use: another process is writing there. Wait until it has ended, end it, or give "
            "another folder."
        ) from None
    except OSError:  # a file system without such locks, or one that locks files alone
        os.close(handle)
        return
    unlock_folder(folder)  # one of this name that was removed since
    _held[Path(folder).resolve()] = handle


def is_locked(path):
    """Whether another process, or another part of this one, holds a file or folder: HDF5 locks what it writes."""
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


def unlock_folder(folder):
    """Lets others write to a folder that `lock_folder` locked; nothing where it did not."""
    handle = _held.pop(Path(folder).resolve(), None)
    if handle is not None:
        os.close(handle)


@contextmanager
def locked_folder(folder, named="The folder"):
    """`lock_folder` for the length of a block, in which the folder may be removed."""
    before = _holds(folder)
    lock_folder(folder, named)
    try:
        yield
    finally:
        if not before:
            unlock_folder(folder)


def _holds(folder):
    handle = _held.get(Path(folder).resolve())
    return handle is not None and os.path.samestat(os.fstat(handle), os.stat(folder))


def _forget():
    """In a forked child: its copies of the descriptors would hold the locks for as long as it lives."""
    while _held:
        os.close(_held.popitem()[1])


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
