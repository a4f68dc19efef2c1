"""A `recordings.h5` written out as a folder of csv files with its `layout.toml`: the way back of `convert_folder`.

python examples/export_folder.py --recordings recordings.h5 --output my_folder
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

from tactile_diffusers.cli.program import Parser, command, existing_file
from tactile_diffusers.data.folder.layout import AXIS_WORDS, FORMAT, VERSION
from tactile_diffusers.data.folder.layout_text import toml_table, toml_value
from tactile_diffusers.data.folder.sources import HIDDEN_PREFIXES
from tactile_diffusers.data.recordings import VELOCITY_UNIT, RecordingsFile
from tactile_diffusers.io.files import check_parent, whole_folder
from tactile_diffusers.signal.rating_scales import RATING_SCALE

#: Text with so many digits gives back every float32.
FLOAT32_TEXT = "%.9g"
_ROWS_AT_ONCE = 10_000
#: Names of units in names of columns.
_UNIT_NAMES = {"N": "N", "1": "counts", "mm/s": "mm_s"}
_README = """\
To get recordings.h5 back, run in Python, in this folder (needs tactile-diffusers):
from tactile_diffusers.data.folder import convert_folder; convert_folder(".", "layout.toml", "recordings.h5")
"""


def export_folder(recordings, folder, quiet=False):
    """Writes recordings and ratings as a folder of csv files, with the `layout.toml` that reads it.

    Each recording is "surface/explorer/trial_<channel>_<rate>Hz.csv", of `force` (or `lateral`) and of `velocity` one
    file each, with 9 significant digits: nothing is lost. `ratings.csv` has one row per rater and surface.

    Only what `convert_folder` can give back is written: further attributes of the file (a seed) and further groups
    (the ground truth of virtual surfaces, which is for evaluation only) are not. A rater without any answer does not
    come back.

    Args:
        recordings (`str` or `Path`): `recordings.h5`.
        folder (`str` or `Path`): new or empty; it appears only when it is whole.
        quiet (`bool`): no progress bar.

    Raises:
        FileNotFoundError: if `recordings`, or the folder that is to hold `folder`, does not exist.
        ValueError: if `recordings` is invalid, `folder` is not empty, a name cannot be that of a file, or a recording
            has 3-D force without velocity, which a layout cannot describe.
    """
    folder = Path(folder)
    check_parent(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(f"`folder` must be new or empty, {folder} exists: remove it, or give another name.")
    with RecordingsFile(recordings) as source:
        _check_names(source)
        with whole_folder(folder) as temporary:
            entries = {}  # in order, each once
            for recording in tqdm(source, total=len(source), desc="exporting", unit="recording", disable=quiet):
                for entry in _write_recording(temporary, recording):
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


def _write_recording(folder, recording):
    """Writes the files of one recording; returns the `[[files]]` that describe them."""
    if recording.force is not None and recording.velocity is None:
        raise ValueError(
            f"{recording.name} has 3-D `force` but no `velocity`, which a layout cannot describe: store `velocity`, or "
            "the projected force as `lateral`."
        )
    described = {  # columns, more keys, values, rate, unit
        "force": (dict(x="fx", y="fy", z="fz"), {"normal_sign": 1}, recording.force, recording.rate, recording.unit),
        "lateral": ({"column": "lateral"}, {}, recording.lateral, recording.rate, recording.unit),
        "velocity": (dict(x="vx", y="vy"), {}, recording.velocity, recording.velocity_rate, VELOCITY_UNIT),
    }
    place, entries = folder / recording.surface / recording.explorer, []
    place.mkdir(parents=True, exist_ok=True)
    for channel, (columns, more, values, rate, unit) in described.items():
        if values is None:
            continue
        columns = {axis: f"{column}_{_UNIT_NAMES[unit]}" for axis, column in columns.items()}
        ending = f"{channel}_{toml_value(rate)}Hz.csv"
        _write_csv(place / f"{recording.trial}_{ending}", list(columns.values()), values.reshape(len(values), -1))
        keys = {"pattern": "{surface}/{explorer}/{trial}_" + ending, "rate": rate}
        entries.append(toml_table("[[files]]", keys | {channel: columns | {"unit": unit} | more}))
    return entries


def _write_csv(path, names, values):
    line = ",".join([FLOAT32_TEXT] * len(names)) + "\n"
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(names) + "\n")
        for start in range(0, len(values), _ROWS_AT_ONCE):  # five times as fast as row by row
            rows = values[start : start + _ROWS_AT_ONCE]
            file.write(line * len(rows) % tuple(rows.ravel().tolist()))


def _write_ratings(path, scores):
    rows = pd.MultiIndex.from_product([scores.raters, scores.surfaces], names=["rater", "surface"])
    frame = pd.DataFrame(np.reshape(scores.values, (len(rows), len(scores.axes))), rows, list(scores.axes))
    frame.to_csv(path, float_format=FLOAT32_TEXT)


def _layout_text(source, entries):
    """The whole `layout.toml`."""
    facts = {"format": FORMAT, "version": VERSION}
    facts |= {name: str(source.attributes.get(name, "not stated")) for name in ("source", "licence")}
    blocks = [toml_table("", facts), *entries]
    if source.ratings is not None:
        ratings = {"pattern": "ratings.csv", "form": "long", "rater": "rater", "surface": "surface"}
        ratings["scale"] = list(RATING_SCALE)
        axes = {}
        for axis in source.ratings.axes:
            words = AXIS_WORDS.get(axis, (f"not {axis}", axis))
            axes[axis] = {"column": axis, "high": words[1], "words": list(words)}
        blocks += [toml_table("[ratings]", ratings), toml_table("[ratings.axes]", axes)]
    return "\n\n".join(blocks) + "\n"


@command("export_folder.py")
def main(argv=None):
    """Runs the command."""
    parser = Parser(prog="export_folder.py", description="Write recordings as a folder of csv files with its layout.")
    add = parser.add_argument
    add("--recordings", type=existing_file, required=True, metavar="RECORDINGS.h5", help="what to write")
    add("--output", type=Path, required=True, metavar="FOLDER", help="new or empty")
    add("--quiet", action="store_true", help="no progress bar")
    arguments = parser.parse_args(argv)
    export_folder(arguments.recordings, arguments.output, arguments.quiet)
    print(f"wrote {arguments.output}")


if __name__ == "__main__":
    sys.exit(main())
