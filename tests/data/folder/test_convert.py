"""A folder and its layout become recordings.h5: the same numbers from every kind of file, faults named and counted."""

import h5py
import numpy as np
import pandas as pd
import pytest
import soundfile

from tactile_diffusers.data import RecordingsFile
from tactile_diffusers.data.folder import convert_folder
from tactile_diffusers.data.projection import channels

RATE, MOTION_RATE = 1000, 250
HEAD = 'format = "tactile-layout"\nversion = 1\nsource = "a rig"\nlicence = "CC0-1.0"\n'
FORCE = 'force = { x = "fx", y = "fy", z = "fz", unit = "N" }'
VELOCITY = 'velocity = { x = "vx", y = "vy", unit = "mm/s" }'


def explore(seconds=3.0, seed=0):
    """Strokes to and fro with 0.5 N: tables of force and velocity, float32, and the positions."""
    rng = np.random.default_rng(seed)
    time, slow = np.arange(int(seconds * RATE)) / RATE, np.arange(int(seconds * MOTION_RATE)) / MOTION_RATE
    lateral = 0.3 * np.sign(np.sin(2 * np.pi * time)) + 0.01 * rng.standard_normal(len(time))
    normal = 0.5 + 0.01 * rng.standard_normal(len(time))
    force = np.float32(np.stack([0.8 * lateral, 0.6 * lateral, normal], axis=-1))
    speed = 80 * np.sin(2 * np.pi * slow)
    position = 80 / (2 * np.pi) * np.stack([-0.8 * np.cos(2 * np.pi * slow), -0.6 * np.cos(2 * np.pi * slow)], axis=-1)
    return force, np.float32(np.stack([0.8 * speed, 0.6 * speed], axis=-1)), position


def frame(values, names, start=None, rate=None):
    table = pd.DataFrame(values, columns=names)
    if rate:
        table.insert(0, "t", start + np.arange(len(table)) / rate)
    return table


@pytest.fixture
def rig(tmp_path):
    """A folder of csv files and its layout; functions to change and to convert it."""
    return Rig(tmp_path)


class Rig:
    def __init__(self, path):
        self.path, self.root = path, path / "root"
        self.layout = HEAD + (
            '[[files]]\npattern = "{surface}/{trial}_force.csv"\ntime = { column = "t", unit = "s" }\n' + FORCE + "\n"
            '[[files]]\npattern = "{surface}/{trial}_motion.csv"\ntime = { column = "t", unit = "s" }\n'
            + VELOCITY
            + "\n"
        )
        for number, surface in enumerate(("felt", "wood")):
            (self.root / surface).mkdir(parents=True)
            force, velocity, _ = explore(seed=number)
            frame(force, ["fx", "fy", "fz"], 5.0, RATE).to_csv(self.force(surface), index=False)
            frame(velocity, ["vx", "vy"], 5.0, MOTION_RATE).to_csv(self.motion(surface), index=False)

    def force(self, surface="wood"):
        return self.root / surface / "0_force.csv"

    def motion(self, surface="wood"):
        return self.root / surface / "0_motion.csv"

    def edit(self, path, change):
        table = pd.read_csv(path)
        changed = change(table)
        (table if changed is None else changed).to_csv(path, index=False)

    def convert(self):
        (self.path / "layout.toml").write_text(self.layout)
        return convert_folder(self.root, self.path / "layout.toml", self.path / "r.h5", quiet=True)

    def refuses(self, message):
        with pytest.raises(ValueError, match=message):
            self.convert()
        assert not [path for path in self.path.iterdir() if "r.h5" in path.name]


def recorded(path, name="wood/0/0"):
    with RecordingsFile(path) as file:
        return file.read(name)


def test_csv_with_time_stamps(rig):
    report = rig.convert()
    assert (report.recordings, report.surfaces, report.seconds) == (2, ["felt", "wood"], 6.0)
    assert not report.notes and not report.left_out
    for number, surface in enumerate(("felt", "wood")):
        force, velocity, _ = explore(seed=number)
        recording = recorded(rig.path / "r.h5", f"{surface}/0/0")
        np.testing.assert_array_equal(recording.force, force)  # the shortest text of a float32 gives it back
        np.testing.assert_array_equal(recording.velocity, velocity)
        assert (recording.rate, recording.velocity_rate, recording.unit) == (RATE, MOTION_RATE, "N")
    with RecordingsFile(rig.path / "r.h5") as file:
        assert file.attributes["source"] == "a rig" and file.attributes["licence"] == "CC0-1.0"
        assert file.attributes["conversion"] == str(report)
    assert "2 recordings of 2 surfaces by 1 explorers, 6.0 s of force at 1000 Hz" in str(report)


FLAT = {
    "npy": lambda path, table: np.save(path, table.to_numpy(np.float32)),
    "xlsx": lambda path, table: table.to_excel(path, index=False),
    "parquet": lambda path, table: table.to_parquet(path),
    "csv": lambda path, table: table.to_csv(path, index=False, sep=";", decimal=","),
}


@pytest.mark.parametrize("kind", FLAT)
def test_folders_named_as_in_the_cluster_haptic_texture_dataset(tmp_path, kind):
    """(texture)_(direction)_(speed)_(push force)_(repeat), force and position in folders of their own."""
    if kind == "parquet":
        pytest.importorskip("pyarrow")
    force, velocity, _ = explore()
    for folder, table in (("force", frame(force, list("xyz"))), ("velocity", frame(velocity, list("xy")))):
        (tmp_path / "root" / folder).mkdir(parents=True)
        for name in ("7_135_40_500_0", "7_135_40_500_1"):
            FLAT[kind](tmp_path / "root" / folder / f"{name}.{kind}", table)
    names = '{ x = 0, y = 1, z = 2, unit = "N" }', '{ x = 0, y = 1, unit = "mm/s" }'
    pattern = "{surface}_{trial.direction}_{trial.speed}_{trial.push}_{trial.repeat}." + kind
    layout = HEAD + "".join(
        f'[[files]]\npattern = "{channel}/{pattern}"\nrate = {rate}\n{channel} = {columns}\n'
        for channel, rate, columns in (("force", RATE, names[0]), ("velocity", MOTION_RATE, names[1]))
    )
    (tmp_path / "layout.toml").write_text(layout)
    report = convert_folder(tmp_path / "root", tmp_path / "layout.toml", tmp_path / "r.h5", quiet=True)
    assert report.recordings == 2
    recording = recorded(tmp_path / "r.h5", "7/0/135_40_500_1")
    np.testing.assert_array_equal(recording.force, force)
    np.testing.assert_array_equal(recording.velocity, velocity)
    (tmp_path / "layout.toml").write_text(layout.replace("_{trial.repeat}", "_*"))
    with pytest.raises(ValueError, match="two files for its force: .*500_0.* and .*500_1.*joins two fields to one"):
        convert_folder(tmp_path / "root", tmp_path / "layout.toml", tmp_path / "r.h5", quiet=True)


def test_many_recordings_in_one_file(tmp_path):
    force, velocity, _ = explore()
    (tmp_path / "root").mkdir()
    with h5py.File(tmp_path / "root/all.h5", "w") as file:
        for name in ("felt/P1", "wood/P2"):
            file[f"{name}/force"], file[f"{name}/velocity"] = force, velocity
            file[f"{name}/force"].attrs["rate"], file[f"{name}/velocity"].attrs["rate"] = RATE, MOTION_RATE
    (tmp_path / "layout.toml").write_text(
        f"{HEAD}"
        '[[files]]\npattern = "all.h5"\ninside = "{surface}/P{explorer}/force"\n'
        'force = { x = 0, y = 1, z = 2, unit = "N" }\n'
        '[[files]]\npattern = "all.h5"\ninside = "{surface}/P{explorer}/velocity"\n'
        'velocity = { x = 0, y = 1, unit = "mm/s" }\n'
    )
    convert_folder(tmp_path / "root", tmp_path / "layout.toml", tmp_path / "r.h5", quiet=True)
    with RecordingsFile(tmp_path / "r.h5") as file:
        assert file.names == ["felt/1/0", "wood/2/0"]  # the rates are those that the file tells
        np.testing.assert_array_equal(file.read("wood/2/0").force, force)


def test_lateral_force_as_sound(tmp_path):
    lateral = explore()[0][:, 0] / 4
    (tmp_path / "root/felt").mkdir(parents=True)
    soundfile.write(tmp_path / "root/felt/3.wav", np.stack([0 * lateral, lateral], axis=-1), RATE, subtype="FLOAT")
    (tmp_path / "layout.toml").write_text(
        f'{HEAD}[[files]]\npattern = "{{surface}}/{{trial}}.wav"\nlateral = {{ column = 1, unit = "N", scale = 4.0 }}\n'
    )
    convert_folder(tmp_path / "root", tmp_path / "layout.toml", tmp_path / "r.h5", quiet=True)
    recording = recorded(tmp_path / "r.h5", "felt/0/3")
    np.testing.assert_array_equal(recording.lateral, np.float32(lateral * 4))
    assert recording.rate == RATE and recording.force is None and recording.velocity is None


def test_position_units_signs_and_offset(rig):
    """mN, a normal axis that points up, mm as um, time in ms, motion that starts 0.1 s later by its clock."""
    force, velocity, position = explore(seed=1)
    rig.edit(rig.force(), lambda table: table.mul([1, 1000, 1000, -1000]))
    stage = frame(position * 1000, ["px", "py"], 0.0, MOTION_RATE)
    stage["t"] = 1000 * stage["t"] + 5000
    stage.to_csv(rig.motion(), index=False)
    (rig.root / "felt/0_force.csv").unlink()
    (rig.root / "felt/0_motion.csv").unlink()
    rig.layout = HEAD + (
        '[[files]]\npattern = "{surface}/{trial}_force.csv"\ntime = { column = "t", unit = "s" }\n'
        'force = { x = "fx", y = "fy", z = "fz", unit = "mN", normal_sign = -1 }\n'
        '[[files]]\npattern = "{surface}/{trial}_motion.csv"\ntime = { column = "t", unit = "ms" }\noffset = 0.1\n'
        'position = { x = "px", y = "py", unit = "um" }\n[velocity]\nwindow = 0.03\n'
    )
    assert rig.convert().recordings == 1
    recording = recorded(rig.path / "r.h5")
    np.testing.assert_allclose(recording.force, force[100:], rtol=1e-6)
    # a window of 30 ms takes 0.09 % off a sine of 1 Hz; 1 % of the speed is asked for
    np.testing.assert_allclose(recording.velocity[4:-4], velocity[4:-4], atol=0.8)


def set_cells(table, rows, column, value):
    table[column] = table[column].astype(object)
    table.loc[rows, column] = value


def test_what_is_missing_is_nan_and_counted(rig):
    def spoil(table):
        set_cells(table, 100, "fx", "err")
        table.loc[200:209, "fy"] = np.nan
        return table.drop(index=range(900, 920))

    rig.edit(rig.force(), spoil)
    rig.edit(rig.motion(), lambda table: table.drop(index=[50]))
    report = rig.convert()
    recording, force = recorded(rig.path / "r.h5"), explore(seed=1)[0]
    expected = force.copy()
    expected[100, 0] = np.nan
    expected[200:210, 1] = np.nan
    expected[900:920] = np.nan
    np.testing.assert_array_equal(recording.force, expected)
    assert np.isnan(recording.velocity[50]).all() and np.isnan(recording.velocity).sum() == 2
    place = str(rig.force())
    assert report.notes["cells that are no number, NaN"] == [1, f"{place}, column 'fx'"]
    assert report.notes["samples missing in the files, NaN"] == [11, f"{place}, line 102"]
    assert report.notes["samples dropped (gaps in the time stamps), NaN"] == [21, f"{place}, after line 901"]
    assert "note: 11 samples missing in the files, NaN; first" in str(report)


def test_the_end_of_the_sensors_range_is_left_to_the_preparation(rig):
    """Counted there as what it is; only a change of rate would smear it, so it is missing then."""

    def spoil(table):
        table.loc[500:539, "fz"] = 2.0  # the end of the range
        table.loc[700, "fx"] = 150.0  # one glitch above the force of a finger

    rig.edit(rig.force(), spoil)
    assert "recordings: samples above 100 N excluded" in rig.convert().notes
    recording = recorded(rig.path / "r.h5")
    assert np.flatnonzero(channels(recording).saturated).tolist() == [*range(500, 540), 700]
    rig.layout = rig.layout.replace("force = {", "resample = 2000\nforce = {")
    rig.convert()
    resampled = recorded(rig.path / "r.h5").force
    assert np.isnan(resampled[1000:1079]).all() and np.isnan(resampled[1400]).all() and np.nanmax(resampled) < 2


def test_recordings_that_cannot_be_used_are_left_out(rig):
    rig.edit(rig.force("felt"), lambda table: table[:1500])
    assert rig.convert().recordings == 2  # how long segments are is chosen later
    rig.edit(rig.force("felt"), lambda table: table[:200])
    report = rig.convert()
    assert report.recordings == 1 and "0.2 s in common, the filter needs 0.25 s" in report.left_out["felt/0/0"]
    rig.motion("felt").unlink()
    report = rig.convert()
    assert report.left_out == {"felt/0/0": "no file with position or velocity"}
    assert "left out: felt/0/0: no file with position or velocity" in str(report)
    rig.edit(rig.force(), lambda table: table.assign(fx=np.nan))
    (rig.path / "r.h5").unlink()
    rig.refuses("none of 2 recordings can be used; felt/0/0: no file with position or velocity")


LAYOUT_FAULTS = {
    "_force.csv": ("_forces.csv", r"\[\[files\]\] 1, `pattern` = .* matches none of the 4 files.*'felt/0_force.csv'"),
    '"fz"': ('"fzz"', r"\[\[files\]\] 1: .*felt.0_force.csv has no column 'fzz'.*Did you mean 'fz'"),
    'unit = "s"': ('unit = "ms"', "none of 2 recordings can be used; felt/0/0: .*0.003 s in common, the filter needs"),
    'time = { column = "t", unit = "s" }': ("", "`rate` is missing, there is no `time`"),
    "{surface}/{trial}_motion": ("{trial}/{surface}_motion", "no recording in .* has all its files; .* Let the fields"),
    'time = { column = "t"': (
        'rate = 1020\ntime = { column = "t"',
        "1020 Hz, but the time stamps are 1000 Hz",
    ),
    'unit = "s" }\nforce': (
        'unit = "s" }\noffset = 1000.0\nforce',
        "force and motion do not overlap in time",
    ),
}


@pytest.mark.parametrize("old", LAYOUT_FAULTS)
def test_faults_of_the_layout_are_named(rig, old):
    new, message = LAYOUT_FAULTS[old]
    assert old in rig.layout
    rig.layout = rig.layout.replace(old, new)
    rig.refuses(message)


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda t: t.assign(fx=t["fx"] * 1000, fy=t["fy"] * 1000, fz=t["fz"] * 1000), "N.*mN"),
        (lambda t: t.assign(fx=t["fz"], fz=t["fx"]), "x looks like the normal force"),
        (lambda t: pd.concat([t[100:200], t[:100], t[200:]]), "line 102: time runs backward by 0.199 s"),
        (lambda t: t.assign(t=5 + (t["t"] - 5) * 8.17), "rate of the force is 122.399 Hz; it must be a whole number"),
    ],
)
def test_faults_of_the_numbers_are_named(rig, change, message):
    rig.edit(rig.force(), change)
    rig.refuses(f"wood.0_force.csv.*{message}")


@pytest.mark.parametrize(
    "file, change, note, detail",
    [
        (Rig.motion, lambda t: t.assign(vx=t["vx"] / 1000, vy=t["vy"] / 1000), "a median speed outside", ""),
        (Rig.force, lambda t: t.assign(fz=-t["fz"]), "z is negative on average: is `normal_sign` right", ""),
        (Rig.force, lambda t: t.assign(fz=t["fz"] / 1000), "a median normal force outside", " (0.0005 N)"),
        (Rig.motion, lambda t: t[:560], "force and motion differ in length", " (2.24 s, {} 3 s)"),
    ],
)
def test_suspicious_units_signs_and_lengths_are_noted(rig, file, change, note, detail):
    assert not rig.convert().notes
    rig.edit(file(rig), change)
    (kind, (count, place)) = rig.convert().notes.popitem()
    assert note in kind and count == 1 and place == str(file(rig)) + detail.format(rig.force())


def test_two_rates_cannot_be_prepared(rig):
    rig.edit(rig.force(), lambda table: table[::2])
    text = str(rig.convert())
    assert "at 1000 and 500 Hz" in text and "needs one rate" in text


def test_a_dead_sensor_is_left_out(rig):
    rig.edit(rig.force(), lambda table: table.assign(fx=0.0, fy=0.0, fz=0.1))
    report = rig.convert()
    assert report.left_out == {"wood/0/0": f"{rig.force()}: the force never changes: nothing was connected"}


def test_output_is_refused_early(rig):
    (rig.path / "layout.toml").write_text(rig.layout)
    with pytest.raises(FileNotFoundError, match="The folder .*nowhere of r.h5 does not exist"):
        convert_folder(rig.root, rig.path / "layout.toml", rig.path / "nowhere/r.h5", quiet=True)
    with pytest.raises(ValueError, match="is one of the files to convert"):
        convert_folder(rig.root, rig.path / "layout.toml", rig.force(), quiet=True)
    with pytest.raises(FileNotFoundError, match="There is no folder"):
        convert_folder(rig.path / "nothing", rig.path / "layout.toml", rig.path / "r.h5", quiet=True)


RATINGS = """
[ratings]
pattern = "ratings.csv"
form = "long"
rater = "who"
surface = "what"
scale = [1, 5]
[ratings.axes]
roughness = { column = "rough", high = "rough" }
"""


def test_ratings_come_along(rig):
    (rig.root / "ratings.csv").write_text("who,what,rough\na,felt,1\nb,felt,2\na,wood,5\n")
    rig.layout += RATINGS
    report = rig.convert()
    with RecordingsFile(rig.path / "r.h5") as file:
        np.testing.assert_array_equal(file.ratings.values[:, :, 0], [[0, 8], [2, np.nan]])
        assert file.ratings.surfaces == ("felt", "wood") and file.ratings.axes == ("roughness",)
    assert "ratings by 2 raters on roughness" in str(report)
    rig.motion("felt").unlink()  # the recording of felt is left out, and so are the answers on it
    report = rig.convert()
    with RecordingsFile(rig.path / "r.h5") as file:
        assert file.ratings.surfaces == ("wood",)
    assert any("['felt'] left out: all their recordings are" in note for note in report.rating_notes)


def test_rated_names_are_found_in_names_of_files(rig):
    """The shortest name of a surface would be "felt", by the explorer "P80"."""
    for name in ("felt_P80_ann_1", "felt_P240_ann_1", "cork_ann_1"):
        for old, kind in ((rig.force(), "force"), (rig.motion(), "motion")):
            (rig.root / f"{kind}_{name}.csv").write_bytes(old.read_bytes())
    rig.layout = rig.layout.replace("{surface}/{trial}_force", "force_{surface}_{explorer}_{trial}")
    rig.layout = rig.layout.replace("{surface}/{trial}_motion", "motion_{surface}_{explorer}_{trial}") + RATINGS
    (rig.root / "ratings.csv").write_text("who,what,rough\na,felt_P80,1\na,felt P240,2\na,cork,5\n")
    rig.refuses('felt P240" = "felt_P240"')
    rig.layout += '[surface_names]\n"felt P240" = "felt_P240"\n'
    report = rig.convert()
    assert report.surfaces == ["cork", "felt_P240", "felt_P80"] and report.explorers == ["ann"]
    (rig.path / "r.h5").unlink()
    (rig.root / "ratings.csv").write_text("who,what,rough\na,emery P80,1\na,emery P240,2\na,cork,5\n")
    rig.layout = rig.layout.replace('[surface_names]\n"felt P240" = "felt_P240"\n', "")
    rig.refuses(r"`pattern` splits names of surfaces: a part of 'emery P\d+' .* in the explorer 'P\d+'")
    rig.layout += '[surface_names]\n"emery P80" = "felt_P80"\n"emery P240" = "felt_P240"\n'
    assert rig.convert().surfaces == ["cork", "felt_P240", "felt_P80"]
