"""Files that hold a tree of arrays: HDF5, MATLAB (v4 to v7.3) and npz, as nested mappings.

A place in a tree is written "group/array". A vector may be stored as a row or a column, and of a 2-D array the longer
axis is time: MATLAB and HDF5 disagree about which comes first.
"""

import struct
import zlib
from collections.abc import Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

import h5py
import numpy as np
from scipy import io

from ...io.hdf5 import open_whole
from ...io.reading import check_archive, check_size

#: Attributes of HDF5 groups and arrays, and scalars beside arrays, that give the sampling rate in Hz.
RATE_NAMES = ("rate", "sampling_rate", "sampling_rate_hz", "fs", "Fs")
#: What has more is no table; a damaged header may claim any number.
MOST_COLUMNS = 10_000
# kind of an element of a mat file
_COMPRESSED = 15


@contextmanager
def open_tree(path, kind):
    """Yields the top of a file's tree: a mapping of names to mappings and arrays.

    Args:
        path (`Path`): the file.
        kind (`str`): "hdf5", "mat" or "npz".

    Raises:
        FileNotFoundError, ValueError: if there is no file, or it is none of this kind.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"There is no file {path}.")
    if kind == "hdf5" or (kind == "mat" and h5py.is_hdf5(path)):  # MATLAB since v7.3
        with open_whole(path) as file:
            yield file
    else:
        yield _in_memory(path, kind, path.stat().st_mtime_ns)


@lru_cache(maxsize=1)  # the recordings of one file are read one after the other
def _in_memory(path, kind, _changed):
    """The tree of an npz, or of a mat below v7.3."""
    try:
        if kind == "npz":
            check_archive(path)
            with np.load(path, allow_pickle=False) as arrays:
                return _nested({name: arrays[name] for name in arrays.files})
        _check_mat(path)
        return {name: value for name, value in io.loadmat(path, simplify_cells=True).items() if name[:2] != "__"}
    except Exception as error:  # scipy and zipfile raise many kinds
        raise ValueError(
            f"{path} cannot be read as {kind} ({error}). Write it again, with arrays of numbers and no objects."
        ) from error


def _check_mat(path):
    """`check_size` of a mat file of v5: each variable is compressed for itself, and begins with its size."""
    with path.open("rb") as file:
        order = {b"IM": "<", b"MI": ">"}.get(file.read(128)[126:])
        claimed = 0
        while order and len(tag := file.read(8)) == 8:  # v4 holds numbers as they are
            kind, length = struct.unpack(order + "2I", tag)
            if length == 0:
                break
            claimed += length
            if kind == _COMPRESSED:
                start = file.read(min(length, 4096))  # eight bytes may need a whole table of codes
                claimed += struct.unpack(order + "2I", zlib.decompressobj().decompress(start, 8))[1]
                length -= len(start)
            file.seek(length, 1)
    check_size(path, claimed)


def _nested(arrays):
    tree = {}
    for name, array in arrays.items():
        *groups, last = name.split("/")
        node = tree
        for group in groups:
            node = node.setdefault(group, {})
        node[last] = array
    return tree


def _members(node):
    """Children of a node: of a group or struct by name, of a list of structs or cells by number."""
    if isinstance(node, Mapping):
        named = {name if isinstance(name, str) else name.decode(errors="backslashreplace"): name for name in node}
        return {text: node[name] for text, name in named.items() if text[:1] != "#"}  # those are MATLAB's own groups
    if isinstance(node, list) or (_is_array(node) and node.dtype == object and not is_text(node)):
        return {str(i): child for i, child in enumerate(node)} if not isinstance(node, h5py.Dataset) else {}
    return {}


def _is_array(node):
    return isinstance(node, np.ndarray | h5py.Dataset)


def is_text(array):
    """Whether an array holds text."""
    if isinstance(array, h5py.Dataset):
        return h5py.check_string_dtype(array.dtype) is not None
    return array.dtype.kind in "SU" or (array.dtype == object and all(isinstance(value, str) for value in array.flat))


def tree_nodes(node, name="", above=()):
    """All places of a tree, depth first: yields (name, node); "" = the top. Links back to a group above end there."""
    yield name, node
    above = (*above, node) if isinstance(node, h5py.Group) else ()
    for member, child in _members(node).items():
        if not (isinstance(child, h5py.Group) and child in above):
            yield from tree_nodes(child, f"{name}/{member}" if name else member, above)


def tree_node(node, name):
    """The node at a place, or `None`."""
    for part in name.split("/") if name else ():
        node = _members(node).get(part)
        if node is None:
            return None
    return node


def tree_columns(node):
    """Columns of a node.

    Args:
        node: an array, or a mapping whose arrays are columns.

    Returns:
        `dict`: name -> (length, function without arguments that reads it as a 1-D array). A vector in a mapping has
        its own name, a 2-D array `force` gives "force/0", "force/1", .., a structured one "force/<field>".
    """
    if _is_array(node):
        return _array_columns(node)
    columns = {}
    for name, child in _members(node).items():
        if _is_array(child):
            for part, column in _array_columns(child).items():
                columns[name if part == "0" and _is_vector(child) else f"{name}/{part}"] = column
    return columns


def _is_vector(array):
    return array.dtype.names is None and sum(size > 1 for size in array.shape) == 1


def _array_columns(array):
    if array.dtype.names is not None:
        fields = [name for name in array.dtype.names if array.dtype[name].kind in "fiubSU"]
        return {name: (array.size, lambda name=name: np.ravel(array[name])) for name in fields}
    if array.dtype.kind not in "fiub" and not is_text(array):
        return {}
    if _is_vector(array):
        return {"0": (array.size, lambda: np.ravel(array[()]))}
    if array.ndim != 2 or not 0 < min(array.shape) <= MOST_COLUMNS or array.size == 1:
        return {}
    time = int(array.shape[1] > array.shape[0])
    part = {0: lambda i: array[:, i], 1: lambda i: array[i, :]}[time]
    return {str(i): (array.shape[time], lambda i=i: part(i)) for i in range(array.shape[1 - time])}


def tree_tables(tree):
    """Places of a tree that are tables: groups that hold vectors, and 2-D or structured arrays in other groups."""
    names = []
    for name, node in tree_nodes(tree):
        if isinstance(node, Mapping):
            if any(_is_array(child) and _is_vector(child) for child in _members(node).values()):
                names.append(name)
        elif _is_array(node) and name.rpartition("/")[0] not in names and tree_columns(node):
            names.append(name)
    return names


def tree_rate(node):
    """Sampling rate in Hz that a node tells as an attribute or a scalar member, or `None`."""
    found = dict(getattr(node, "attrs", {}))
    if isinstance(node, Mapping):
        found |= {name: node[name] for name in RATE_NAMES if name in node}
    for name in RATE_NAMES:
        value = found.get(name)
        if isinstance(value, h5py.Dataset):
            value = value[()] if value.size == 1 else None
        value = np.asarray(value)
        if value.dtype.kind in "fiu" and value.size == 1:
            return float(value.ravel()[0])
    return None
