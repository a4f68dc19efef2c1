"""Strings and attributes of HDF5 files, checked before they are read: of damaged ones HDF5 may never return, or crash.

HDF5 up to 2.0 goes through a heap ("GCOL": what is of variable length, strings above all) by adding the length of each
piece to its place. A length of zero, as a page of zeros leaves it, keeps it there for ever, in C, where no signal of
Python arrives. So do circles in the list of what is free in a heap of names ("HEAP") and among the nodes of a tree
("TREE"). Where these lie is known only to what refers to them. So the strings of a file are read once through a file
object that sees each of them first, and hides the mark of a damaged one, which HDF5 then refuses.

HDF5 also asks for as much memory as what refers to a string says, up to 4 GB, before it looks at the heap, and reads as
many bytes as such a reference takes, whatever the type says. What a file object sees of headers tells both first. Not
seen are strings in compressed datasets and in structures: they end in a refusal too, but may take the memory for a
moment.
"""

import io
import itertools
import math
import os
import struct
import time
from collections import deque
from contextlib import suppress
from functools import lru_cache

import h5py
import numpy as np
from h5py import h5a, h5d, h5o, h5s, h5t

#: Bytes of the head of a heap, and of each piece.
_HEAD = 16
#: A file younger than this (s) may change again within one tick of the file system's clock: not remembered.
_YOUNG = 1.0
#: So many of the last pieces of headers are kept, and so large ones (bytes).
_HEADERS, _LARGEST_HEADER = 16, 2**16
# an attribute without a value
_NULL = 2
_SUPERBLOCK = b"\x89HDF\r\n\x1a\n"


class _Watched(io.FileIO):
    """A file whose damaged heaps lose their mark; `damaged` is the place of the last, or `None`."""

    damaged = None
    #: bytes of a length and of an address in this file
    width = address = 8

    def __init__(self, path):
        super().__init__(path)
        self.headers, self.ending = deque(maxlen=_HEADERS), set()
        # addresses count from the superblock, before which others may have put something: 512, 1024, 2048, ... bytes
        places = itertools.takewhile(lambda place: place < self._size(), (0, *(512 << n for n in range(40))))
        self.base = next((place for place in places if self._at(place, 8) == _SUPERBLOCK), 0)

    def readinto(self, buffer):
        place = self.tell()
        count = super().readinto(buffer)
        view = memoryview(buffer)
        ends = {b"GCOL": self._ends, b"HEAP": self._free_list_ends, b"TREE": self._row_ends}.get(bytes(view[:4]))
        if ends is not None and not ends(view[:count], place):
            view[:4] = bytes(4)
            self.damaged = place
        elif count <= _LARGEST_HEADER:
            self.headers.appendleft(bytes(view[:count]))
        return count

    def lengths(self, name):
        """What attributes of this name say of the lengths of their strings, where headers were among the last read."""
        found = []
        for header in self.headers:
            place = -1
            while (place := header.find(name + b"\0", place + 1)) >= 9:
                # the version, three sizes before the name, and what each is padded to
                if header[place - 9] == 3:
                    sizes, step = struct.unpack("<3H", header[place - 7 : place - 1]), 1
                else:
                    sizes, step = struct.unpack("<3H", header[place - 6 : place]), {1: 8, 2: 1}.get(header[place - 8])
                if sizes[0] != len(name) + 1 or step is None:
                    continue
                named, kind, space = (size + -size % step for size in sizes)
                if header[place + named] & 15 == h5t.VLEN:  # another node may have one of this name
                    if header[place + named + 4 :][:4] not in (struct.pack("<I", 8 + self.address), b""):
                        found.append(math.inf)  # of another size, HDF5 reads beyond what there is
                    place += named + kind
                    found += self._lengths(header[place + space :], self._count(header[place:])).ravel().tolist()
        return found

    def _count(self, space):
        """How many values there are, of the description of a shape."""
        version, axes, _, kind = space[:4]
        if version == 2 and kind == _NULL:
            return 0
        begin = 8 if version == 1 else 4
        sizes = [space[begin + self.width * axis :][: self.width] for axis in range(axes)]
        return math.prod(int.from_bytes(size, "little") for size in sizes)

    def lengths_of_dataset(self, node):
        """What a dataset that is stored in one piece says of the lengths of its strings."""
        if node.get_offset() is None:
            return []
        self.seek(node.get_offset())
        return self._lengths(self.read(node.get_storage_size()), None)

    def _lengths(self, raw, count):
        """Each: how many, the address of a heap, a number of four bytes."""
        step = 4 + self.address + 4
        return np.frombuffer(raw[: len(raw) // step * step], np.uint8).reshape(-1, step)[:count, :4].copy().view("<u4")

    def _ends(self, heap, begin):
        """Whether a heap can be gone through: every piece is as long as its own head, or longer."""
        end = int.from_bytes(heap[8 : 8 + self.width], "little")
        if end > self._size() - begin:
            return False
        if end > len(heap):  # HDF5 reads so much first, and the rest then
            heap = self._at(begin, end)
        place = _HEAD
        while place + _HEAD <= end:
            length = int.from_bytes(heap[place + 8 : place + 8 + self.width], "little")
            if int.from_bytes(heap[place : place + 2], "little"):  # 0 is free space, whose length counts its head
                length = _HEAD + length + -length % 8
            if not _HEAD <= length < 2 ** (8 * self.width) - place:
                return False
            place += length
        return True

    def _free_list_ends(self, heap, _begin):
        """Whether the list of what is free in a heap of names comes to its end: 1 is said to stand there."""
        size, first = (int.from_bytes(heap[8 + n * self.width :][: self.width], "little") for n in (0, 1))
        begin = int.from_bytes(heap[8 + 2 * self.width :][: self.address], "little") + self.base

        def free(offset):
            inside = offset != 1 and offset + 2 * self.width <= size and begin + offset < self._size()
            return begin + offset if inside else None  # HDF5 refuses what lies outside

        return self._chain_ends(free(first), lambda place: free(int.from_bytes(self._at(place, self.width), "little")))

    def _row_ends(self, _node, begin):
        """Whether what is right of a node of a tree comes to its end, where there is no address."""

        def right(place):
            node = self._at(place, 8 + 2 * self.address)
            following = int.from_bytes(node[8 + self.address :][: self.address], "little") + self.base
            return following if node[:4] == b"TREE" and following < self._size() else None

        return self._chain_ends(begin, right)

    def _chain_ends(self, place, following):
        """Whether places that lead to one another, the last to `None`, form no circle."""
        seen = set()
        while place is not None and place not in self.ending:
            if place in seen:
                return False
            seen.add(place)
            place = following(place)
        self.ending |= seen  # a long chain is gone through once
        return True

    def _at(self, place, count):
        """Bytes of the file, which stays where it is."""
        before = self.tell()
        self.seek(place)
        data = self.read(count)
        self.seek(before)
        return data

    def _size(self):
        return os.fstat(self.fileno()).st_size


def check_heaps(path, most):
    """Raises a `ValueError` if reading an attribute or string of an HDF5 file would never end, or crash.

    Args:
        path (`Path`): the file.
        most (`int`): datasets that claim more bytes are left out: nobody may read them.
    """
    state = os.stat(path)
    young = time.time() - state.st_mtime < _YOUNG
    (_check.__wrapped__ if young else _check)(path, most, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=256)  # the recordings of one file are read one after the other
def _check(path, most, _changed, _size):
    problem = None
    with _Watched(path) as watched:
        try:
            with h5py.File(watched, "r") as file:
                watched.address, watched.width = file.id.get_create_plist().get_sizes()
                problem = _problem(watched, file.id, b"/", most)
                # leaves out the top, and ends at what is no `None`
                problem = problem or h5o.visit(file.id, lambda name: _problem(watched, file.id, name, most))
        except Exception as error:  # of a dozen kinds
            problem = error
    if watched.damaged is not None:
        problem = f"the heap at byte {watched.damaged}"
    if problem is not None:
        raise ValueError(f"{path} is damaged ({problem}). Copy it again, or write it again from its source.")


def _problem(watched, file, name, most):
    """Reads what may lie in heaps, of one node: what is wrong with its attributes and strings, or `None`."""
    where = name.decode(errors="replace")
    size = watched._size()
    with suppress(Exception):
        node = h5o.open(file, name)
        for number in range(h5a.get_num_attrs(node)):
            try:
                attribute = h5a.open(node, index=number)
            except Exception as error:
                return f"attribute {number} of {where}: {error}"
            kind = attribute.get_type()
            with suppress(Exception):
                if _is_plain(kind):
                    continue
                lengths = watched.lengths(attribute.name) if _varies(kind) else []
                if not _is_sound(kind) or np.max(lengths, initial=0) > size:
                    return f"attribute {attribute.name.decode(errors='replace')} of {where}"
                if attribute.dtype.hasobject:
                    attribute.read(np.empty(attribute.shape, attribute.dtype))
        if isinstance(node, h5d.DatasetID) and node.get_storage_size() and not _is_plain(kind := node.get_type()):
            if not _is_sound(kind) or (_varies(kind) and np.max(watched.lengths_of_dataset(node), initial=0) > size):
                return f"the strings of {where}"
            if node.dtype.hasobject and math.prod(node.shape) * node.dtype.itemsize <= most:
                node.read(h5s.ALL, h5s.ALL, np.empty(node.shape, node.dtype))
    return None


def _is_plain(kind):
    return isinstance(kind, h5t.TypeFloatID | h5t.TypeIntegerID)


def _varies(kind):
    return isinstance(kind, h5t.TypeVlenID) or (isinstance(kind, h5t.TypeStringID) and kind.is_variable_str())


def _is_sound(kind):
    """Whether a type of variable length is a sequence (0) or a string (1): HDF5 crashes when it reads another."""
    return not isinstance(kind, h5t.TypeVlenID) or kind.encode()[3] & 15 <= 1
