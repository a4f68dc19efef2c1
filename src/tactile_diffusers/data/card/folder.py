"""The folder of a data card: whole or absent, and never in place of something else."""

from pathlib import Path

from ...io.files import whole_folder
from ...io.reading import read_json

CARD_FORMAT = "tactile-data-card"
CARD_VERSION = 1
#: Holds every number of a card, and under "files" the names of all its files.
NUMBERS_FILE = "card.json"


def check_card_folder(output):
    """Refuses a folder that a card may not replace.

    Args:
        output (`str` or `Path`): absent, empty, or an older card with nothing beside it.

    Raises:
        FileNotFoundError: if the folder around `output` does not exist.
        ValueError: if `output` is a file, or holds anything that a card did not write.
    """
    output = Path(output).resolve()
    if not output.parent.is_dir():
        raise FileNotFoundError(f"The folder {output.parent} of {output.name} does not exist: create it first.")
    if output.exists() and not output.is_dir():
        raise ValueError(f"{output} is a file: give the name of a new folder, or of an older card.")
    if output.is_dir():
        foreign = sorted({path.name for path in output.iterdir()} - _files_of_card(output))
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


def card_folder(output):
    """A context that yields a new folder, put in place of `output` if the block succeeds (`whole_folder`)."""
    return whole_folder(output, lambda: check_card_folder(output))  # again: files may have appeared since
