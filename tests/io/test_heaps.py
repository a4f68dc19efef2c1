"""The check of strings before HDF5 reads them: no good file is refused. For damaged ones see tests/fuzz."""

import os

import h5py
import numpy as np
import pytest

from tactile_diffusers.io.files import open_whole

VERSIONS = [
    {},
    {"libver": "latest"},
    {"libver": "v110"},
    {"userblock_size": 512},
    {"track_order": True},
    {"libver": "latest", "fs_strategy": "page"},
]


def _group(group, unit):
    """Whatever may be of variable length, and attributes of one name and many types."""
    data = group.create_dataset("data", data=np.arange(5.0))
    data.attrs["unit"] = unit
    data.attrs["empty"] = h5py.Empty(h5py.string_dtype())
    data.attrs.update({f"note {number}": "v" * number for number in range(20)})
    group.create_dataset("text", data=["a", "bb", "c" * 5000])
    group.create_dataset("packed", data=["a", "bb", "c" * 50], compression="gzip", chunks=(2,))
    group.create_dataset("unwritten", shape=(3,), dtype=h5py.string_dtype())
    group.create_dataset("lists", shape=(3,), dtype=h5py.vlen_dtype("f8"))[0] = [1.0, 2.0]
    group.create_dataset("structure", shape=(3,), dtype=[("a", "f4"), ("b", h5py.string_dtype())])[0] = (1.0, "b")
    lists = np.array([np.array([1.0, 2.0]), np.array([3.0])], dtype=object)
    group.attrs.create("lists", lists, dtype=h5py.vlen_dtype("f8"))
    group.attrs.update(reference=data.ref, region=data.regionref[0:2], fixed=np.bytes_("abc"), flag=True)
    data.make_scale("time")
    group.create_dataset("scaled", data=np.zeros(5)).dims[0].attach_scale(data)
    group["soft"], group["out"] = h5py.SoftLink("/nowhere"), h5py.ExternalLink("no.h5", "/a")
    group["back"] = group.file["/"]


@pytest.mark.parametrize("options", VERSIONS, ids=str)
def test_good_files_of_many_kinds(tmp_path, options):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w", **options) as file:
        for number, unit in enumerate((1e300, ["N", "mm", "x"], "newtons" * 20, np.full((2, 2), 1e300))):
            _group(file.create_group(f"group {number}"), unit)
        file["type"] = np.dtype("f8")
        file.attrs["text"] = "\u00fc" * 3000
    with open_whole(path) as file:
        assert file.attrs["text"] == "\u00fc" * 3000 and file["group 2/data"].attrs["unit"] == "newtons" * 20


@pytest.mark.parametrize("userblock", [0, 512])
def test_names_that_were_removed(tmp_path, userblock):
    """Free space in heaps of names; what stands before the superblock moves all addresses."""
    path = tmp_path / "a.h5"
    with h5py.File(path, "w", userblock_size=userblock) as file:
        for number in range(60):
            file[f"{'name' * (number % 5)} {number}"] = number
        for number in (3, 7, 8, 30, 41):
            del file[f"{'name' * (number % 5)} {number}"]
    with open(path, "r+b") as file:
        file.write(bytes(userblock))
    with open_whole(path) as file:
        assert len(file) == 55


def test_strings_that_were_written_again(tmp_path):
    """Heaps with free space between and behind, and headers with what attributes were before."""
    path = tmp_path / "a.h5"
    for round_ in range(4):
        with h5py.File(path, "a") as file:
            for number in range(30):
                file.attrs[f"note {number % 7}"] = "x" * (number * 50 + round_) if number % 3 else float(number)
                if "text" in file:
                    del file["text"]
                file["text"] = ["y" * (number * round_)] * number or [""]
        open_whole(path).close()


def test_a_file_is_checked_again_when_it_changed(tmp_path):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file.attrs["text"] = "x"
    os.utime(path, (1e9, 1e9))
    for _ in range(2):
        open_whole(path).close()
    data = bytearray(path.read_bytes())
    begin = data.index(b"GCOL") + 24
    data[begin : begin + 8] = bytes(8)
    data[begin - 8 : begin - 6] = bytes(2)
    path.write_bytes(data)
    with pytest.raises(ValueError, match="a.h5 is damaged .*heap at byte"):
        open_whole(path)
