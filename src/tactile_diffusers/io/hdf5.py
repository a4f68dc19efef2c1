"""HDF5 files: written whole, refused by name when damaged, attributes and strings as plain Python values.

Not found here is damage that keeps the HDF5 library itself busy for ever: do not open HDF5 files from strangers.
"""

from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from .files import atomic_path
from .reading import check_size


@contextmanager
def whole_file(path):
    """Yields an `h5py.File` under a temporary name beside `path`, renamed to `path` only if the block succeeds.

    Args:
        path (`str` or `Path`): the final name; an existing file is replaced at the end.

    Raises:
        FileNotFoundError: if the folder of `path` does not exist.
    """
    with atomic_path(path) as temporary, h5py.File(temporary, "w") as file:
        yield file


def open_whole(path):
    """Opens an HDF5 file for reading.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: if the file is truncated, not HDF5, or being written by another process.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"There is no file {path}.")
    try:
        return h5py.File(path, "r")
    except BlockingIOError as error:
        raise ValueError(f"{path} is locked: another process has it open for writing. Wait, or close it.") from error
    except PermissionError as error:
        raise ValueError(f"{path} may not be read ({error}). Change its permissions.") from error
    except OSError as error:
        raise ValueError(
            f"{path} is truncated or not an HDF5 file ({error}). Copy it again, or write it again from its source."
        ) from error


def check_sizes(file):
    """`check_size` of all datasets of an open `h5py.File` together: a header may claim any size."""
    claimed = []
    file.visititems(lambda _, node: claimed.append(node.nbytes) if isinstance(node, h5py.Dataset) else None)
    check_size(file.filename, sum(claimed))


def as_strings(dataset):
    """Strings of an HDF5 dataset, of variable length in UTF-8 or of fixed length: a tuple of `str`."""
    return tuple(value.decode("utf-8") if isinstance(value, bytes) else str(value) for value in dataset[()])


def plain_attributes(node):
    """Attributes of an HDF5 file, group or dataset as a dict of plain Python values.

    MATLAB and C programs write strings of fixed length and arrays of one element: these become `str` and the element.
    """

    def plain(value):
        if isinstance(value, np.ndarray) and value.size == 1:
            value = value.reshape(())[()]
        return value.decode("utf-8").rstrip("\0 ") if isinstance(value, bytes) else value

    return {name: plain(value) for name, value in node.attrs.items()}
