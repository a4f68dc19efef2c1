"""Files that are either whole or absent, and refusals of those that are damaged."""

import glob
import math
import os
import secrets
import shutil
import zipfile
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
from numpy.lib import format as npy

from .heaps import check_heaps
from .locks import is_locked, locked_folder

#: A file may unpack to so many bytes, or to so many times its size, whichever is more: recordings and texts do not
#: compress a hundredfold, a header that claims absurd sizes and an archive made to fill the memory do.
MOST_UNPACKED, MOST_RATIO = 2**26, 100


@contextmanager
def atomic_path(path):
    """Yields a temporary path beside `path`, renamed to `path` at the end, or removed if the block raises.

    Of a link, what it points to is replaced: many keep large files on another disk.

    Raises:
        FileNotFoundError: if the folder of `path` does not exist.
    """
    path = Path(os.path.realpath(path))
    _check_parent(path)
    temporary = _beside(path, "tmp")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def whole_folder(path, check=None):
    """Yields a new folder beside `path`, put in its place if the block succeeds, and removed if not.

    What lay there before is set aside, and only removed when the new one is in its place; if a call was killed between
    these two, the next puts it back first. Of a link, what it points to is replaced.

    Args:
        path (`str` or `Path`): the final name.
        check (`Callable`, *optional*): called before anything is replaced; it raises if that must not be.

    Raises:
        FileNotFoundError: if the folder of `path` does not exist.
    """
    path = Path(os.path.realpath(path))
    _check_parent(path)
    _put_back(path)
    temporary, older = _beside(path, "tmp"), _beside(path, "old")
    temporary.mkdir()
    try:
        with locked_folder(temporary):  # `clear_left_behind` of another process leaves it alone
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


def _put_back(path):
    """What a killed `whole_folder` set aside becomes the folder again, or goes where the new one had its place."""
    for older in path.parent.glob(f".{glob.escape(path.name)}.*.old"):
        if path.exists():
            shutil.rmtree(older, ignore_errors=True)
        else:
            os.replace(older, path)


def _check_parent(path):
    if not path.parent.is_dir():
        raise FileNotFoundError(f"The folder {path.parent} of {path.name} does not exist: create it first.")


def _beside(path, kind):
    # threads, and machines that share a disk, may have one process id
    return path.with_name(f".{path.name}.{os.getpid()}-{secrets.token_hex(4)}.{kind}")


def clear_left_behind(path):
    """Removes what killed calls of `atomic_path(path)` or `whole_folder(path)` left; HDF5 and folders in work stay."""
    path = Path(os.path.realpath(path))
    for left_behind in path.parent.glob(f".{glob.escape(path.name)}.*.tmp"):
        if is_locked(left_behind):
            continue
        if left_behind.is_dir():
            shutil.rmtree(left_behind, ignore_errors=True)
        else:
            left_behind.unlink(missing_ok=True)


def write_text(path, text):
    """Writes a text file in UTF-8 in one step: it is whole or, after a failure, as it was."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _most_unpacked(path):
    return max(MOST_UNPACKED, MOST_RATIO * os.stat(path).st_size)


def check_size(path, claimed):
    """Raises a `ValueError` if a file claims to hold absurdly more bytes than it has."""
    if claimed > _most_unpacked(path):
        held = os.stat(path).st_size
        raise ValueError(
            f"{path} claims to hold {claimed:.3g} bytes, but has {held}: its header is damaged, or it was made to fill "
            "the memory. Copy it again, or write it again."
        )


def check_sizes(file):
    """`check_size` of all datasets of an HDF5 file together: of one that was never written, the header says any size.

    Args:
        file (`h5py.File`): open for reading.
    """
    claimed = []
    file.visititems(lambda _, node: claimed.append(node.nbytes) if isinstance(node, h5py.Dataset) else None)
    check_size(file.filename, sum(claimed))


def check_archive(path):
    """`check_size` of a zip archive: npz, xlsx."""
    with zipfile.ZipFile(path) as archive:
        check_size(path, sum(member.file_size for member in archive.infolist()))


def check_npz(path):
    """`check_archive` of a NumPy archive, whose arrays must also be as large as their headers say."""
    check_archive(path)
    with zipfile.ZipFile(path) as archive:
        for member in archive.infolist():
            with archive.open(member) as file:
                if npy.read_magic(file)[0] == 1:
                    shape, _, dtype = npy.read_array_header_1_0(file)
                else:
                    shape, _, dtype = npy.read_array_header_2_0(file)
            if math.prod(shape) * dtype.itemsize > member.file_size and not dtype.hasobject:
                raise ValueError(f"{path}: {member.filename} claims the shape {shape}, but is smaller. Write it again.")


@contextmanager
def whole_file(path):
    """Yields an `h5py.File` under a temporary name beside `path`, renamed to `path` only if the block succeeds.

    Args:
        path (`str` or `Path`): the final name; an existing file is replaced at the end, in one step.

    Raises:
        FileNotFoundError: if the folder of `path` does not exist.
    """
    with atomic_path(path) as temporary, h5py.File(temporary, "w") as file:
        yield file


def open_whole(path):
    """Opens an HDF5 file for reading.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: if the file is truncated, not HDF5, being written by another process, or damaged where it would keep
            HDF5 busy for ever (`check_heaps`).
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"There is no file {path}.")
    try:
        file = h5py.File(path, "r")
    except BlockingIOError as error:
        raise ValueError(f"{path} is locked: another process has it open for writing. Wait, or close it.") from error
    except PermissionError as error:
        raise ValueError(f"{path} may not be read ({error}). Change its permissions.") from error
    except OSError as error:
        raise ValueError(
            f"{path} is truncated or no HDF5 file ({error}). Copy it again, or write it again from its source."
        ) from error
    try:
        check_heaps(path, _most_unpacked(path))
    except ValueError:
        file.close()
        raise
    return file


def as_strings(dataset):
    """Strings of an HDF5 dataset, of variable length in UTF-8 or of fixed length: a tuple of `str`."""
    return tuple(value.decode("utf-8") if isinstance(value, bytes) else str(value) for value in dataset[()])


def plain_attributes(node):
    """Attributes of an HDF5 file, group or dataset as a dict, however they were written.

    Strings of fixed length become `str`, arrays of one element that element: MATLAB and C programs write these.
    """

    def plain(value):
        if isinstance(value, np.ndarray) and value.size == 1:
            value = value.reshape(())[()]
        return value.decode("utf-8").rstrip("\0 ") if isinstance(value, bytes) else value

    return {name: plain(value) for name, value in node.attrs.items()}
