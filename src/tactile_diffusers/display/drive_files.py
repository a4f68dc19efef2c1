"""Files about a display: its profile, and the recording from which a profile is fitted.

A profile is a JSON object with `format` "tactile-drive-profile", `version` 1, `units`, and the arguments of
`DriveProfile`; `lookup` is the name of a CSV file beside it with the columns voltage,friction_increase or
amplitude,friction_reduction, or null.

A calibration is described at `read_drive_calibration`. The columns of its recording are the commanded drive and the
force along the sliding direction with its mean, sample by sample while the finger slides.

`units` names the units of the numbers: N, mm/s, Hz, and V or 1 (relative amplitude) for the drive.
"""

import json
from pathlib import Path

from ..io.files import atomic_path, write_text
from ..io.reading import read_json, read_table, reading
from .drive_curves import DRIVE_UNITS, LOOKUP_COLUMNS, check_kind

PROFILE_FORMAT = "tactile-drive-profile"
CALIBRATION_FORMAT = "tactile-drive-calibration"
VERSION = 1
RECORDING_COLUMNS = ("drive", "lateral_force")
_PROFILE_KEYS = ("kind", "gain", "offset", "cutoffs", "max_drive", "normal_force", "lookup", "max_gain_db")
_CALIBRATION_KEYS = ("kind", "sampling_rate", "normal_force", "speed", "recording", "lookup")


def write_profile(path, profile):
    """Writes the JSON file of a `DriveProfile`, and `<stem>.lookup.csv` beside it if it has a lookup."""
    path = Path(path)
    values = {key: getattr(profile, key) for key in _PROFILE_KEYS}
    content = {"format": PROFILE_FORMAT, "version": VERSION, "units": _units(profile.kind), **values}
    if profile.lookup is None:
        write_text(path, _json(content))
        return
    table = path.with_name(f"{path.stem}.lookup.csv")
    content["lookup"] = table.name
    rows = [",".join(LOOKUP_COLUMNS[profile.kind]), *(f"{drive!r},{change!r}" for drive, change in profile.lookup)]
    with atomic_path(table) as temporary_table, atomic_path(path) as temporary:
        temporary_table.write_text("\n".join(rows) + "\n", encoding="utf-8")
        temporary.write_text(_json(content), encoding="utf-8")


def read_profile(path):
    """Arguments of `DriveProfile` from its JSON file, with the errors of `DriveProfile.load`."""
    content = _read_json(path, PROFILE_FORMAT, _PROFILE_KEYS)
    return {**content, "lookup": _read_lookup(path, content["kind"], content["lookup"])}


def read_drive_calibration(path):
    """Reads a calibration recording: `fit_drive_profile(**read_drive_calibration(path))` fits the profile.

    `path` is a JSON file with `format` "tactile-drive-calibration", `version` 1, `units`, `kind`, `sampling_rate`,
    `normal_force`, `speed`, `recording` (the name of a CSV file beside it with the columns drive,lateral_force) and
    `lookup` (as in a profile).

    Returns:
        `dict`: the arguments of `fit_drive_profile`.

    Raises:
        FileNotFoundError: if a file is missing.
        ValueError: if a file is empty or truncated, of another format, in other units, or has other columns.
    """
    content = _read_json(path, CALIBRATION_FORMAT, _CALIBRATION_KEYS)
    command, measured = _read_table(path, "recording", content.pop("recording"), RECORDING_COLUMNS).T
    lookup = _read_lookup(path, content["kind"], content["lookup"])
    return {**content, "command": command, "measured": measured, "lookup": lookup}


def _units(kind):
    return {"force": "N", "speed": "mm/s", "frequency": "Hz", "drive": DRIVE_UNITS[kind]}


def _json(content):
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def _read_json(path, form, keys):
    """The values of `keys`, once format, version and units are known to be right."""
    content = read_json(path, "JSON")
    if content.get("format") != form or content.get("version") != VERSION:
        raise ValueError(f'{path} must be a JSON object with "format": "{form}" and "version": {VERSION}.')
    names = {"format", "version", "units", *keys}
    if content.keys() != names:
        missing, unknown = sorted(names - content.keys()), sorted(content.keys() - names)
        raise ValueError(f"{path} must hold {', '.join(sorted(names))}: it lacks {missing} and has unknown {unknown}.")
    with reading(path, f"a {form}", "Correct its `kind`."):
        check_kind(content["kind"])
    if content["units"] != _units(content["kind"]):
        raise ValueError(
            f"{path}: `units` must be {_units(content['kind'])} for {content['kind']}, got {content['units']}. "
            "Convert the values, then change the units."
        )
    return {key: content[key] for key in keys}


def _read_lookup(path, kind, name):
    return None if name is None else _read_table(path, "lookup", name, LOOKUP_COLUMNS[kind]).tolist()


def _read_table(path, key, name, columns):
    """Numbers of the CSV file that a JSON file names, beside it and with these columns: (rows, columns) float64."""
    if not isinstance(name, str) or Path(name).name != name:
        raise ValueError(f"{path}: `{key}` must be the name of a CSV file in the same folder, got {name!r}.")
    table = Path(path).with_name(name)
    if not table.is_file():
        raise FileNotFoundError(f"{table}, which {path} names as its `{key}`, does not exist.")
    with reading(table, "CSV in UTF-8", "Write it again, with decimal points."):
        return read_table(table, columns)[1]
