"""A `recordings.h5` written out as a folder of plain files with its `layout.toml`: the way back of `convert_folder`."""

import csv
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from scipy import io
from tqdm import tqdm

from ...io.files import check_parent, whole_folder
from ...signal.rating_scales import RATING_SCALE
from ..recordings import VELOCITY_UNIT, RecordingsFile
from .layout import AXIS_WORDS, FORMAT, VERSION
from .sources import HIDDEN_PREFIXES
from .tables import TREE_KINDS
from .toml_text import toml_table, toml_value

#: Kind of the files and their extension.
EXPORT_KINDS = {"csv": ".csv", "npy": ".npy", "hdf5": ".h5", "mat": ".mat"}
#: Significant digits with which text gives back every float32.
FLOAT32_DIGITS = 9
#: Rows of a csv that are formatted at once.
_ROWS_AT_ONCE = 10_000
#: Stands for a unit in names of columns, which MATLAB allows letters, digits and "_" only.
_UNIT_NAMES = {"N": "N", "1": "counts", "mm/s": "mm_s"}
_README = """\
To get recordings.h5 back, run in Python, in this folder (needs tactile-diffusers):
from tactile_diffusers.data.folder import convert_folder; convert_folder(".", "layout.toml", "recordings.h5")
"""


def export_folder(recordings, folder, kind="csv", quiet=False):
    """Writes recordings and ratings as a folder of plain files, with the `layout.toml` that reads it.

    Each recording is "surface/explorer/trial_<channel>_<rate>Hz.<extension>": of `force` (or `lateral`) and of
    `velocity` one file each (csv, npy), or one file with a group or struct each (hdf5, mat). `ratings.csv` has one row
    per rater and surface. Nothing is lost: csv has 9 significant digits, the others are float32.

    Only what `convert_folder` can give back is written: further attributes of the file (a seed) and further groups
    (the ground truth of virtual surfaces, which is for evaluation only) are not. A rater without any answer does not
    come back.

    Args:
        recordings (`str` or `Path`): `recordings.h5`.
        folder (`str` or `Path`): new or empty; it appears only when it is whole.
        kind (`str`): "csv", "npy", "hdf5" or "mat".
        quiet (`bool`): no progress bar.

    Raises:
        FileNotFoundError: if `recordings`, or the folder that is to hold `folder`, does not exist.
        ValueError: if `recordings` is invalid, `kind` is unknown, `folder` is not empty, a name cannot be that of a
            file, or a recording has 3-D force without velocity, which a layout cannot describe.
    """
    if kind not in EXPORT_KINDS:
        raise ValueError(f"`kind` must be one of {', '.join(EXPORT_KINDS)}, got {kind!r}.")
    folder = Path(folder)
    check_parent(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(f"`folder` must be new or empty, {folder} exists: remove it, or give another name.")
    with RecordingsFile(recordings) as source:
        _check_names(source)
        with whole_folder(folder) as temporary:
            entries = {}  # in order, each once
            for recording in tqdm(source, total=len(source), desc="exporting", unit="recording", disable=quiet):
                for entry in _write_recording(temporary, recording, kind):
                    entries[entry] = True
            if source.ratings is not None:
                _write_ratings(temporary / "ratings.csv", source.ratings)
            (temporary / "layout.toml").write_text(_layout_text(source, entries), encoding="utf-8")
            (temporary / "README.txt").write_text(_README, encoding="utf-8")


def _check_names(source):
    for name in source.names:
        for part in name.split("/"):
            if part.startswith(HIDDEN_PREFIXES) or "\\" in part or not part.isprintable():
                raise ValueError(
                    f"{source.path}: {part!r} of {name!r} cannot name a file: name surfaces, explorers and trials "
                    f"without {', '.join(HIDDEN_PREFIXES)} in front, '\\' and control characters."
                )


def _write_recording(folder, recording, kind):
    """Writes the files of one recording; returns the `[[files]]` that describe them."""
    channels = _channels(recording)
    place = folder / recording.surface / recording.explorer
    place.mkdir(parents=True, exist_ok=True)
    entries = []
    for part in [channels] if kind in TREE_KINDS else [{name: channel} for name, channel in channels.items()]:
        rates = [f"{name}_{toml_value(channel.rate)}Hz" for name, channel in part.items()]
        ending = "_".join(rates) + EXPORT_KINDS[kind]
        _WRITERS[kind](place / f"{recording.trial}_{ending}", part)
        entries += [_files_text(kind, ending, name, channel) for name, channel in part.items()]
    return entries


@dataclass
class _Channel:
    """`values` (n, c) float32, the `names` of its columns, `rate` in Hz, and `unit`."""

    values: np.ndarray
    names: list[str]
    rate: float
    unit: str


def _channels(recording):
    """Channels of a recording by name."""
    channels = {}
    if recording.force is None:
        channels["lateral"] = (recording.lateral[:, None], ("lateral",), recording.rate, recording.unit)
    elif recording.velocity is None:
        raise ValueError(
            f"{recording.name} has 3-D `force` but no `velocity`, which a layout cannot describe: store `velocity`, or "
            "the projected force as `lateral`."
        )
    else:
        channels["force"] = (recording.force, ("fx", "fy", "fz"), recording.rate, recording.unit)
    if recording.velocity is not None:
        channels["velocity"] = (recording.velocity, ("vx", "vy"), recording.velocity_rate, VELOCITY_UNIT)
    return {
        name: _Channel(values, [f"{column}_{_UNIT_NAMES[unit]}" for column in columns], rate, unit)
        for name, (values, columns, rate, unit) in channels.items()
    }


def _files_text(kind, ending, name, channel):
    """One `[[files]]` of the layout."""
    columns = list(range(len(channel.names))) if kind == "npy" else channel.names
    axes = ["column"] if name == "lateral" else list("xyz"[: len(columns)])
    described = dict(zip(axes, columns, strict=True), unit=channel.unit)
    if name == "force":
        described["normal_sign"] = 1
    keys = {
        "pattern": "{surface}/{explorer}/{trial}_" + ending,
        "inside": name if kind in TREE_KINDS else None,
        "rate": channel.rate,
        name: described,
    }
    return toml_table(keys, header="[[files]]")


def _write_csv(path, channels):
    (channel,) = channels.values()
    line = ",".join([f"%.{FLOAT32_DIGITS}g"] * channel.values.shape[1]) + "\n"
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(channel.names) + "\n")
        for start in range(0, len(channel.values), _ROWS_AT_ONCE):  # five times as fast as row by row
            rows = channel.values[start : start + _ROWS_AT_ONCE]
            file.write(line * len(rows) % tuple(rows.ravel().tolist()))


def _write_npy(path, channels):
    (channel,) = channels.values()
    np.save(path, channel.values)


def _write_hdf5(path, channels):
    with h5py.File(path, "w") as file:
        for name, channel in channels.items():
            group = file.create_group(name)
            group.attrs.update(rate=float(channel.rate), unit=channel.unit)
            for column, values in zip(channel.names, channel.values.T, strict=True):
                group[column] = values


def _write_mat(path, channels):
    structs = {}
    for name, channel in channels.items():
        columns = dict(zip(channel.names, channel.values.T, strict=True))
        structs[name] = columns | {"rate": float(channel.rate), "unit": channel.unit}
    io.savemat(path, structs, oned_as="column")


_WRITERS = {"csv": _write_csv, "npy": _write_npy, "hdf5": _write_hdf5, "mat": _write_mat}


def _write_ratings(path, scores):
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["rater", "surface", *scores.axes])
        for rater, answers in zip(scores.raters, scores.values, strict=True):
            for surface, row in zip(scores.surfaces, answers, strict=True):
                numbers = ["" if np.isnan(value) else f"{value:.{FLOAT32_DIGITS}g}" for value in row]
                writer.writerow([rater, surface, *numbers])


def _layout_text(source, entries):
    """The whole `layout.toml`."""
    facts = {"format": FORMAT, "version": VERSION}
    facts |= {name: str(source.attributes.get(name, "not stated")) for name in ("source", "licence")}
    blocks = [toml_table(facts), *entries]
    if source.ratings is not None:
        ratings = {"pattern": "ratings.csv", "form": "long", "rater": "rater", "surface": "surface"}
        ratings["scale"] = list(RATING_SCALE)
        axes = {}
        for axis in source.ratings.axes:
            words = AXIS_WORDS.get(axis, (f"not {axis}", axis))
            axes[axis] = {"column": axis, "high": words[1], "words": list(words)}
        blocks += [toml_table(ratings, header="[ratings]"), toml_table(axes, header="[ratings.axes]")]
    return "\n\n".join(blocks) + "\n"
