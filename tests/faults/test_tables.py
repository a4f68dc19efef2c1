"""Files of other people: every kind of table of `data/folder`, and a recording for `tactile-diffusers reconstruct`."""

import h5py
import numpy as np
import pandas as pd
import pytest
import soundfile
from scipy import io
from uploads import read_upload

from tactile_diffusers.data.folder import read_recording
from tactile_diffusers.data.folder.tables import list_tables, read_table

RATE, SAMPLES = 5000, 2500
KINDS = ("a.csv", "a.tsv", "utf16.txt", "a.xlsx", "a.npy", "a.npz", "v5.mat", "v4.mat", "v73.mat", "a.h5", "a.wav")
KINDS += ("float.wav", "a.parquet")
#: Text has no length, and v4 of MATLAB no more than its first header.
WITHOUT_LENGTH = ("a.csv", "a.tsv", "utf16.txt")


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    """Name of a file -> a good one: half a second of two columns."""
    folder, values = tmp_path_factory.mktemp("tables"), np.random.default_rng(0).standard_normal((SAMPLES, 2)) / 10
    frame = pd.DataFrame(values, columns=["fx", "fy"])
    paths = {}
    for name in KINDS:
        (folder / name).mkdir()
        paths[name] = folder / name / name
    frame.to_csv(paths["a.csv"], index=False)
    frame.to_csv(paths["a.tsv"], index=False, sep="\t")
    frame.to_csv(paths["utf16.txt"], index=False, encoding="utf-16")
    frame[:100].to_excel(paths["a.xlsx"], index=False)
    frame.to_parquet(paths["a.parquet"])
    np.save(paths["a.npy"], values)
    np.savez_compressed(paths["a.npz"], force=values, rate=RATE)
    io.savemat(paths["v5.mat"], {"force": values, "rate": RATE}, do_compression=True)
    io.savemat(paths["v4.mat"], {"force": values, "rate": RATE}, format="4")
    for name in ("v73.mat", "a.h5"):
        with h5py.File(paths[name], "w") as file:
            file.create_dataset("force", data=values, chunks=(500, 2), compression="gzip")
            file["force"].attrs["rate"] = RATE
    soundfile.write(paths["a.wav"], values, RATE)
    soundfile.write(paths["float.wav"], values, RATE, subtype="FLOAT")
    return paths


def _columns(path):
    """All columns of all tables, as numbers and as text; a place without columns is no table."""
    found = {}
    for table in list_tables(path):
        columns = {name: table.numbers(name) for name in table.names}
        found[str(table.inside)] = {"columns": columns, "rate": table.rate or 0.0}
    if not any(column.size for part in found.values() for column in part["columns"].values()):
        raise ValueError(f"{path} holds no table")  # the conversion says so: the column it looks for is not there
    return found


def _sane(found):
    """NaN stands for what is no number, and is counted; infinity never comes through."""
    columns = [column for part in found.values() for column in part["columns"].values()]
    return all(column.ndim == 1 and column.dtype == np.float64 and not np.isinf(column).any() for column in columns)


@pytest.mark.parametrize("name", KINDS)
def test_damage(name, tables, damaged, flips, foreign):
    case = damaged(tables[name], _columns, sane=_sane, whole=name not in WITHOUT_LENGTH)
    text = (".csv", ".tsv", ".txt")
    kin = text if case.path.suffix in text else (".mat", ".h5") if case.path.suffix in (".mat", ".h5") else ()
    if case.path.suffix in text:
        del foreign["json number"]  # a table of one number
    others = [path.read_bytes() for path in tables.values() if path.suffix not in (case.path.suffix, *kin)]
    case.damage(flips, [*foreign.values(), *others])


@pytest.mark.parametrize("name", ["a.csv", "a.npy", "v5.mat", "a.wav"])
def test_a_recording_to_reconstruct(tables, damaged, foreign, flips, name):
    def read(path):
        return read_recording(path, column=0, rate=RATE)

    damaged(tables[name], lambda path: read(path)[0], whole=name not in WITHOUT_LENGTH).damage(flips, foreign.values())


@pytest.mark.parametrize("name", ["a.csv", "float.wav", "a.wav"])
def test_an_upload(tables, name, foreign, damaged, flips):
    """Visitors see no path: the message begins with what the file is, and the harness adds its name."""

    def read(path):
        try:
            return read_upload(path, rate=RATE)[0]
        except ValueError as error:
            raise (ValueError(f"{path}: {error}") if type(error) is ValueError else error) from error

    good = tables[name]
    if name == "a.csv":  # the first of two columns would be time
        good = good.with_name("one.csv")
        good.write_text("\n".join(good.with_name("a.csv").read_text().replace(",", "\n").split("\n")[2:]))
    case = damaged(good, read, whole=name != "a.csv")
    case.truncate()
    case.flip(flips)
    for content in foreign.values():
        case.refuse(content)


@pytest.mark.parametrize(
    ("length", "whole"),
    [(0xFFFFFFFF, 0xFFFFFFFF), (0x80000000, 0x80000024), (0x7FFFF000, 0x7FFFF024), (0x7FFFFFFF, 0x80000023)],
)
def test_a_wav_file_from_a_pipe_is_read(tmp_path, length, whole):
    """ffmpeg, arecord and sox cannot come back to say how long it became; a true length that is too large is a cut."""
    path, values = tmp_path / "a.wav", np.random.default_rng(0).uniform(-0.9, 0.9, 2 * RATE)
    soundfile.write(path, values, RATE, subtype="PCM_16")
    good = path.read_bytes()

    def with_lengths(length, whole, samples=good[44:]):
        path.write_bytes(good[:4] + whole.to_bytes(4, "little") + good[8:40] + length.to_bytes(4, "little") + samples)
        return path

    table = read_table(with_lengths(length, whole))
    np.testing.assert_allclose(table.numbers("0"), values, atol=1e-4)
    assert len(read_upload(path)[0]) == len(values)
    for cut in ((length, len(good) - 8), (len(good) - 44, whole, good[44:-100]), (length, whole, b"")):
        with pytest.raises(ValueError, match="a.wav cannot be read as wav .*cut off"):
            read_table(with_lengths(*cut))
        with pytest.raises(ValueError, match="cut off"):
            read_upload(path)


def test_pickled_objects_are_refused(tmp_path):
    table = np.array([{"a": 1}], dtype=object)
    np.save(tmp_path / "a.npy", table, allow_pickle=True)
    np.savez(tmp_path / "a.npz", a=table)
    for name in ("a.npy", "a.npz"):
        with pytest.raises(ValueError, match=f"{name}.*[Oo]bject"):
            read_table(tmp_path / name)


def test_links_that_lead_back_end(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["g/force"] = np.ones((10, 2))
        file["g/again"], file["g/top"] = file["g"], file["/"]
    assert [table.inside for table in list_tables(tmp_path / "a.h5")] == ["g/force"]


def test_what_is_too_wide_is_no_table(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("force", (2**30, 2**30), "f4", chunks=(1024, 1024))  # nothing of it is written
    assert list_tables(tmp_path / "a.h5") == []


def test_a_deep_tree_is_read(tmp_path):
    np.savez(tmp_path / "a.npz", **{"/".join("a" * 5000): np.ones(10)})
    (table,) = list_tables(tmp_path / "a.npz")
    assert table.names == ["a"] and table.rows == 10
