"""The data card: what is in a recordings.h5, what was kept of it, and what to worry about."""

import json
import math
from pathlib import Path

import numpy as np

from ..dataset import PreparedDataset
from ..prepare import prepare_recordings
from ..recordings import RecordingsFile
from ..segments import SegmentLimits
from ..splits import SPLITS
from .advice import warnings_of
from .answers import describe_answers, describe_pooled, relate
from .figures import draw_all
from .folder import CARD_FORMAT, CARD_VERSION, NUMBERS_FILE, card_folder, check_card_folder
from .markdown import markdown
from .selection import check_same, describe_selection
from .source import describe_source
from .surfaces import describe_surfaces, examples, measured_quantities
from .turnarounds import describe_turnarounds

CARD_FILE = "card.md"
#: Stands for the name of the prepared file where there was none.
DEFAULT_LIMITS = "this card, with the default limits, into a file that is gone; every surface as training surface"


def write_card(recordings, output, prepared=None, quiet=False):
    """Writes a data card: `card.md`, its pictures, and `card.json` with every number.

    One recording is in memory at a time, and the spectra are of some hundred segments.

    Args:
        recordings (`str` or `Path`): `recordings.h5`.
        output (`str` or `Path`): the folder to write; an older card is replaced, in one step.
        prepared (`str` or `Path`, *optional*): the data set prepared from `recordings`. Without it one is prepared
            with the default limits, beside the card, and removed again.
        quiet (`bool`): no progress bars.

    Returns:
        `dict`: the numbers, as in `card.json`; NaN is None.

    Raises:
        FileNotFoundError: if a file, or the folder around `output`, does not exist.
        ValueError: naming the problem and the remedy, if `recordings` or `prepared` is invalid, one was not made from
            the other, no segment meets the limits, or `output` is something that no card wrote.
    """
    check_card_folder(output)
    with card_folder(output) as folder:
        made_by = f"examples/prepare_data.py: {Path(prepared).name}" if prepared else DEFAULT_LIMITS
        temporary = folder / "prepared.h5"
        if prepared is None:
            _prepare(recordings, temporary, quiet)
        card, textures = describe(recordings, prepared or temporary, quiet)
        temporary.unlink(missing_ok=True)
        card["preparation"]["made_by"] = made_by
        pictures = draw_all(card, textures, folder)
        (folder / CARD_FILE).write_text(markdown(card, pictures), encoding="utf-8")
        card["files"] = [CARD_FILE, NUMBERS_FILE, *pictures]
        (folder / NUMBERS_FILE).write_text(json.dumps(card, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return card


def _prepare(recordings, temporary, quiet):
    RecordingsFile(recordings).close()  # what is wrong with the file itself is not a matter of limits
    try:
        prepare_recordings(recordings, temporary, validation=0, test=0, quiet=quiet)
    except ValueError as error:
        remedy = "These were the default limits: for others use examples/prepare_data.py, and give its --prepared here."
        raise ValueError(f"{error}\n{remedy}") from error


def describe(recordings, prepared, quiet=False):
    """The numbers of a card, and the textures (examples, samples) of its waveforms.

    Args and errors as in `write_card`; `prepared` is required.
    """
    data = PreparedDataset(prepared, "all")
    limits = SegmentLimits(**data.attributes["limits"])
    with RecordingsFile(recordings) as source:
        check_same(source, data)
        facts, histograms = describe_source(source, limits, quiet)
        turnarounds = describe_turnarounds(data, source)
        scores, names = source.ratings, source.surfaces
    kept, times = describe_selection(data)
    rows, spectra = describe_surfaces(data)
    for row in rows:
        row |= times[row["name"]]
    entries, textures = examples(data, rows)
    card = {
        "format": CARD_FORMAT,
        "version": CARD_VERSION,
        "recordings": facts,
        "preparation": _preparation(data),
        "kept": kept,
        "histograms": histograms,
        "surfaces": rows,
        "spectra": spectra,
        "turnarounds": turnarounds,
        "ratings": None if scores is None else _ratings(scores, names, data.surface_ratings, rows, spectra["edges"]),
        "examples": entries,
    }
    card = plain(card)
    card["warnings"] = warnings_of(card)
    return card, textures


def _preparation(data):
    noted = ("limits", "band", "filter_order", "filter_passes", "turnarounds", "split_seed", "hold_out")
    lines = data.attributes["report"].splitlines()
    return {
        **{name: data.attributes[name] for name in noted},
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


def _ratings(scores, surfaces, pooled, rows, edges):
    return {
        "answers": describe_answers(scores, surfaces),
        "pooled": describe_pooled(pooled),
        "relation": relate(pooled, measured_quantities(rows, edges)),
    }


def plain(value):
    """Numbers and arrays as Python values of six significant digits; what is not finite becomes None."""
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
