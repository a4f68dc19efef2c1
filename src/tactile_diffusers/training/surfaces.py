"""Which surfaces a checkpoint was trained on: whoever judges it can tell whether they are new to it."""

import json
from pathlib import Path

from ..checkpoints import SURFACES_FILE
from ..io.files import write_text
from ..io.reading import read_json
from .record import phases


def surfaces_of(dataset, rows=None):
    """Where the surfaces of a view of the data come from, and their names.

    Args:
        dataset (`PreparedDataset`): or anything with the result as its attribute `trained_on`.
        rows (`np.ndarray`, *optional*): of these segments; default: of all of the view.

    Returns:
        `dict` or `None`: "source", "seed" (`None` but for virtual surfaces) and "surfaces" (sorted names).
    """
    if not hasattr(dataset, "surface_ids"):
        return getattr(dataset, "trained_on", None)
    ids = dataset.surface_ids if rows is None else dataset.surface_ids[rows]
    names = sorted({dataset.surfaces[number] for number in ids.tolist()})
    return {"source": dataset.source, "seed": dataset.attributes.get("seed"), "surfaces": names}


def trained_on(folders):
    """The surfaces of trainings and of those that they went on from.

    Args:
        folders (`Sequence[str` or `Path]`): of trainings, or of published checkpoints.

    Returns:
        `tuple[list[dict], bool]`: as `surfaces_of`, of all phases that say so, and whether all do.
    """
    found, complete = [], bool(folders)
    for folder in folders:
        for phase, record in phases(folder):
            if _is_told(record.get("trained_on")):
                told = [record["trained_on"]]
            else:
                told, whole = _published(phase)
                complete = complete and whole
            found += [one for one in told if one not in found]
    return found, complete


def write_surfaces(folder, found, complete):
    """Writes what `trained_on` found beside a published checkpoint; nothing where nothing is known."""
    if found:
        write_text(
            Path(folder) / SURFACES_FILE, json.dumps({"complete": complete, "trained_on": found}, indent=1) + "\n"
        )


def count_seen(judged, found):
    """How many of the judged surfaces were trained on.

    The name tells, and for virtual surfaces the seed: other seeds use the same names for other surfaces. What a source
    calls itself does not count: it is easily put in other words.

    Args:
        judged (`dict`): as `surfaces_of`.
        found (`list[dict]`): of `trained_on`.

    Returns:
        `int`
    """
    known = {name for one in found if one.get("seed") == judged["seed"] for name in one["surfaces"]}
    return len(known.intersection(judged["surfaces"]))


def warning(seen, judged):
    """What there is to say of judged surfaces that were trained on; "" where there is nothing.

    Args:
        seen (`int`): how many were.
        judged (`int`): of how many.
    """
    if not seen:
        return ""
    return (
        f"the checkpoint was trained on {seen} of the {judged} surfaces that judge it: this does not tell what it does "
        "on surfaces that it has not seen"
    )


def _published(folder):
    try:
        content = read_json(folder / SURFACES_FILE, "JSON")
    except (OSError, ValueError):
        return [], False
    told = content.get("trained_on")
    told = [one for one in told if _is_told(one)] if isinstance(told, list) else []
    return told, bool(told) and content.get("complete") is True


def _is_told(one):
    names = one.get("surfaces") if isinstance(one, dict) else None
    return isinstance(names, list) and all(isinstance(name, str) for name in names)
