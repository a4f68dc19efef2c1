"""Other people's folders: columns to channels, tables to ratings, and what the draft asks for."""

import json
import re
import tomllib

import h5py
import numpy as np
import pandas as pd
import pytest
import soundfile
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_diffusers.data import RecordingsFile
from tactile_diffusers.data.folder import draft_layout, draft_tables, inspect_folder, load_layout
from tactile_diffusers.data.folder.convert import convert_folder

SECONDS = 2
UNITS, SIGN = "N, mN, gf, 1 for counts", "1 if pressing is positive in z, else -1"
AXES = {"rough-smooth": "rough", "flat-bumpy": "bumpy", "sticky-slippery": "slippery"}
#: Step of time stamps, the unit that it can only have, and the rate.
RATES = [(1e-4, "s", 10_000), (0.1, "ms", 10_000), (2, "ms", 500), (100, "us", 10_000), (0.01, "s", 100)]
#: Answers to TODOs by key, where they do not differ between the tests.
ANSWERS = {
    **{"source": "a test", "licence": "CC0-1.0"},
    **{"roughness": "rough", "bumpiness": "flat", "slipperiness": "sticky"},
}


def force(rate=1000, normal=-0.5, seed=0):
    values = np.random.default_rng(seed).normal(0, 0.02, (SECONDS * rate, 3)) + [0.3, 0.0, normal]
    return np.round(values, 6)


def force_columns(names=("fx", "fy", "fz")):
    return dict(zip(names, force().T, strict=True))


def position(rate=500):
    time = np.arange(SECONDS * rate) / rate
    return np.round(np.stack([40 * np.sin(2 * time), 5 * np.cos(2 * time)], axis=-1), 5)


def table(path, columns, **options):
    path.parent.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(columns).to_csv(path, index=False, **options)


def answers(seed=0, low=0, high=8, count=60):
    """Whole numbers that reach both ends."""
    values = np.random.default_rng(seed).integers(low, high + 1, count)
    values[:2] = low, high
    return values


def drafted(root):
    """The draft of a folder, parsed."""
    return tomllib.loads(draft_layout(inspect_folder(root, quiet=True)))


def filled(root, path, **more):
    """Writes the draft with every TODO answered by the key of its line; returns its path."""
    known, lines = ANSWERS | more, draft_layout(inspect_folder(root, quiet=True)).splitlines()
    answers = [json.dumps(known.get(line.partition(" = ")[0])) for line in lines]
    pairs = zip(answers, lines, strict=True)
    path.write_text("\n".join(re.sub(r'"TODO[^"]*"', answer, line) for answer, line in pairs))
    return path


@pytest.mark.parametrize(
    "name, stamps, unit, rate",
    [
        *[("t", np.arange(2000) * step, unit, rate) for step, unit, rate in RATES],
        ("t_ms", np.arange(2000) // 10, None, 10_000),  # coarser than the samples
        ("t", np.arange(2000) * 0.02, "TODO: s, ms or us", None),  # 50 Hz or 50 kHz
    ],
)
def test_time_stamps(tmp_path, name, stamps, unit, rate):
    table(tmp_path / "felt_force.csv", {name: stamps} | force_columns())
    inventory = inspect_folder(tmp_path, quiet=True)
    (group,), (entry, _) = inventory.groups, tomllib.loads(draft_layout(inventory))["files"]
    assert group.rate[0] == (rate and pytest.approx(rate, rel=1e-9))
    assert ("rate" in entry) is (unit is None) and (unit is None or entry["time"] == {"column": name, "unit": unit})
    assert any(f"time taken as {unit}" in doubt for doubt in group.doubts) is (unit in ("s", "ms", "us"))


DOUBTS = [  # the first: z has no clear sign
    ("Fx [N]|Fz [N]|Fy [N]", "no position or velocity", "force", {"normal_sign": f"TODO: {SIGN}"}),
    ("fx_N|fy_N|fz_mN", "no position or velocity", "force", {"unit": f"TODO: {UNITS}; the name says N and mN"}),
    ("F_T|y|F_N", "only one column is used, not F_N", "lateral", {"column": "F_T", "unit": f"TODO: {UNITS}"}),
]


@pytest.mark.parametrize("columns, doubt, channel, expected", DOUBTS)
def test_doubts_on_forces(tmp_path, columns, doubt, channel, expected):
    table(tmp_path / "felt.csv", force_columns(columns.split("|")))
    assert doubt in draft_layout(inspect_folder(tmp_path, quiet=True))
    assert expected.items() <= drafted(tmp_path)["files"][0][channel].items()


@pytest.fixture
def foreign(tmp_path):
    """Forces in N with time in ms, positions in mm with time in s, ratings whose first axis is smooth-high."""
    root = tmp_path / "study"
    for surface in range(1, 5):
        for person in (1, 2):
            place, (x, y, z) = root / f"sliding/texture_{surface:02d}", force(seed=surface).T
            columns = {"time_ms": np.arange(2000.0), "Fx [N]": x, "Fy [N]": y, "Fz [N]": z, "Tz [Nmm]": x}
            table(place / f"P{person}_force.csv", columns)
            x, y = position().T
            table(place / f"P{person}_position.csv", {"t": np.arange(1000) / 500, "x (mm)": x, "y (mm)": y})
    pairs = pd.MultiIndex.from_product([[f"S{i}" for i in range(12)], range(1, 5)], names=["participant", "texture"])
    ratings = pairs.to_frame(index=False)
    for seed, axis in enumerate([*AXES, "hot-cold"]):
        ratings[axis] = answers(seed, count=len(ratings))
    ratings = ratings.astype({axis: object for axis in AXES})
    ratings.loc[5, "flat-bumpy"] = "x"
    table(root / "ratings.csv", ratings)
    return root


def test_listing(foreign):
    text = draft_layout(inspect_folder(foreign, quiet=True))
    for line in (
        r"# Drafted from study: check every line",
        r"# files: 8; 2000 rows of 3 looked at",
        r"# surface: texture_01, texture_02, texture_03, .. \(4 values\)",
        r"# - Fx \[N\]: 0.\d+ to 0.\d+, force x",
        r"# - Fz \[N\]: -0.\d+ to -0.\d+, force z",
        r"# - Tz \[Nmm\]: .*, torque z",
        r"# - x \(mm\): -?\d.* to 40, position x",
        r"# - participant: text, 12 different",
        r"# check: axes that are not used: hot-cold",
        r'^"?1"? = "texture_01"',
    ):
        assert re.search(line, text, re.M), line


def test_draft(foreign):
    text = draft_layout(inspect_folder(foreign, quiet=True))
    draft = tomllib.loads(text)
    forces, positions = draft["files"]
    assert forces == {
        "pattern": "sliding/{surface}/P{explorer}_force.csv",
        "time": {"column": "time_ms", "unit": "ms"},
        "force": {"x": "Fx [N]", "y": "Fy [N]", "z": "Fz [N]", "unit": "N", "normal_sign": -1},
    }
    assert positions["position"] == {"x": "x (mm)", "y": "y (mm)", "unit": "mm"}
    assert positions["time"] == {"column": "t", "unit": "s"}
    ratings = draft["ratings"]
    assert (ratings["form"], ratings["rater"], ratings["surface"]) == ("long", "participant", "texture")
    assert ratings["scale"] == [0, 8] and ratings["missing"] == ["", "x"]
    assert list(ratings["axes"]) == ["roughness", "bumpiness", "slipperiness"]
    assert [value["column"] for value in ratings["axes"].values()] == list(AXES)
    assert draft["surface_names"] == {str(i): f"texture_{i:02d}" for i in range(1, 5)}
    assert re.search(r"# z is -0.50?\d* on average.*: pressing is negative\n", text)

    (foreign / "l.toml").write_text(text)
    with pytest.raises(ValueError) as raised:
        load_layout(foreign / "l.toml")
    keys = ["source", "licence", *(f"ratings.axes.{axis}.high" for axis in ratings["axes"])]
    assert re.findall("`(.*?)` = 'TODO.*? is still to be filled in", str(raised.value)) == keys


def test_drafted_and_converted(foreign, tmp_path):
    layout = filled(foreign, tmp_path / "l.toml", bumpiness="bumpy", slipperiness="slippery", roughness="smooth")
    convert_folder(foreign, layout, tmp_path / "r.h5", quiet=True)
    with RecordingsFile(tmp_path / "r.h5") as file:
        assert len(file) == 8 and file.attributes["source"] == "a test"
        recording, ratings = file.read("texture_03/2/0"), file.ratings
    np.testing.assert_array_equal(recording.force, np.float32(force(seed=3) * [1, 1, -1]))
    time = np.arange(20, SECONDS * 500 - 20) / 500  # without the ends, where the filter extrapolates
    slope = np.stack([80 * np.cos(2 * time), -10 * np.sin(2 * time)], axis=-1)
    np.testing.assert_allclose(recording.velocity[20:-20], slope, atol=0.05)
    table = pd.read_csv(foreign / "ratings.csv")
    first = table[table.participant == "S0"]
    np.testing.assert_array_equal(ratings.values[0, :, 0], 8 - first["rough-smooth"])
    np.testing.assert_array_equal(ratings.values[0, :, 2], first["sticky-slippery"])
    assert np.isnan(ratings.values[1, 1, 1]) and np.isnan(ratings.values).sum() == 1


def test_a_german_folder_end_to_end(tmp_path):
    """Decimal commas below a preamble, mN and ms, two encodings, a row an answer in Excel, other names of surfaces."""
    root, surfaces = tmp_path / "study", ["Cork sheet", "Denim", "P80 sandpaper"]
    for number, (surface, run) in enumerate((surface, run) for surface in surfaces for run in (1, 2)):
        place = root / "Messwerte" / "S1" / surface
        x, y, z = 1000 * force(seed=number).T
        table(place / f"run{run}_ati.csv", {"t_ms": np.arange(2000.0), "Fx [mN]": x, "Fy [mN]": y, "Fz [mN]": z})
        columns = pd.read_csv(place / f"run{run}_ati.csv").to_csv(sep=";", decimal=",", index=False)
        encoding = "utf-16" if surface == "Denim" else "latin-1"
        (place / f"run{run}_ati.csv").write_text(f"Prüfstand 3; Kraft\n{columns}", encoding=encoding)
        x, y = position().T
        table(place / f"run{run}_stage.txt", {"t [s]": np.arange(1000) / 500, "x (mm)": x, "y (mm)": y}, sep="\t")
    pairs = [
        (f"VP{i}", name, axis) for i in range(9) for name in ("denim", "P80", "cork_sheet") for axis in (*AXES, "wet")
    ]
    rated = pd.DataFrame(pairs, columns=["rater", "material", "attribute"]).assign(answer=answers(0, 1, 7, len(pairs)))
    rated.to_excel(root / "Bewertungen.xlsx", index=False)
    layout = filled(root, tmp_path / "l.toml")
    report = convert_folder(root, layout, tmp_path / "r.h5", quiet=True)
    assert report.recordings == 6 and not report.left_out and not report.notes
    with RecordingsFile(tmp_path / "r.h5") as file:
        assert file.names[:2] == ["Cork sheet/S1/1", "Cork sheet/S1/2"] and len(file.ratings.raters) == 9
        np.testing.assert_allclose(file.read("Denim/S1/1").force, force(seed=2) * [1, 1, -1], rtol=1e-6)
        asked = rated[(rated.attribute == "rough-smooth") & (rated.material == "P80")].answer
        place = file.ratings.surfaces.index("P80 sandpaper"), file.ratings.axes.index("roughness")
        np.testing.assert_allclose(file.ratings.values[:, *place], (asked - 1) * 8 / 6, rtol=1e-6)


def test_one_hdf5_file_for_all(tmp_path):
    with h5py.File(tmp_path / "all.h5", "w") as file:
        for surface in range(4):
            for person in (1, 2):
                group = file.create_group(f"glass{surface}/P{person}")
                group["force"], group["pos"] = force().T, position(500)
                group["force"].attrs["rate"], group["pos"].attrs["rate"] = 1000, 500
    layout = filled(tmp_path, tmp_path / "l.toml", force="N", position="mm")
    entries = load_layout(layout).files
    assert [entry.inside.text for entry in entries] == ["{surface}/{explorer}/force", "{surface}/{explorer}/pos"]
    convert_folder(tmp_path, layout, tmp_path / "r.h5", quiet=True)
    with RecordingsFile(tmp_path / "r.h5") as file:
        assert file.names[0] == "glass0/P1/0" and len(file) == 8
        np.testing.assert_array_equal(file.read("glass3/P2/0").force, np.float32(force() * [1, 1, -1]))


def test_sound_files_hold_lateral_force(tmp_path):
    for name in ("felt_1", "felt_2", "wood_grain_1", "wood_grain_2"):
        soundfile.write(tmp_path / f"{name}.wav", 0.5 * np.sin(np.arange(4000) / 9), 2000)
    inventory = inspect_folder(tmp_path, quiet=True)
    (entry,) = tomllib.loads(draft_layout(inventory))["files"]
    assert entry["pattern"] == "{surface}_{trial}.wav" and entry["rate"] == 2000
    assert entry["lateral"]["column"] == 0 and entry["lateral"]["scale"].startswith("TODO: N at full scale")
    assert "the pattern reads the surface of wood_grain_1.wav as 'wood'" in draft_layout(inventory)


def test_kinds_of_files_that_only_their_columns_tell_apart(tmp_path):
    """Words of another language, and a workbook that begins with a sheet of remarks."""
    for surface in ("Glas", "Kork", "Jeans", "Filz"):
        for person in ("Anna", "Bernd"):
            table(tmp_path / f"Kraft_{surface}_{person}_1.csv", force_columns(("Fx [mN]", "Fy [mN]", "Fz [mN]")))
            path = dict(zip(("X [mm]", "Y [mm]"), position().T, strict=True))
            table(tmp_path / f"Weg_{surface}_{person}_1.csv", {"t [s]": np.arange(1000) / 500, **path})
    with pd.ExcelWriter(tmp_path / "Antworten.xlsx") as book:
        pd.DataFrame(["Studie"]).to_excel(book, sheet_name="Info", index=False, header=False)
        rated = pd.DataFrame({"Proband": ["a", "b"], "sample": ["Glas", "Kork"], "smooth": [0, 8]})
        rated.to_excel(book, sheet_name="Daten", index=False, startrow=2)
    draft = drafted(tmp_path)
    force_files, motion_files = draft["files"]
    assert force_files["pattern"].startswith("Kraft_{surface}") and set(force_files["force"]) >= {"x", "y", "z"}
    assert motion_files["pattern"].startswith("Weg_{surface}")
    assert motion_files["position"] == {"x": "X [mm]", "y": "Y [mm]", "unit": "mm"}
    assert (draft["ratings"]["sheet"], draft["ratings"]["header"]) == ("Daten", 3)


def test_numbers_without_names(tmp_path):
    # A table without a header: the first column rises steadily, the name of the file says what the others are.
    for surface in ("felt", "cork"):
        values = np.column_stack([np.arange(2000) / 1000, force()])
        np.savetxt(tmp_path / f"{surface}_ft.txt", values, fmt="%.6g")
    (entry, _) = drafted(tmp_path)["files"]
    assert entry["time"] == {"column": 0, "unit": "s"}
    assert entry["force"] == {"x": 1, "y": 2, "z": 3, "unit": f"TODO: {UNITS}", "normal_sign": -1}


def test_measured_velocity_is_preferred(foreign):
    for path in foreign.glob("sliding/*/*_position.csv"):
        columns = {"t": np.arange(1000) / 500, "vx [mm/s]": 80.0}
        table(path.with_name(path.name.replace("position", "velocity")), columns)
    entries = drafted(foreign)["files"]
    assert [set(entry) & {"force", "position", "velocity"} for entry in entries] == [{"force"}, {"velocity"}]


@pytest.mark.parametrize(
    "files, columns, pattern, keys",
    [
        (
            [f"participant_{rater}" for rater in range(5)],
            {"sample": ["felt", "cork", "glass"], "smooth_rough": [1, 7, 0], "slippery": [2, 7, 1]},
            "participant_{rater}",
            {"surface": "sample", "scale": [0, "TODO: the ends of the scale; answers from 0 to 7"]},
        ),
        (["felt", "cork"], {"rater": ["a", "b"], "bumpy": [1, 7]}, "{surface}", {"rater": "rater", "scale": [1, 7]}),
        (
            ["felt", "cork"],
            {"x": ["a", "b"], "bumpy": [1, 7]},
            "{surface}",
            {"rater": "TODO: the column that names the rater; there are x", "scale": [1, 7]},
        ),
    ],
)
def test_a_file_a_rater_or_a_surface(tmp_path, files, columns, pattern, keys):
    for name in files:
        table(tmp_path / f"ratings/{name}.csv", columns)
    ratings = drafted(tmp_path)["ratings"]
    del ratings["axes"]
    assert ratings == {"pattern": f"ratings/{pattern}.csv", "form": "long"} | keys


def test_forces_and_ratings_are_not_confused(tmp_path):
    for surface in ("rough", "smooth"):  # surfaces called like axes
        table(tmp_path / f"a/{surface}_force.csv", {"Fx": [1, 2, 3], "Fy": [1, 1, 2], "Fz": [5, 6, 7]})
    columns = {"id": range(60), "texture": range(60), "roughness": answers(), "friction": answers(1)}
    table(tmp_path / "b/answers.csv", columns)
    forces, ratings = (inspect_folder(tmp_path / name, quiet=True) for name in "ab")
    assert forces.ratings is None and forces.surfaces == ["rough", "smooth"]
    assert ratings.ratings is not None and not ratings.recorded


@pytest.mark.parametrize("turned", [False, True])
def test_a_sheet_an_axis(tmp_path, turned):
    with pd.ExcelWriter(tmp_path / "answers.xlsx") as book:
        for seed, axis in enumerate(("roughness", "bumpiness", "slipperiness", "warm")):
            values = answers(seed, 1, 7, 20).reshape(4, 5)
            frame = pd.DataFrame(values, ["felt", "cork", "glass", "wood"], [f"P{i}" for i in range(5)])
            (frame.T if turned else frame).to_excel(book, sheet_name=axis)
    for surface in ("felt", "cork", "glass", "wood"):  # force and velocity in one file
        table(tmp_path / f"{surface}.csv", force_columns() | {"vx": 80.0, "vy": 0.0})
    ratings = drafted(tmp_path)["ratings"]
    left_out = "check: axes that are not used: warm; [ratings.axes.NAME] takes one more"
    assert left_out in draft_layout(inspect_folder(tmp_path, quiet=True))
    assert ratings["pattern"] == "answers.xlsx" and ratings["sheet"] == "{axis}" and ratings["form"] == "wide"
    assert (ratings["rows"], ratings["columns"]) == (("rater", "surface") if turned else ("surface", "rater"))
    assert ratings["scale"] == [1, 7]
    layout = filled(tmp_path, tmp_path / "l.toml", force="N", velocity="mm/s", rate=1000)
    assert load_layout(layout).ratings.is_turned("slipperiness")
    convert_folder(tmp_path, layout, tmp_path / "r.h5", quiet=True)
    with RecordingsFile(tmp_path / "r.h5") as file:
        assert file.surfaces == file.ratings.surfaces == ("cork", "felt", "glass", "wood")
        rough = answers(0, 1, 7, 20).reshape(4, 5)[1]  # of cork
        np.testing.assert_allclose(file.ratings.values[:, 0, 0], (rough - 1) / 6 * 8, rtol=1e-6)


def test_what_is_not_looked_at_is_listed(foreign):
    contents = {".DS_Store": b"x", "empty.csv": b"", "broken.h5": b"nonsense", "README.md": b"x", "photo.png": b"x"}
    for name, content in (contents | {"pickled.npy": b"\x93NUMPY\x01\x00nonsense"}).items():
        (foreign / name).write_bytes(content)
    (foreign / "gone.csv").symlink_to(foreign / "nowhere.csv")
    with h5py.File(foreign / "recordings.h5", "w") as file:
        file.attrs["format"] = "tactile-recordings"
    inventory = inspect_folder(foreign, quiet=True)
    text, reasons = draft_layout(inventory), inventory.skipped
    for path, reason in {
        "empty.csv": "empty",
        "gone.csv": "may not be read, or is a broken link",
        "broken.h5": "truncated or no",
        "pickled.npy": "cannot be read as npy",
        "recordings.h5": "already converted",
    }.items():
        assert reason in reasons.pop(path) and f"not looked at: {path}: " in text
    assert not reasons and "no tables: 1 .md, 1 .png" in text
    assert len(tomllib.loads(draft_layout(inventory))["files"]) == 2


_NAMES = "ratings answers force texture_1 texture_2 P1 P2 felt 0_1 rough-smooth subject x{1} a\nb session_3 é data"
_COLUMNS = "t|Fx [N]|fy|fz|x|y|vx mm/s|rater|texture|rough-smooth|bumpy|attribute|0|"
_VALUES = [[1, 2, 3], [0.5, 0.25, 1], ["rough-smooth", "flat-bumpy", "x"], ["felt", "", "2"], [5, 5, 5]]
_name, _column = st.sampled_from(_NAMES.split(" ")), st.sampled_from(_COLUMNS.split("|"))
_table = st.tuples(st.just("csv"), st.dictionaries(_column, st.sampled_from(_VALUES), min_size=1))
_nonsense = st.tuples(st.sampled_from("csv xlsx mat h5 npy npz wav parquet".split()), st.binary(max_size=300))


@given(st.dictionaries(st.tuples(_name, _name), _table | _nonsense, min_size=1, max_size=5))
@settings(max_examples=150, deadline=None)
def test_no_folder_stops_the_inspection(tmp_path_factory, files):
    root = tmp_path_factory.mktemp("folder")
    for (folder, name), (ending, content) in files.items():
        (root / folder).mkdir(exist_ok=True)
        path = root / folder / f"{name}.{ending}"
        path.write_bytes(content) if isinstance(content, bytes) else table(path, content)
    inventory = inspect_folder(root, quiet=True)
    assert tomllib.loads(draft_layout(inventory))["files"]


def test_few_files_are_opened(tmp_path, monkeypatch):
    for name in (f"texture_{surface}/P1_{kind}.csv" for surface in range(40) for kind in ("force", "position")):
        table(tmp_path / name, {"x": [1.0, 2.0], "y": [3.0, 4.0]})
    opened, real = [], draft_tables.list_tables
    monkeypatch.setattr(draft_tables, "list_tables", lambda path, *a, **k: opened.append(path) or real(path, *a, **k))
    inspect_folder(tmp_path, quiet=True)
    assert len(opened) == len(set(opened)) == 6


def test_large_tables_are_cut_short(tmp_path, monkeypatch):
    limits = {"HEAD_ROWS": 50, "LARGEST_OPENED": 1000}
    for name, limit in limits.items():
        monkeypatch.setattr(draft_tables, name, limit)
    for kind in ("force", "position", "torque"):
        for surface in range(15):
            table(tmp_path / kind / f"{surface:02d}.csv", {"x": np.arange(100.0), "y": 0.0, "z": 1.0})
    inventory = inspect_folder(tmp_path, quiet=True)
    assert [len(group.files.names) for group in inventory.groups] == [15, 15, 15]
    facts = inventory.groups[0].first
    assert facts.table.rows == 50 and not facts.complete
    (tmp_path / "npz").mkdir()
    np.savez(tmp_path / "npz" / "felt.npz", force=force())
    assert "read as a whole: not opened" in inspect_folder(tmp_path / "npz", quiet=True).skipped["felt.npz"]


@pytest.mark.parametrize("content", [{}, {"alpha": [1.5, 2.5], "beta": [3.5, 1.0]}])
def test_nothing_recognised(tmp_path, content):
    if content:
        table(tmp_path / "data.csv", content)
    inventory = inspect_folder(tmp_path, quiet=True)
    assert "check: no force was recognised" in draft_layout(inventory) and "no ratings were recognised" in draft_layout(
        inventory
    )
    (entry,) = drafted(tmp_path)["files"]
    assert entry["pattern"].startswith("TODO") and entry["force"].startswith("TODO")
    with pytest.raises(FileNotFoundError, match="There is no folder .*nowhere"):
        inspect_folder(tmp_path / "nowhere", quiet=True)


@pytest.fixture
def awkward(tmp_path):
    """Twelve surfaces in words that are not known: two axes of force, decimal commas, two clocks, answers in Excel."""
    root = tmp_path / "labor"
    names = "Glas Holz Filz Leder Jeans Kork Stein Papier Sand Samt Gummi Blech".split()
    (root / "Kraft").mkdir(parents=True), (root / "Weg").mkdir()
    for seed, name in enumerate(names):
        x, _, z = 1e3 * force(seed=seed).T
        frame = pd.DataFrame({"Zeit [s]": np.arange(len(x)) / 1000, "Fx [mN]": x, "Fz [mN]": z})
        frame.to_csv(root / "Kraft" / f"{name}_Kraft.csv", sep=";", decimal=",", index=False)
        x, y = position().T
        stamps = (12.5 + np.arange(len(x)) / 487).round(3)
        frame = pd.DataFrame({"Zeit [s]": stamps, "x [mm]": x, "y [mm]": y})
        frame.to_csv(root / "Weg" / f"{name}_pos.csv", sep=";", decimal=",", index=False)
    rows = pd.MultiIndex.from_product([[f"P{i}" for i in range(6)], names], names=["Proband", "Oberfläche"])
    rows = rows.to_frame(index=False)
    for seed, axis in enumerate(["glatt", "huckelig", "rutschig"]):
        rows[axis] = answers(seed, count=len(rows))
    rows.to_excel(root / "Bewertungen.xlsx", index=False)
    return root


def test_words_that_are_not_known(awkward):
    layout = drafted(awkward)
    forces, positions = layout["files"]
    assert (forces["pattern"], positions["pattern"]) == ("Kraft/{surface}_Kraft.csv", "Weg/{surface}_pos.csv")
    assert forces["force"] == {"x": "Fx [mN]", "z": "Fz [mN]", "unit": "mN", "normal_sign": -1}
    assert forces["time"] == positions["time"] == {"column": "Zeit [s]", "unit": "s"}
    assert "487 Hz" in draft_layout(inspect_folder(awkward, quiet=True))  # stamps of 2 and 3 ms
    ratings = layout["ratings"]
    assert ratings["surface"] == "Oberfläche" and "there are Proband" in ratings["rater"]
    assert all("one of glatt, huckelig, rutschig" in axis["column"] for axis in ratings["axes"].values())


def test_clocks_that_begin_apart_are_named(awkward, tmp_path):
    text = draft_layout(inspect_folder(awkward, quiet=True))
    for axis, column in zip(("roughness", "bumpiness", "slipperiness"), ("glatt", "huckelig", "rutschig"), strict=True):
        text = re.sub(
            rf'({axis} = {{ column = )"TODO[^"]*", high = "TODO: (\w+) [^"]*"', rf'\1"{column}", high = "\2"', text
        )
    text = re.sub(r'rater = "TODO[^"]*"', 'rater = "Proband"', text)
    (tmp_path / "layout.toml").write_text(re.sub(r'"TODO[^"]*"', '"x"', text))
    layout = load_layout(tmp_path / "layout.toml")
    with pytest.raises(ValueError, match="both began together, set `offset`"):
        convert_folder(awkward, layout, tmp_path / "recordings.h5", quiet=True)
    (tmp_path / "layout.toml").write_text(
        (tmp_path / "layout.toml").read_text().replace("position = {", "offset = -12.5\nposition = {")
    )
    report = convert_folder(awkward, load_layout(tmp_path / "layout.toml"), tmp_path / "recordings.h5", quiet=True)
    assert "12 recordings of 12 surfaces" in str(report)
