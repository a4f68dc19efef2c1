"""What fuzzing the readers found, one input for each kind of fault: refused as promised, or read as documented."""

import json
import math
import struct
import zipfile
import zlib

import h5py
import numpy as np
import pytest

from tactile_diffusers.data import RecordingsFile, RecordingsWriter
from tactile_diffusers.data.folder.tables import list_tables

# of NumPy, on the way to a refusal
pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")
GONE = object()
DEEP = "[" * 100_000
#: Reader -> (where in a good file's JSON, what stands there instead).
JSON_FINDINGS = {
    "wav-sidecar": [
        *[(("newtons_per_full_scale",), value) for value in ([], [None], "", None, [[1]], {}, 1e308, math.nan)],
        *[(("ratings",), value) for value in (0.5, [], {}, "x", [1.5, "x", -1.0], [[[1]], None, None], None)],
        *[(("sampling_rate",), value) for value in (1e308, 0, -1, None, "x", 2**70, [])],
        *[(("friction_coefficient",), value) for value in ([], {}, "x", -1)],
    ],
    "png-text": [
        *[(("samples",), value) for value in (0, -1, 0.5, math.nan, 2**70, "x", [], None, 1e308)],
        *[(("pixel_pitch",), value) for value in (0, -1, "x", {}, math.inf, math.nan, -1e-320)],
        *[(("friction_per_count",), value) for value in (-1, "x", [], math.nan, 1e308)],
        *[(("friction_at_zero",), value) for value in ("", [], [[1]], math.inf)],
        *[(("normal_force",), value) for value in (-1, [], None, "x")],
        *[(("reference_speed",), value) for value in (0, {}, [], "x", math.inf)],
        *[(("friction_coefficient",), value) for value in ("x", [])],
        *[(("sampling_rate",), value) for value in (0, 1e308, [], math.nan)],
    ],
    "hjif": [(("timescale",), math.inf), (("perceptions", 0, "channels", 0, "gain"), math.nan)],
    "haptic": [
        (("signals", "continuous", "envelopes", kind, 1, key), value)
        for kind, key in (("amplitude", "amplitude"), ("amplitude", "time"), ("frequency", "frequency"))
        for value in (math.nan, 2**70)
    ],
    "ahap": [(("Metadata", "tactile_diffusers", "ratings"), [1.5, None, {}])],
}
#: Reader -> bytes that are no file of its kind.
NOTHING_OF_THE_KIND = {
    "wav": [b"", b"RIFF|\2\0\0WAVEfmt \x10\0\0\0\1\0\1\0\x10'\0\0 N\0\0\2\0\x10\0data\0\0\0\0"],
    "wav-sidecar": [b"", b"-1@e-321", b'{"unit": "\xff"}', b"[]", b"5", DEEP.encode()],
    "png-text": [b"", b"-1 2", b"{", b"[]", DEEP.encode()],
    "hjif": [b"", b"[]", b"{}", DEEP.encode()],
    "npz-members": [
        b"",
        b"\3" + b"\x93NUMPY\1\0v\0" + b"{'descr': '<f2', 'shape': (, }".ljust(118),  # a header that does not end
        b"\6" + b"no array",
    ],
}


def _changed(tree, where, value):
    *path, last = where
    node = tree
    for key in path:
        node = node[key]
    if value is GONE:
        del node[last]
    else:
        node[last] = value
    return tree


@pytest.mark.parametrize(
    "name, where, value", [(name, *finding) for name, findings in JSON_FINDINGS.items() for finding in findings]
)
def test_odd_values_in_json(readers, tmp_path, name, where, value):
    target = readers.TARGETS[name]
    made = json.dumps(_changed(json.loads(target.seeds()[0]), where, value)).encode()
    assert readers.fault(target, made, tmp_path) is None


@pytest.mark.parametrize("name, data", [(name, data) for name, all_ in NOTHING_OF_THE_KIND.items() for data in all_])
def test_nothing_of_the_kind(readers, tmp_path, name, data):
    assert readers.fault(readers.TARGETS[name], data, tmp_path) is None


@pytest.mark.parametrize(
    "offset, value",
    [
        (6, 210),  # zip version 21.0
        (8, 1),  # encrypted
        (8, 32),  # compressed patched data
        (10, 9),  # methods of compression: one that is not supported, one that the data are not
        (10, 12),
        (42, 0xFFFF_FFFF),  # where the member begins
    ],
)
def test_an_odd_directory_of_an_npz(readers, tmp_path, offset, value):
    data = bytearray(readers.TARGETS["npz"].seeds()[0])
    entry = data.index(b"PK\1\2")
    kind = "<I" if offset == 42 else "<H"
    struct.pack_into(kind, data, entry + offset, value)
    if offset in (8, 10):  # the member's own header says the same
        struct.pack_into(kind, data, data.index(b"PK\3\4") + offset - 2, value)
    assert readers.fault(readers.TARGETS["npz"], bytes(data), tmp_path) is None


def test_a_damaged_stream_in_an_npz(readers, tmp_path):
    data = bytearray(readers.TARGETS["npz"].seeds()[0])
    (tmp_path / "good.npz").write_bytes(data)
    with zipfile.ZipFile(tmp_path / "good.npz") as file:
        first = file.infolist()[0]
    begin = first.header_offset + 30 + len(first.filename)
    for place in range(begin, begin + 60):
        damaged = data.copy()
        damaged[place] ^= 0xFF
        assert readers.fault(readers.TARGETS["npz"], bytes(damaged), tmp_path) is None


@pytest.mark.parametrize("kind, content", [(b"\x91\xed\0\0", b""), (b"pHYs", b"\0\0"), (b"tEXt", b""), (b"IHDR", b"")])
def test_odd_chunks_of_a_png(readers, tmp_path, kind, content):
    data = readers.TARGETS["png"].seeds()[0]
    chunk = struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
    begin = data.index(b"IDAT") - 4
    assert readers.fault(readers.TARGETS["png"], data[:begin] + chunk + data[begin:], tmp_path) is None


@pytest.mark.parametrize("name", ["tables-hdf5", "hdf5"])
@pytest.mark.parametrize("mark", [b"SNOD", b"TREE", b"HEAP"])
def test_odd_marks_in_hdf5(readers, tmp_path, name, mark):
    (data,) = readers.TARGETS[name].seeds()
    place = data.index(mark)
    for begin, end in ((0, 4), (4, 8), (8, 16)):
        damaged = data[: place + begin] + b"\xff" * (end - begin) + data[place + end :]
        assert readers.fault(readers.TARGETS[name], damaged, tmp_path) is None


def test_a_rate_below_any_float(tmp_path):
    """As a long double it is above 0, as a float it is not."""
    rate = np.nextafter(np.longdouble(0), np.longdouble(1))
    if float(rate) > 0:
        pytest.skip("long double is double here")
    path = tmp_path / "a.h5"
    with RecordingsWriter(path, source="a test", licence="CC0-1.0") as writer:
        writer.add_recording("s", "e", "0", lateral=np.ones(5000), lateral_rate=2500)
    with h5py.File(path, "r+") as file:
        file["recordings/s/e/0/lateral"].attrs["rate"] = rate
    with pytest.raises(ValueError, match="a.h5.*rate"):
        RecordingsFile(path)


def test_names_in_hdf5_that_are_no_text(tmp_path):
    """A name in Latin-1 has no other place to go than an escape."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file[b"kraft \xe9"] = np.arange(5.0)
        file["time"] = np.arange(5.0)
    (table,) = list_tables(tmp_path / "a.h5")
    assert sorted(table.names) == ["kraft \\xe9", "time"]
    assert table.numbers("kraft \\xe9").tolist() == [0, 1, 2, 3, 4]
