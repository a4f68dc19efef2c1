"""Which surfaces a checkpoint was trained on, so that an evaluation can say whether its surfaces are new to it."""

import json
from pathlib import Path

from ..checkpoints import SURFACES_FILE
from ..io.files import write_text
from ..io.reading import read_json
from .record import phases


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
            if not _is_listed(listed[0]):
                listed, whole = _read_published(phase)
            complete = complete and whole
            found += [one for one in listed if one not in found]
    return found, complete


def write_surfaces(folder, found, complete):
    """Writes what `trained_on` found beside a published checkpoint; nothing where nothing is known."""
    if found:
        content = json.dumps({"complete": complete, "trained_on": found}, indent=1) + "\n"
        write_text(Path(folder) / SURFACES_FILE, content)


def count_seen(judged, found):
    """How many of the judged surfaces were trained on.

    Surfaces are the same if their names are, and, for virtual surfaces, their seeds.

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


def _read_published(folder):
    try:
        content = read_json(folder / SURFACES_FILE, "JSON")
    except (OSError, ValueError):
        return [], False
    listed = content.get("trained_on")
    listed = [one for one in listed if _is_listed(one)] if isinstance(listed, list) else []
    return listed, bool(listed) and content.get("complete") is True


def _is_listed(one):
    names = one.get("surfaces") if isinstance(one, dict) else None
    return isinstance(names, list) and all(isinstance(name, str) for name in names)
