"""What training scripts leave behind: `training.json` (command, data, surfaces, machine), `log.jsonl` (losses)."""

import json
import os
import platform
import sys
from pathlib import Path

import diffusers
import torch

from ..checkpoints import SURFACES_FILE
from ..io.files import write_text
from ..io.reading import read_json

#: Keys of a record that a model card needs.
_REQUIRED = {"script": str, "arguments": dict, "changed": dict, "segments": int, "steps": int}
_REQUIRED |= {"processes": int, "machine": str, "versions": dict}
#: The argument that names the training that one continued from.
_EARLIER = "pretrained_model_name_or_path"
_LARGEST = 2**53  # steps and sizes beyond it are damage


def write_record(args, accelerator, segments, steps, surfaces):
    """Writes `training.json` into the output folder, for the model card and for whoever evaluates the result."""
    script, defaults = Path(sys.argv[0]), getattr(args, "defaults", {})
    arguments = {name: value for name, value in vars(args).items() if value is not None and name != "defaults"}
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
    record = _read_json(Path(folder) / "training.json")
    fits = all(_is(record[name], kind) for name, kind in _REQUIRED.items() if name in record)
    return record if fits and isinstance(record.get("arguments", {}).get(_EARLIER), str | None) else {}


def _read_json(path):
    try:
        return read_json(path, "JSON")
    except (OSError, ValueError):
        return {}


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
    return [entry for entry in map(_parse, lines) if entry is not None]


def _parse(line):
    """The entry of a line; `None` if it is none."""
    try:
        entry = json.loads(line)
        whole = _is(entry["step"], int) and all(_is(value, int) or type(value) is float for value in entry.values())
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
    return entry if whole else None


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


# --- which surfaces a checkpoint was trained on, so that an evaluation can say whether its surfaces are new to it


def surfaces_of(dataset, rows=None):
    """The surfaces of a view of a data set.

    Args:
        dataset (`PreparedDataset`): the view.
        rows (`np.ndarray`, *optional*): of these segments; default: of all.

    Returns:
        `dict`: "source", "seed" (`None` but for virtual surfaces) and "surfaces" (sorted names).
    """
    ids = dataset.surface_ids if rows is None else dataset.surface_ids[rows]
    names = sorted({dataset.surfaces[number] for number in ids.tolist()})
    return {"source": dataset.source, "seed": dataset.attributes.get("seed"), "surfaces": names}


def trained_on(folders):
    """The surfaces of trainings and of those that they continued from.

    Args:
        folders (`Sequence[str` or `Path]`): of trainings, or of published checkpoints.

    Returns:
        `tuple[list[dict], bool]`: as `surfaces_of`, of all phases that name them, and whether all phases do.
    """
    found, complete = [], bool(folders)
    for folder in folders:
        for phase, record in phases(folder):
            listed, whole = [record.get("trained_on")], True
            if not _lists_surfaces(listed[0]):
                content = _read_json(phase / SURFACES_FILE)  # of a published checkpoint
                listed = content.get("trained_on") if isinstance(content.get("trained_on"), list) else []
                listed = [one for one in listed if _lists_surfaces(one)]
                whole = bool(listed) and content.get("complete") is True
            complete = complete and whole
            found += [one for one in listed if one not in found]
    return found, complete


def _lists_surfaces(one):
    names = one.get("surfaces") if isinstance(one, dict) else None
    return isinstance(names, list) and all(isinstance(name, str) for name in names)


def write_surfaces(folder, found, complete):
    """Writes what `trained_on` found beside a published checkpoint; nothing where nothing is known."""
    if found:
        content = json.dumps({"complete": complete, "trained_on": found}, indent=1) + "\n"
        write_text(Path(folder) / SURFACES_FILE, content)


def count_seen(judged, found):
    """How many of the judged surfaces were trained on: names count and, for virtual surfaces, their seeds.

    Args:
        judged (`dict`): as `surfaces_of`.
        found (`list[dict]`): of `trained_on`.

    Returns:
        `int`
    """
    known = {name for one in found if one.get("seed") == judged["seed"] for name in one["surfaces"]}
    return len(known.intersection(judged["surfaces"]))


def warning(seen, judged):
    """A warning that `seen` of the `judged` surfaces were trained on; "" if none were, or if it is not known."""
    if not seen:
        return ""
    return (
        f"the checkpoint was trained on {seen} of the {judged} surfaces that judge it: the results do not show how it "
        "does on new surfaces"
    )
