"""What the training scripts leave behind: `training.json` (command, data, machine) and `log.jsonl` (losses)."""

import json
import os
import platform
import sys
from pathlib import Path

import diffusers
import torch

from ..io.files import write_text
from ..io.reading import read_json

#: Keys of a record that a model card needs.
_REQUIRED = {"script": str, "arguments": dict, "changed": dict, "segments": int, "steps": int}
_REQUIRED |= {"processes": int, "machine": str, "versions": dict}
#: The argument that names the training that one continued from.
_EARLIER = "pretrained_model_name_or_path"
#: Steps and sizes beyond it are damage.
_LARGEST = 2**53


def write_record(args, accelerator, segments, steps, surfaces):
    """Writes `training.json` into the output folder, for the model card and for whoever evaluates the result.

    Args:
        args (`argparse.Namespace`): of `parse_training_arguments`.
        accelerator (`Accelerator`): the training's.
        segments, steps (`int`): of the training.
        surfaces (`dict` or `None`): of `surfaces_of`.
    """
    script, defaults = Path(sys.argv[0]), getattr(args, "defaults", {})
    kept_out = ("defaults", "hub_token")  # a secret is written nowhere
    arguments = {name: value for name, value in vars(args).items() if value is not None and name not in kept_out}
    record = {
        "script": f"{script.parent.name}/{script.name}",
        "arguments": arguments,
        "changed": {k: v for k, v in arguments.items() if k not in defaults or v != defaults[k]},
        "segments": segments,
        "trained_on": surfaces,
        "steps": steps,
        "processes": accelerator.num_processes,  # the global batch is that of each, times these
        "machine": f"{platform.machine()}, {torch.get_num_threads()} thread(s), {accelerator.device}",
        "versions": {"torch": torch.__version__, "diffusers": diffusers.__version__},
    }
    write_text(Path(args.output_dir) / "training.json", json.dumps(record, indent=2) + "\n")


def read_record(folder):
    """`training.json` of a folder: a dict, empty if there is none or it is damaged."""
    try:
        record = read_json(Path(folder) / "training.json", "JSON")
    except (OSError, ValueError):
        return {}
    fits = all(_is(record[name], kind) for name, kind in _REQUIRED.items() if name in record)
    return record if fits and isinstance(record.get("arguments", {}).get(_EARLIER), str | None) else {}


def is_complete(record):
    """Whether a record holds all that a model card needs of a training."""
    return _REQUIRED.keys() <= record.keys()


def _is(value, kind):
    return type(value) is kind and (kind is not int or 0 <= value < _LARGEST)


def phases(folder):
    """A training and those that it continued from, the first one first.

    Args:
        folder (`str` or `Path`): output folder of the last one.

    Returns:
        `list[tuple[Path, dict]]`: folder and record; the record of a phase that is not found is empty.
    """
    found, seen, folder = [], set(), Path(folder)
    while folder.resolve() not in seen:
        seen.add(folder.resolve())
        record = read_record(folder)
        found.append((folder, record))
        earlier = record.get("arguments", {}).get(_EARLIER)
        if earlier is None or "\0" in earlier:  # no path has a NUL
            break
        # trainings are moved together: an earlier one may lie beside this one
        folder = Path(earlier) if os.path.isdir(earlier) else folder.parent / Path(earlier).name
    return found[::-1]


def read_log(folder):
    """Entries of `log.jsonl` in a folder: a list of dicts of numbers, empty if there is none.

    Lines that a kill or damage left are skipped: those that are no JSON, have no step, or hold anything but numbers.
    """
    try:
        lines = (Path(folder) / "log.jsonl").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []
    return [entry for entry in map(_parse, lines) if _is_entry(entry)]


def _parse(line):
    try:
        return json.loads(line)
    except (ValueError, RecursionError):
        return None


def _is_entry(entry):
    if not isinstance(entry, dict) or not _is(entry.get("step"), int):
        return False
    return all(type(value) is float or (type(value) is int and abs(value) < _LARGEST) for value in entry.values())


def read_losses(folder):
    """Entries of `log.jsonl` that hold the training loss."""
    return [entry for entry in read_log(folder) if "train/loss" in entry]


def trim_log(folder, step):
    """Removes later steps from a log, and a last line that a kill cut off; returns the entries that stay."""
    path, entries = Path(folder) / "log.jsonl", [entry for entry in read_log(folder) if entry["step"] <= step]
    text = "".join(json.dumps(entry) + "\n" for entry in entries)
    if not path.is_file() or path.read_bytes() != text.encode():
        write_text(path, text)
    return entries
