"""Files that hold a tree of arrays: HDF5, MATLAB (v4 to v7.3) and npz.

A place in a tree is written "group/array". A vector may be stored as a row or a column, and of a 2-D array the longer
axis is time: MATLAB and HDF5 disagree about which comes first.
"""

import struct
import zlib
from collections import defaultdict
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import h5py
import numpy as np
from scipy import io

from ...io.hdf5 import open_whole, plain_attributes
from ...io.reading import check_archive, check_size, reading

#: Attributes of HDF5 groups and arrays, and scalars beside arrays, that give the sampling rate in Hz.
RATE_NAMES = ("rate", "sampling_rate", "sampling_rate_hz", "fs", "Fs")
#: What has more is no table; a damaged header may claim any number.
MOST_COLUMNS = 10_000
# kind of an element of a mat file
_COMPRESSED = 15


class Tree:
    """What a file of arrays holds.

    Args:
        arrays (`dict`): place -> array, or what is read like one.
        rates (`dict`): place of a group or an array -> Hz that it states; default: by scalars beside the arrays.
        attributes (`dict`): of the file.

    Attributes:
        columns (`dict`): place of a group or array ("" = the top) -> name -> (length, function without arguments that
            reads the column as a 1-D array). In a group a vector has its own name, a 2-D array `force` gives "force/0",
            "force/1", .., a structured one "force/<field>".
        tables (`list[str]`): places that are tables: groups that hold vectors, and 2-D or structured arrays in others.
    """

    def __init__(self, arrays, rates=None, attributes=None):
        self.columns, self.attributes, members, whole = {"": {}}, attributes or {}, defaultdict(dict), set()
        for place, array in arrays.items():
            group, _, name = place.rpartition("/")
            parts = group.split("/")
            for count in range(1, len(parts) + 1):
                self.columns.setdefault("/".join(parts[:count]), {})
            members[group][name] = array
            columns = self.columns[place] = _array_columns(array)
            if _is_vector(array):
                whole.add(group)
                columns = {name: columns["0"]} if columns else {}
            elif place:
                columns = {f"{name}/{part}": column for part, column in columns.items()}
            if place:
                self.columns[group] |= columns
        self.rates = {group: _rate_of(values) for group, values in members.items()} if rates is None else rates
        held = (place for place in arrays if self.columns[place] or _group(place) in whole)
        self.tables = list(dict.fromkeys(_group(place) if _group(place) in whole else place for place in held))

    def rate(self, place):
        """Hz that a place, or the group it is in, states; `None` if none does."""
        return self.rates.get(place) or self.rates.get(_group(place))


@dataclass
class _Stored:
    """A dataset of an HDF5 file that is read when it is indexed."""

    path: Path
    name: str | bytes
    shape: tuple
    dtype: np.dtype

    def __getitem__(self, index):
        with open_whole(self.path) as file:
            return file[self.name][index]


def open_tree(path, kind):
    """Looks at a file of arrays of kind "hdf5", "mat" or "npz": a `Tree`; datasets of HDF5 are read later."""
    if not path.is_file():
        raise FileNotFoundError(f"There is no file {path}.")
    with reading(path, kind, "Write it again, with arrays of numbers and no objects."):
        return _open_tree(path, kind, path.stat().st_mtime_ns)


@lru_cache(maxsize=1)  # the recordings of one file are read one after the other
def _open_tree(path, kind, _changed):
    if kind == "hdf5" or (kind == "mat" and h5py.is_hdf5(path)):  # MATLAB since v7.3
        return _hdf5_tree(path)
    if kind == "npz":
        check_archive(path)
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    else:
        _check_mat(path)
        arrays = {}
        for name, value in io.loadmat(path, simplify_cells=True).items():
            if not name.startswith("__"):
                _flatten(name, value, arrays)
    return Tree(arrays)


def _hdf5_tree(path):
    arrays, rates, of_arrays = {}, {}, defaultdict(set)

    def visit(name, node):
        place = name if isinstance(name, str) else name.decode(errors="backslashreplace")
        if any(part.startswith("#") for part in place.split("/")):  # MATLAB's own groups
            return
        rates[place] = _rate_of(node.attrs)
        if isinstance(node, h5py.Dataset):
            group, _, last = place.rpartition("/")
            if last in RATE_NAMES and node.size == 1:
                rates[group] = rates.get(group) or _rate_of({last: node[()]})
            if rates[place]:
                of_arrays[group].add(rates[place])
            if node.shape is not None:
                arrays[place] = _Stored(path, name, node.shape, node.dtype)

    with open_whole(path) as file:
        rates[""] = _rate_of(file.attrs)
        file.visititems(visit)  # each object once, so links that lead back end
        for group, found in of_arrays.items():  # a rate that its arrays share is the group's
            rates[group] = rates.get(group) or (found.pop() if len(found) == 1 else None)
        return Tree(arrays, rates, plain_attributes(file))


def _group(place):
    return place.rpartition("/")[0]


def _flatten(place, value, arrays):
    """Adds what `loadmat` gave for one variable: structs are dicts, cells are arrays of objects."""
    if isinstance(value, dict):
        for name, child in value.items():
            _flatten(f"{place}/{name}", child, arrays)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        items = list(value) if isinstance(value, list) else list(value.flat)
        if items and all(isinstance(item, str) for item in items):
            arrays[place] = np.array(items)
        else:
            for number, item in enumerate(items):
                _flatten(f"{place}/{number}", item, arrays)
    else:
        arrays[place] = np.asarray(value)


def _rate_of(values):
    """The first positive number among values with the name of a rate, or `None`."""
    for name in RATE_NAMES:
        value = np.asarray(values[name] if name in values else "")
        if value.dtype.kind in "fiu" and value.size == 1:
            return float(value.ravel()[0])
    return None


def _is_vector(array):
    return array.dtype.names is None and sum(size > 1 for size in array.shape) == 1


def _array_columns(array):
    shape, dtype = array.shape, array.dtype
    size = int(np.prod(shape, dtype=object))
    if dtype.names is not None:
        fields = [name for name in dtype.names if dtype[name].kind in "fiubSU"]
        return {name: (size, lambda name=name: np.ravel(array[name])) for name in fields}
    if dtype.kind not in "fiubSU" and h5py.check_string_dtype(dtype) is None:
        return {}
    if _is_vector(array):
        return {"0": (size, lambda: np.ravel(array[()]))}
    if len(shape) != 2 or not 0 < min(shape) <= MOST_COLUMNS or size == 1:
        return {}
    time = int(shape[1] > shape[0])
    read = (lambda i: array[:, i]) if time == 0 else (lambda i: array[i, :])
    return {str(i): (shape[time], lambda i=i: read(i)) for i in range(shape[1 - time])}


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
