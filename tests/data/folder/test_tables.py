"""Tables of every kind of file: the same numbers come out, names are found, what cannot be read is named."""

import h5py
import numpy as np
import pandas as pd
import pytest
import soundfile
from scipy import io

from tactile_diffusers.data.folder.tables import list_tables, paths_inside, read_table

VALUES = np.random.default_rng(0).standard_normal((120, 3)).astype(np.float32)
NAMES = ["Fx", "Fy", "Fz"]


def frame():
    return pd.DataFrame(VALUES, columns=NAMES)


def write_mat73(path):
    with h5py.File(path, "w") as file:  # MATLAB writes HDF5 with transposed arrays
        file["run/force"] = VALUES.T
        file["run/t"] = np.arange(120.0)[None]


def write_hdf5(path):
    with h5py.File(path, "w") as file:
        file["wood/P1/force"] = VALUES
        file["wood/P1/force"].attrs["rate"] = 1000
        file["wood/P1/velocity"] = VALUES[:50, :2]


WRITERS = {
    "a.csv": lambda path: frame().to_csv(path, index=False),
    "a.xlsx": lambda path: frame().to_excel(path, index=False),
    "a.parquet": lambda path: frame().to_parquet(path),
    "a.npy": lambda path: np.save(path, VALUES.T),
    "b.npy": lambda path: np.save(path, frame().to_records(index=False)),
    "a.npz": lambda path: np.savez(path, **{"run/force": VALUES}),
    "a.mat": lambda path: io.savemat(path, {"run": {"force": VALUES, "fs": 1000.0}}),
    "b.mat": write_mat73,
    "a.h5": write_hdf5,
    "a.wav": lambda path: soundfile.write(path, VALUES / 10, 1000, subtype="FLOAT"),
}
INSIDE = {"a.npz": "run/force", "a.mat": "run/force", "b.mat": "run/force", "a.h5": "wood/P1/force"}


@pytest.mark.parametrize("name", WRITERS)
def test_every_kind_gives_back_float32(tmp_path, name):
    if name.endswith("parquet"):
        pytest.importorskip("pyarrow")
    WRITERS[name](tmp_path / name)
    table = read_table(tmp_path / name, inside=INSIDE.get(name))
    named = name in ("a.csv", "a.xlsx", "a.parquet", "b.npy")
    assert table.names == (NAMES if named else ["0", "1", "2"]) and table.rows == 120
    expected = VALUES / np.float32(10) if name == "a.wav" else VALUES
    for column in range(3):
        values = table.numbers(column)
        assert values.dtype == np.float64
        np.testing.assert_array_equal(values.astype(np.float32), expected[:, column])
    assert table.rate == (1000 if name in ("a.wav", "a.h5", "a.mat") else None)


def test_trees_list_groups_of_vectors_and_arrays(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["wood/Fx"], file["wood/note"] = VALUES[:, 0], ["p", "q"]
        file["wood/px"] = VALUES[:30, 1]  # another length: another rate
        file["wood"].attrs["sampling_rate"] = 500.0
        file["metal/force"] = VALUES
        file["scalar"] = 3.0
    tables = list_tables(tmp_path / "a.h5")
    assert {table.inside: table.names for table in tables} == {
        "wood": ["Fx", "note", "px"],
        "metal/force": ["0", "1", "2"],
    }
    wood = next(table for table in tables if table.inside == "wood")
    assert wood.rate == 500 and wood.rows == 120 and len(wood.numbers("px")) == 30 and wood.text("note") == ["p", "q"]
    assert read_table(tmp_path / "a.h5", inside="metal").names == ["force/0", "force/1", "force/2"]
    assert "metal/force" in paths_inside(tmp_path / "a.h5")


def test_mat_structs_and_cells(tmp_path):
    cells = np.array([{"t": np.arange(5.0)}, {"t": np.arange(7.0)}], dtype=object)
    io.savemat(tmp_path / "a.mat", {"trials": cells, "names": np.array(["wood", "metal"], dtype=object)})
    assert {table.inside for table in list_tables(tmp_path / "a.mat")} == {None, "trials/0", "trials/1"}
    assert read_table(tmp_path / "a.mat").text("names") == ["wood", "metal"]
    assert len(read_table(tmp_path / "a.mat", inside="trials/1").numbers("t")) == 7


def test_sheets(tmp_path):
    with pd.ExcelWriter(tmp_path / "a.xlsx") as book:
        frame().to_excel(book, sheet_name="one", index=False)
        pd.DataFrame({"a": ["01", None, 1, 1.5]}).to_excel(book, sheet_name="two", index=False)
    assert (
        [table.inside for table in list_tables(tmp_path / "a.xlsx")]
        == ["one", "two"]
        == paths_inside(tmp_path / "a.xlsx")
    )
    assert read_table(tmp_path / "a.xlsx", inside="two").text("a") == ["01", "", "1", "1.5"]
    assert read_table(tmp_path / "a.xlsx", max_rows=5).rows == 5
    with pytest.raises(ValueError, match="no sheet 'three', only 'one', 'two'"):
        read_table(tmp_path / "a.xlsx", inside="three")


TEXTS = {
    "names": ("t,Fx\n0,1.5\n1,2.5\n2,3.5\n", ["t", "Fx"], 2),
    "no names": ("0,1.5\n1,2.5\n2,3.5\n", ["0", "1"], 1),
    "semicolons, decimal commas": ("t;Fx\n0;1,5\n1;2,5\n2;3,5\n", ["t", "Fx"], 2),
    "spaces": ("  0   1.5\n  1   2.5\n  2   3.5\n", ["0", "1"], 1),
    "spaces, decimal commas": ("0 1,5\n1 2,5\n2 3,5\n", ["0", "1"], 1),
    "tabs, units": ("Rig 3\nt\tFx\ns\ts\n0\t1.5\n1\t2.5\n2\t3.5\n", ["t", "Fx"], 4),
    "blank lines": ("t,Fx\n\n0,1.5\n1,2.5\n\n2,3.5\n\n\n\n\n\n\n\n\n", ["t", "Fx"], 3),
    "savetxt": ("# t Fx\n0 1.5\n1 2.5\n2 3.5\n", ["t", "Fx"], 2),
    "preamble of as many cells": ("rate,10000\nt,Fx\n0,1.5\n1,2.5\n2,3.5\n3,4.5\n4,5.5\n", ["t", "Fx"], 3),
    "BOM, quotes": ('\ufeff"t","Fx"\r\n"0","1.5"\r\n"1","2.5"\r\n"2","3.5"\r\n', ["t", "Fx"], 2),
}


@pytest.mark.parametrize("text, names, first_line", TEXTS.values(), ids=TEXTS)
def test_how_a_text_is_written_is_found_out(tmp_path, text, names, first_line):
    (tmp_path / "a.txt").write_bytes(text.encode())
    table = read_table(tmp_path / "a.txt")
    assert (table.names, table.first_line) == (names, first_line)
    np.testing.assert_array_equal(table.numbers(1)[:3], [1.5, 2.5, 3.5])
    assert table.place(1) == f"line {first_line + 1}"


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1", "utf-8"])
def test_encodings(tmp_path, encoding):
    (tmp_path / "a.csv").write_bytes("Fläche,µ\nHölzer,0.5\nStoff,0.4\n".encode(encoding))
    table = read_table(tmp_path / "a.csv")
    assert table.names == ["Fläche", "µ"] and table.text(0) == ["Hölzer", "Stoff"]


def test_text_stays_as_written_and_odd_cells_are_counted(tmp_path):
    (tmp_path / "a.csv").write_text("surface,F\n01,1\n1,err\n 2 ,\n3,inf\n")
    table = read_table(tmp_path / "a.csv")
    assert table.text("surface") == ["01", "1", "2", "3"] and table.text("F") == ["1", "err", "", "inf"]
    np.testing.assert_array_equal(table.numbers("F"), [1, np.nan, np.nan, np.nan])
    assert table.unreadable["F"] == 2


def test_decimal_commas_behind_many_whole_numbers_and_empty_files(tmp_path):
    (tmp_path / "a.csv").write_text("Fx;Fy\n" + "0;1\n" * 100 + "0,25;1\n")
    assert read_table(tmp_path / "a.csv").numbers("Fx")[-1] == 0.25
    (tmp_path / "a.csv").write_text("")
    assert read_table(tmp_path / "a.csv").names == []
    (tmp_path / "a.csv").write_text("t,Fx\n")
    table = read_table(tmp_path / "a.csv")
    assert table.names == ["t", "Fx"] and table.rows == 0 and table.numbers("t").shape == (0,)


@pytest.mark.parametrize(
    "name, text, column, message",
    [
        ("a.csv", "t,Fx,word\n0,1,a\n1,2,b\n", "fx", "no column 'fx'; it has 't', 'Fx', 'word'. Did you mean 'Fx'"),
        ("a.csv", "t,Fx,word\n0,1,a\n1,2,b\n", 3, "no column 3"),
        ("a.csv", "t,Fx,word\n0,1,a\n1,2,b\n", "word", "'word' holds no number but, for example, 'a'"),
        ("b.csv", "t,Fx\n0,1\n1,2\n2,3\n3,4\n4,5\n5,6,7\n", 0, "b.csv cannot be read as csv .*line 7"),
        ("c.csv", "t,Fx\n5,6,7\n0,1\n1,2\n2,3\n3,4\n4,5\n", 0, "c.csv, line 2: has more than the 2 columns"),
        ("a.bin", "", 0, "kind is unknown"),
        ("d.csv", None, 0, "no file .*d.csv"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, name, text, column, message):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        read_table(tmp_path / name).numbers(column)
