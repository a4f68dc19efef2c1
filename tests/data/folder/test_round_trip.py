"""The whole route: recordings -> folder -> layout -> recordings -> segments, against the direct route."""

import re

import h5py
import numpy as np
import pytest

from tactile_diffusers.data import RecordingsFile, prepare_recordings
from tactile_diffusers.data.folder import draft_layout, inspect_folder, load_layout
from tactile_diffusers.data.folder.convert import convert_folder
from tactile_diffusers.data.folder.folder_export import export_folder
from tactile_diffusers.virtual import generate_recordings

#: Answers to every TODO in the draft of an exported folder.
ANSWERS = {
    "source": "virtual surfaces",
    "licence": "CC0-1.0",
    "roughness": "rough",
    "bumpiness": "bumpy",
    "slipperiness": "slippery",
    "force": "N",
    "velocity": "mm/s",
}


def assert_same_recordings(path, expected):
    with RecordingsFile(path) as file, RecordingsFile(expected) as other:
        assert file.names == other.names and file.unit == other.unit
        for name in file.names:
            one, two = file.read(name), other.read(name)
            assert (one.rate, one.velocity_rate) == (two.rate, two.velocity_rate)
            np.testing.assert_array_equal(one.force, two.force)
            np.testing.assert_array_equal(one.velocity, two.velocity)
        for name in ("raters", "surfaces", "axes"):
            assert getattr(file.ratings, name) == getattr(other.ratings, name)
        np.testing.assert_array_equal(file.ratings.values, other.ratings.values)
        for name in ("source", "licence"):
            assert file.attributes[name] == other.attributes[name]


def datasets(path):
    """All datasets of an HDF5 file: {name: array}."""
    found = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: found.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None)
    return found


def prepared(recordings):
    path = recordings.with_name("prepared.h5")
    prepare_recordings(recordings, path, validation=1, test=1, quiet=True)
    return path


def assert_same_segments(path, expected):
    """Textures, index, ratings, splits: every dataset of the prepared file, bit for bit."""
    ours, theirs = datasets(path), datasets(expected)
    assert ours.keys() == theirs.keys() and len(ours["segments/filtered/start"]) > 5
    for name, values in theirs.items():
        np.testing.assert_array_equal(ours[name], values, err_msg=name)


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    path = tmp_path_factory.mktemp("source") / "recordings.h5"
    generate_recordings(path, surfaces=4, seconds=9, explorers=1, seed=3, quiet=True)
    return path


@pytest.fixture(scope="module")
def direct(source):
    return prepared(source)


@pytest.fixture(scope="module")
def exported(source, tmp_path_factory):
    folder = tmp_path_factory.mktemp("exported") / "folder"
    export_folder(source, folder, quiet=True)
    return folder


def test_same_recordings_and_segments(exported, source, direct, tmp_path):
    output = tmp_path / "recordings.h5"
    report = convert_folder(exported, exported / "layout.toml", output, quiet=True)
    assert report.recordings == 4 and not report.left_out
    assert_same_recordings(output, source)
    assert_same_segments(prepared(output), direct)


def test_inspected_drafted_and_filled_in(exported, source, tmp_path):
    layout, output, lines = tmp_path / "drafted.toml", tmp_path / "recordings.h5", []
    draft = draft_layout(inspect_folder(exported, quiet=True))
    layout.write_text(draft)
    with pytest.raises(ValueError, match="drafted.toml: `source` = 'TODO.* is still to be filled in"):
        load_layout(layout)
    for line in draft.splitlines():
        lines.append(re.sub(r'"TODO[^"]*"', f'"{ANSWERS.get(line.partition(" = ")[0])}"', line))
    layout.write_text("\n".join(lines))
    convert_folder(exported, layout, output, quiet=True)
    assert_same_recordings(output, source)


def rewrite(folder, ending, header, columns):
    """Rewrites all csv files of an ending with `columns(values)` under `header`; values are (rows, 2 or 3) float64."""
    for path in folder.glob(f"*/*/*{ending}"):
        rows = columns(np.loadtxt(path, delimiter=",", skiprows=1))
        line = ",".join(["%.9g"] * rows.shape[1]) + "\n"
        path.write_text(header + "\n" + line * len(rows) % tuple(rows.ravel()))


def edit_layout(folder, *changes):
    text = (folder / "layout.toml").read_text()
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    (folder / "layout.toml").write_text(text)


def test_time_columns_instead_of_rates(source, direct, tmp_path):
    # Force in ms from 3.2 s on, motion in s from 3.1 s on: the conversion crops the motion and finds both rates.
    folder, output = tmp_path / "folder", tmp_path / "recordings.h5"
    export_folder(source, folder, quiet=True)

    def stamped(values, start, rate, unit):
        return np.column_stack([(start + np.arange(len(values)) / rate) / unit, values])

    def early(values):
        return np.concatenate([np.repeat(values[:1], 50, axis=0), values])

    rewrite(folder, "force_10000Hz.csv", "time,fx_N,fy_N,fz_N", lambda v: stamped(v, 3.2, 10_000, 1e-3))
    rewrite(folder, "velocity_500Hz.csv", "time,vx_mm_s,vy_mm_s", lambda v: stamped(early(v), 3.1, 500, 1))
    edit_layout(
        folder,
        ("rate = 10000", 'time = { column = "time", unit = "ms" }'),
        ("rate = 500", 'time = { column = "time", unit = "s" }'),
    )
    convert_folder(folder, folder / "layout.toml", output, quiet=True)
    assert_same_recordings(output, source)
    assert_same_segments(prepared(output), direct)
