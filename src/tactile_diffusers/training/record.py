"""What the training scripts leave behind: `training.json` (command, data, machine) and `log.jsonl` (losses)."""

import json
import os
from pathlib import Path

from ..io.files import write_text
from ..io.reading import read_json

#: What a card tells of a training.
_TOLD = {"script": str, "arguments": dict, "segments": int, "steps": int, "machine": str, "versions": dict}
#: What trainings of old did not note.
_OPTIONAL = {"changed": dict, "processes": int}
#: The training that one went on from, among its arguments.
_BEFORE = "pretrained_model_name_or_path"
#: Steps and sizes beyond it are damage.
_LARGEST = 2**53


def read_record(folder):
    """`training.json` of a folder: a dict, empty if there is none that can be read, or values are of another kind."""
    try:
        record = read_json(Path(folder) / "training.json", "JSON")
    except (OSError, ValueError):
        return {}
    fits = all(_is(record[name], kind) for name, kind in (_TOLD | _OPTIONAL).items() if name in record)
    return record if fits and isinstance(record.get("arguments", {}).get(_BEFORE), str | None) else {}


def is_complete(record):
    """Whether a record holds all that a card tells of a training."""
    return _TOLD.keys() <= record.keys()


def _is(value, kind):
    return type(value) is kind and (kind is not int or 0 <= value < _LARGEST)


def read_log(folder):
    """Entries of `log.jsonl` as `read_entries` gives them."""
    return read_entries(Path(folder) / "log.jsonl")


def read_entries(path):
    """Entries of a log: a list of dicts of numbers, empty if there is none.

    Left out is what a kill or damage left of a line: what is no JSON, has no step, or holds anything but numbers.
    """
    entries = []
    try:
        lines = Path(path).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return entries
    for line in lines:
        try:
            entries.append(json.loads(line))
        except (ValueError, RecursionError):
            continue
    return [entry for entry in entries if _is_entry(entry)]


def _is_entry(entry):
    if not isinstance(entry, dict) or not _is(entry.get("step"), int):
        return False
    return all(type(value) is float or (type(value) is int and abs(value) < _LARGEST) for value in entry.values())


def trim_log(folder, step):
    """Drops what a log says of later steps, and a last line that a kill cut off; returns the entries that stay."""
    path, entries = Path(folder) / "log.jsonl", [entry for entry in read_log(folder) if entry["step"] <= step]
    text = "".join(json.dumps(entry) + "\n" for entry in entries)
    if not path.is_file() or path.read_bytes() != text.encode():
        write_text(path, text)
    return entries


def read_losses(folder):
    """Entries of `log.jsonl` that hold the training loss."""
    return [entry for entry in read_log(folder) if "train/loss" in entry]


def phases(folder):
    """A training and those that it went on from, the first one first.

    Args:
        folder (`str` or `Path`): output folder of the last one.

    Returns:
        `list[tuple[Path, dict]]`: folder and record; that of a phase that is named but not found is empty.
    """
    found, seen, folder = [], set(), Path(folder)
    while folder.resolve() not in seen:
        seen.add(folder.resolve())
        record = read_record(folder)
        found.append((folder, record))
        before = record.get("arguments", {}).get(_BEFORE)
        if before is None or "\0" in before:  # of which no path is made
            break
        # runs are moved together: where it is no more, it may lie beside
        folder = Path(before) if os.path.isdir(before) else folder.parent / Path(before).name
    return found[::-1]
