"""What the training scripts leave behind: `training.json` (command, data, machine) and `log.jsonl` (losses)."""

import json
from pathlib import Path

from ..data.files import write_text
from ..reading import read_json


def read_record(folder):
    """`training.json` of a folder: a dict, empty if there is none that can be read."""
    try:
        return read_json(Path(folder) / "training.json", "JSON")
    except (OSError, ValueError):
        return {}


def read_log(folder):
    """Entries of `log.jsonl`: a list of dicts, empty if there is none; a line that a kill cut off is left out."""
    entries = []
    try:
        lines = (Path(folder) / "log.jsonl").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return entries
    for line in lines:
        try:
            entries.append(json.loads(line))
        except (ValueError, RecursionError):
            continue
    return [entry for entry in entries if isinstance(entry, dict) and isinstance(entry.get("step"), int)]


def trim_log(folder, step):
    """Drops what a log says of later steps, and a last line that a kill cut off; returns the entries that stay."""
    path, entries = Path(folder) / "log.jsonl", [entry for entry in read_log(folder) if entry["step"] <= step]
    text = "".join(json.dumps(entry) + "\n" for entry in entries)
    if not path.is_file() or path.read_text() != text:
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
        before = record.get("arguments", {}).get("pretrained_model_name_or_path")
        if before is None:
            break
        # runs are moved together: where it is no more, it may lie beside
        folder = Path(before) if Path(before).is_dir() else folder.parent / Path(before).name
    return found[::-1]
