"""Headers that claim 2^40 samples, archives made to fill the memory: refused in time, before memory is asked for."""

import io as streams
import multiprocessing
import resource
import struct
import time
import warnings
import zipfile
import zlib
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pandas as pd
import pytest
import soundfile
from dataset.ratings import read_ratings_file
from dataset.shards import plan_shards, write_shard
from uploads import read_upload

from tactile_diffusers.data import PreparedDataset, RecordingsFile, RecordingsWriter
from tactile_diffusers.data.folder.tables import list_tables
from tactile_diffusers.export import FORMATS, read_generated
from tactile_diffusers.signal import RATING_AXES

HUGE = 2**40
#: Bytes that a bomb unpacks to: above what is allowed, and quick to make.
BOMB = 5 * 2**24
#: Bytes that all readers together may take beyond what importing them takes.
MOST_BYTES = 150 * 2**20


def _npy(shape, dtype="<f4"):
    """The header of an npy file, and ten bytes."""
    text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}"
    text = text.ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() + bytes(10)


def _zip(path, **members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, content in members.items():
            archive.writestr(name.replace("__", "/").replace("_", "."), content)


def _unwritten(file, name, shape, dtype="f4"):
    """A dataset of which nothing is stored but its shape."""
    return file.create_dataset(name, shape=shape, dtype=dtype, chunks=tuple(min(size, 1024) for size in shape))


def _wav(length, form=1):
    head = b"RIFF" + struct.pack("<I", 36) + b"WAVEfmt " + struct.pack("<IHHIIHH", 16, form, 1, 10_000, 20_000, 2, 16)
    return head + b"data" + struct.pack("<I", length) + bytes(2000)


def _mat(dims, data, compress):
    def element(kind, content):
        return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)

    body = element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<2i", *dims)) + element(1, b"force")
    body = struct.pack("<II", 14, len(body) + 8 + len(data)) + body + struct.pack("<II", 9, len(data)) + data
    if compress:
        body = zlib.compress(body, 1)
        body = struct.pack("<II", 15, len(body)) + body
    return b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM" + body


def _chunk(name, content):
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def _png(width, height):
    header = _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    text = _chunk(b"tEXt", b"tactile_diffusers\0{}")
    return b"\x89PNG\r\n\x1a\n" + header + text + _chunk(b"IDAT", zlib.compress(bytes(10_000))) + _chunk(b"IEND", b"")


def _archives(folder):
    zeros = bytes(BOMB)
    _zip(folder / "bomb.npz", texture_npy=_npy((BOMB // 4,))[:-10] + zeros, rate_npy=_npy((), "<f8"))
    _zip(folder / "header.npz", texture_npy=_npy((HUGE,)))
    pd.DataFrame({"fx": [1.0]}).to_excel(folder / "good.xlsx", index=False)
    with zipfile.ZipFile(folder / "good.xlsx") as book:
        members = {name: book.read(name) for name in book.namelist()}
    with zipfile.ZipFile(folder / "bomb.xlsx", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as book:
        for name, content in members.items():
            tail = b" " * BOMB if name == "xl/worksheets/sheet1.xml" else b""
            book.writestr(name, content + tail)
    (folder / "bomb.mat").write_bytes(_mat((BOMB // 8, 1), zeros, True))
    (folder / "header.mat").write_bytes(_mat((2**31 - 1, 2**9), bytes(80), False))
    pd.DataFrame({"fx": np.zeros(BOMB // 8)}).to_parquet(folder / "bomb.parquet")
    tables = ("bomb.npz", "header.npz", "bomb.xlsx", "bomb.mat", "header.mat", "bomb.parquet")
    return [("table", name) for name in tables] + [("npz", "bomb.npz"), ("npz", "header.npz")]


def _arrays(folder):
    (folder / "header.npy").write_bytes(_npy((HUGE,)))
    (folder / "objects.npy").write_bytes(_npy((HUGE,), "|O"))
    (folder / "header.wav").write_bytes(_wav(2**32 - 1))
    (folder / "float.wav").write_bytes(_wav(2**32 - 1, form=3))
    sound = streams.BytesIO()
    soundfile.write(sound, np.zeros(BOMB // 2, np.int16), 10_000, format="FLAC")
    (folder / "flac.wav").write_bytes(sound.getvalue())
    about = {"sampling_rate": 10_000, "friction_coefficient": 0.5, "reference_speed": 80.0, "ratings": [0.0, 0.0, 0.0]}
    FORMATS["wav"].write(folder / "ours.wav", np.ones(100), seed=0, **about)
    (folder / "ours.wav").write_bytes(_wav(2**32 - 1))
    (folder / "picture.png").write_bytes(_png(2**31 - 1, 2**31 - 1))
    (folder / "quieter.png").write_bytes(_png(13_000, 13_000))  # Pillow warns of it, and makes it
    found = [("table", name) for name in ("header.npy", "objects.npy", "header.wav", "float.wav", "flac.wav")]
    found += [("ratings", "header.npy"), ("ratings", "objects.npy"), ("upload", "header.wav"), ("wav", "ours.wav")]
    return found + [("png", "picture.png"), ("png", "quieter.png")]


def _stores(folder):
    with h5py.File(folder / "table.h5", "w") as file:
        _unwritten(file, "force", (HUGE,)).attrs["rate"] = 5000
    with h5py.File(folder / "texture.h5", "w") as file:
        file.attrs.update(format="tactile-texture", version=1, friction_coefficient=0.5, ratings=[0.0] * 3, seed=0)
        _unwritten(file, "texture", (HUGE,)).attrs.update(rate=10_000, unit="N")
    with RecordingsWriter(folder / "recordings.h5", source="a test", licence="CC0-1.0") as writer:
        writer.add_recording("a", "0", "0", lateral=np.ones(5000), lateral_rate=2500)
    with h5py.File(folder / "recordings.h5", "r+") as file:
        _unwritten(file, "recordings/b/0/0/lateral", (HUGE,)).attrs.update(rate=2500.0, unit="N")
    with h5py.File(folder / "prepared.h5", "w") as file:
        file.attrs.update(format="tactile-prepared", version=3, sampling_rate=10_000, segment_samples=16_384)
        file.attrs.update(band=[20.0, 1000.0], unit="N", source="a test", limits="{}", hold_out="{}")
        _unwritten(file, "surfaces/name", (HUGE,))
    rows = {"texture": np.zeros((2, BOMB // 8), np.float32)}
    for name, number in (("generated", 2), ("endless", HUGE)):
        (folder / name / "data").mkdir(parents=True)
        settings = {"num_textures": number, "textures_per_shard": 2, "sampling_rate": 10_000}
        shard = next(plan_shards(number, 2))
        write_shard(folder / name / shard["file"], 2, settings, {"rating_axes": []}, [rows])
    found = [("table", "table.h5"), ("hdf5", "texture.h5"), ("recordings", "recordings.h5")]
    return found + [("prepared", "prepared.h5"), ("generated", "generated"), ("generated", "endless")]


def _columns(path):
    return [table.numbers(name) for table in list_tables(path) for name in table.names]


def _recordings(path):
    with RecordingsFile(path) as file:
        return [file.read(name) for name in file.names]


READERS = {
    "table": _columns,
    **{name: FORMATS[name].read for name in ("npz", "hdf5", "wav", "png")},
    "recordings": _recordings,
    "prepared": lambda path: PreparedDataset(path, "all"),
    "generated": lambda path: read_generated(path)[:],
    "ratings": lambda path: read_ratings_file(path, SimpleNamespace(rating_axes=list(RATING_AXES)), 10),
    "upload": lambda path: read_upload(path, rate=5000),
}


def _status(name):
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(name + ":"))


def _read_all(cases, answer):
    """In a process of its own, so that its largest memory is that of the readers.

    The limit is a net for the machine: a reader that runs into it has asked for the memory, which must not happen.
    """
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_AS, (_status("VmSize") + 2**33,) * 2)
    for reader, path in cases:
        before, start = _status("VmHWM"), time.process_time()
        try:
            READERS[reader](path)
            found = {"type": "nothing", "message": "", "cause": ""}
        except Exception as error:
            found = {"type": type(error).__name__, "message": str(error), "cause": type(error.__cause__).__name__}
        found |= {"seconds": time.process_time() - start, "bytes": _status("VmHWM") - before}
        answer.send({"reader": reader, "path": str(path), **found})
    answer.close()


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("absurd")
    cases = [(reader, folder / name) for make in (_archives, _arrays, _stores) for reader, name in make(folder)]
    fork = multiprocessing.get_context("fork")  # everything is imported already
    ours, theirs = fork.Pipe(duplex=False)
    child = fork.Process(target=_read_all, args=(cases, theirs))
    child.start()
    theirs.close()
    found = []
    while len(found) < len(cases) and ours.poll(120):
        found.append(ours.recv())
    child.kill()
    child.join()
    assert len(found) == len(cases)
    return found


def test_each_is_refused_with_its_name(outcomes):
    for found in outcomes:
        assert found["type"] == "ValueError", found
        assert Path(found["path"]).name in found["message"] or found["reader"] == "upload", found


def test_none_takes_long(outcomes):
    assert not [found for found in outcomes if found["seconds"] > 2]


def test_memory_is_not_even_asked_for(outcomes):
    # NumPy asks for the 4 TiB of an npz header, and takes nothing: the system refuses
    assert {Path(found["path"]).name for found in outcomes if "MemoryError" in found["cause"]} <= {"header.npz"}
    assert sum(found["bytes"] for found in outcomes) < MOST_BYTES, sorted(outcomes, key=lambda found: -found["bytes"])
