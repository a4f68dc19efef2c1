"""The data card: what is in a recordings.h5, what was kept of it, and what to worry about."""

import json
import math
from pathlib import Path

import numpy as np

from ...io.files import check_parent, whole_folder
from ...io.reading import read_json
from ..dataset import PreparedDataset
from ..prepare import prepare_recordings
from ..recordings import RecordingsFile
from ..segments import SegmentLimits
from ..splits import SPLITS
from .advice import warnings_of
from .answers import describe_answers, describe_pooled, relate
from .card_figures import draw_all
from .measure import check_same, describe_selection, describe_source, describe_surfaces, measured_quantities
from .page import markdown

CARD_FORMAT = "tactile-data-card"
CARD_VERSION = 2
CARD_FILE = "card.md"
#: Holds every number of a card, and under "files" the names of all its files.
NUMBERS_FILE = "card.json"
#: Stands for the name of the prepared file where there was none.
DEFAULT_LIMITS = "this card, with the default limits, into a temporary file; every surface as training surface"


def write_card(recordings, output, prepared=None, quiet=False):
    """Writes a data card: `card.md`, its pictures, and `card.json` with every number.

    One recording is in memory at a time, and the spectra are of some hundred segments.

    Args:
        recordings (`str` or `Path`): `recordings.h5`.
        output (`str` or `Path`): the folder to write; an older card is replaced, in one step.
        prepared (`str` or `Path`, *optional*): the data set prepared from `recordings`. Without it one is prepared
            with the default limits, into a temporary file.
        quiet (`bool`): no progress bars.

    Returns:
        `dict`: the numbers, as in `card.json`; NaN is None.

    Raises:
        FileNotFoundError: if a file, or the folder around `output`, does not exist.
        ValueError: naming the problem and the remedy, if `recordings` or `prepared` is invalid, `prepared` does not
            belong to `recordings`, no segment meets the limits, or `output` holds files that no card wrote.
    """
    check_card_folder(output)
    with whole_folder(output, lambda: check_card_folder(output)) as folder:  # again: files may have appeared since
        temporary = folder / "prepared.h5"
        if prepared is None:
            _prepare(recordings, temporary, quiet)
        card = describe(recordings, prepared or temporary, quiet)
        temporary.unlink(missing_ok=True)
        prepared_by = f"examples/prepare_data.py: {Path(prepared).name}" if prepared else DEFAULT_LIMITS
        card["preparation"]["prepared_by"] = prepared_by
        pictures = draw_all(card, folder)
        (folder / CARD_FILE).write_text(markdown(card, pictures), encoding="utf-8")
        card["files"] = [CARD_FILE, NUMBERS_FILE, *pictures]
        (folder / NUMBERS_FILE).write_text(json.dumps(card, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return card


def check_card_folder(output):
    """Refuses a folder that a card may not replace.

    Args:
        output (`str` or `Path`): absent, empty, or an older card with nothing beside it.

    Raises:
        FileNotFoundError: if the folder around `output` does not exist.
        ValueError: if `output` is a file, or holds anything that a card did not write.
    """
    output = Path(output).resolve()
    check_parent(output)
    if output.exists() and not output.is_dir():
        raise ValueError(f"{output} is a file: give the name of a new folder, or of an older card.")
    foreign = sorted({path.name for path in output.iterdir()} - _files_of_card(output)) if output.is_dir() else []
    if foreign:
        raise ValueError(
            f"{output} holds {foreign[:3]}, which no data card wrote: give a new folder, or move what is in it."
        )


def _files_of_card(folder):
    """Names that the card in `folder` wrote; empty if there is no card."""
    try:
        card = read_json(folder / NUMBERS_FILE, "a data card")
    except (OSError, ValueError):
        return set()
    files = card.get("files")
    if card.get("format") != CARD_FORMAT or not isinstance(files, list):
        return set()
    return {name for name in files if isinstance(name, str)}


def _prepare(recordings, temporary, quiet):
    RecordingsFile(recordings).close()  # problems of the file itself are not a matter of limits
    try:
        prepare_recordings(recordings, temporary, validation=0, test=0, quiet=quiet)
    except ValueError as error:
        remedy = "These were the default limits: for others use examples/prepare_data.py, and give its --prepared here."
        raise ValueError(f"{error}\n{remedy}") from error


def describe(recordings, prepared, quiet=False):
    """The numbers of a card.

    Args and errors as in `write_card`; `prepared` is required.
    """
    data = PreparedDataset(prepared, "all")
    limits = SegmentLimits(**data.attributes["limits"])
    with RecordingsFile(recordings) as source:
        check_same(source, data)
        facts, conditions = describe_source(source, limits, quiet)
        scores, names = source.ratings, source.surfaces
    kept, times = describe_selection(data)
    rows, bands = describe_surfaces(data)
    for row in rows:
        row |= times[row["name"]]
    ratings = None
    if scores is not None:
        pooled = data.ratings.mean
        ratings = {
            "answers": describe_answers(scores, names),
            "pooled": describe_pooled(pooled),
            "relation": relate(pooled, measured_quantities(rows, bands["edges"])),
        }
    card = {
        "format": CARD_FORMAT,
        "version": CARD_VERSION,
        "recordings": facts,
        "preparation": _preparation(data),
        "kept": kept,
        "conditions": conditions,
        "surfaces": rows,
        "bands": bands,
        "ratings": ratings,
    }
    card = plain(card)
    card["warnings"] = warnings_of(card)
    return card


def _preparation(data):
    names = ("limits", "band", "filter_order", "filter_passes", "turnarounds", "split_seed", "hold_out")
    lines = data.attributes["report"].splitlines()
    return {
        **{name: data.attributes[name] for name in names},
        "sampling_rate": data.sampling_rate,
        "segment_samples": data.segment_samples,
        "segments": _segments_by_split(data),
        "notes": [line.removeprefix("note: ") for line in lines if line.startswith("note: ")],
    }


def _segments_by_split(data):
    """Split -> "surfaces" and "segments"; of the hard split, whose segments are in no other, if there is one."""
    splits = np.array(data.splits)
    counts = {
        split: {"surfaces": np.sum(splits == split), "segments": np.sum(splits[data.surface_ids] == split)}
        for split in SPLITS
        if split != "hard"
    }
    if data.attributes["hold_out"]:
        hard = PreparedDataset(data.path, "hard")
        counts["hard"] = {"surfaces": len(np.unique(hard.surface_ids)), "segments": len(hard)}
    return counts


def plain(value):
    """Numbers and arrays as Python values of six significant digits; NaN and infinity become None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bytes):  # a string of fixed length
        return value.decode("utf-8", "replace")
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value
