"""Writes a data card: card.md (from `data_card.jinja`), its pictures, and card.json with every number."""

import json
from pathlib import Path

import jinja2

from tactile_diffusers.data.prepare import prepare_recordings
from tactile_diffusers.data.recordings import RecordingsFile
from tactile_diffusers.io.files import check_parent, whole_folder
from tactile_diffusers.io.reading import read_json
from tactile_diffusers.signal import RATING_AXES

from .measure import CARD_FORMAT, describe
from .pictures import MOST_EXPLORERS, MOST_NAMES, draw_ratings, draw_surfaces, unit_name

CARD_FILE, SURFACES, RATINGS = "card.md", "surfaces.png", "ratings.png"
#: Holds every number of a card, and under "files" the names of all its files.
NUMBERS_FILE = "card.json"
TEMPLATE = Path(__file__).parent / "data_card.jinja"
#: Stands for the name of the prepared file where there was none.
DEFAULT_LIMITS = "this card, with the default limits, into a temporary file; every surface as training surface"
#: The first section after the warnings: what is before it is the summary.
_AFTER_SUMMARY = "\n## What was kept"


def write_card(recordings, output, prepared=None, quiet=False):
    """Writes a data card into a folder of its own.

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
        ValueError: if `recordings` or `prepared` is invalid, `prepared` does not belong to `recordings`, no segment
            meets the limits, or `output` holds files that no card wrote.
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
        card["files"] = [CARD_FILE, NUMBERS_FILE, *_draw(card, folder)]
        (folder / CARD_FILE).write_text(markdown(card), encoding="utf-8")
        (folder / NUMBERS_FILE).write_text(json.dumps(card, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return card


def _prepare(recordings, temporary, quiet):
    RecordingsFile(recordings).close()  # problems of the file itself are not a matter of limits
    try:
        prepare_recordings(recordings, temporary, validation=0, test=0, quiet=quiet)
    except ValueError as error:
        remedy = "These were the default limits: for others use examples/prepare_data.py, and give its --prepared here."
        raise ValueError(f"{error}\n{remedy}") from error


def _draw(card, folder):
    """Draws the pictures that the numbers of a card allow; returns their names."""
    draw_surfaces(card, folder / SURFACES)
    if not card["ratings"]:
        return [SURFACES]
    draw_ratings(card["ratings"], folder / RATINGS)
    return [SURFACES, RATINGS]


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
    foreign = {path.name for path in output.iterdir()} if output.is_dir() else set()
    try:
        older = read_json(output / NUMBERS_FILE, "a data card")
        if older.get("format") == CARD_FORMAT:
            foreign -= {str(name) for name in older["files"]}
    except (OSError, ValueError, KeyError, TypeError):
        pass  # no card, or a damaged one: everything is foreign
    if foreign:
        raise ValueError(
            f"{output} holds {sorted(foreign)[:3]}, which no data card wrote: give a new folder, or move what is in it."
        )


def summary(card):
    """The head of a card: what the data are, and the warnings."""
    return markdown(card).partition(_AFTER_SUMMARY)[0].rstrip()


def warnings_in_words(card):
    """The warnings of a card as a Markdown list."""
    return "\n".join(f"- **{warning['name']}**: {warning['text']}" for warning in card["warnings"]) or "None."


def markdown(card):
    """The whole card: its numbers in the words and tables of the template."""
    environment = jinja2.Environment(trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined)
    environment.filters.update(row=_row, head=_head, percent=_percent)
    conversion, explorers = str(card["recordings"]["conversion"] or ""), card["kept"]["explorers"]
    noted = [line for line in conversion.splitlines() if line.startswith(("note: ", "left out: "))]
    text = environment.from_string(TEMPLATE.read_text(encoding="utf-8")).render(
        card,
        axes=RATING_AXES,
        unit=unit_name(card["recordings"]["unit"]),
        limits=_limits_in_words(card["preparation"]["limits"]),
        conversion_notes="\n".join(f"- {line.removeprefix('note: ')}" for line in noted),
        warnings_in_words=warnings_in_words(card),
        kept_explorers=list(explorers) if 1 < len(explorers) <= MOST_EXPLORERS else [],
        most_explorers=MOST_EXPLORERS,
        most_names=MOST_NAMES,
    )
    return text.rstrip() + "\n"


def _limits_in_words(limits):
    """Limits of segments, the dict in the attributes of a prepared file, in words."""
    channels = (("normal force", limits["normal_force"], "N"), ("speed", limits["speed"], "mm/s"))
    words = [
        f"any {name}" if bounds is None else f"{name} {bounds[0]:g}–{bounds[1]:g} {unit}"
        for name, bounds, unit in channels
    ]
    words += [f"deviations up to {limits['longest_excursion']:g} s bridged", f"segments of {limits['seconds']:g} s"]
    return ", ".join([*words, f"{100 * limits['overlap']:.0f} % overlap"])


def _row(cells):
    """A row of a Markdown table: None is a dash, numbers have two digits."""
    return "| " + " | ".join(map(_cell, cells)) + " |"


def _head(cells, align="---:"):
    """The first row of a table and the rule below it; the first column is left-aligned text."""
    return _row(cells) + "\n|---" + f"|{align}" * (len(cells) - 1) + "|"


def _cell(value):
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.2f}" if abs(value) >= 0.1 or value == 0 else f"{value:.2g}"
    return str(value).replace("|", "\\|").replace("\n", " ")


def _percent(share):
    return None if share is None else f"{100 * share:.1f} %"
