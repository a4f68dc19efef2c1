"""The folder of a study: what lies where, and how it is read again."""

from dataclasses import dataclass
from pathlib import Path

import pandas

from ..io.files import atomic_path
from ..io.reading import read_json, reading
from ..signal import RATING_AXES

FORMAT, VERSION = "tactile-study", 1
STIMULI, TRIALS, PROTOCOL = "stimuli", "trials", "protocol.md"
#: What participants, and who meets them, must not see.
PRIVATE = "experimenter"
KEY, SETTINGS = f"{PRIVATE}/key.csv", f"{PRIVATE}/study.json"
#: Columns of `KEY` and what they hold.
KEY_COLUMNS = {
    "id": "blind id: the name of the files in stimuli/",
    "surface": "held-out surface",
    "condition": "what the texture is",
    "copy_of": "id of the same texture; a copy is only played as X of ABX, so that no trial list reveals the answer",
    **{f"asked_{axis}": f"{axis} of the surface, z-score: the request" for axis in RATING_AXES},
    "rms_n": "level of the file, RMS in N",
    "peak_n": "largest force of the file, N",
    "recording": "of a real take: surface, explorer and trial; the takes are of one explorer where one has two",
    "gain_db": "applied to the texture as recorded or generated, the study's attenuation included",
    "friction_coefficient": "written to the file; empty = unknown",
    "reference_speed": "finger speed of the recording or of the model, mm/s; empty = unknown",
    "seed": "of the noise of a generated or reconstructed texture, or of the study for others",
}
_WORDS = ("id", "surface", "condition", "copy_of", "recording")


@dataclass(frozen=True)
class Study:
    """A study as its experimenter sees it.

    Attributes:
        folder (`Path`): of the study.
        key (`pandas.DataFrame`): columns `KEY_COLUMNS`, one row a file.
        settings (`dict`): of `experimenter/study.json`.
    """

    folder: Path
    key: pandas.DataFrame
    settings: dict


def write_csv(path, frame):
    """Writes a table without its index, whole or not at all."""
    with atomic_path(path) as temporary:
        frame.to_csv(temporary, index=False)


def read_study(folder):
    """Reads the key and the settings of a study.

    Args:
        folder (`str` or `Path`): that `make_study` wrote.

    Returns:
        `Study`

    Raises:
        FileNotFoundError: if the key or the settings are missing.
        ValueError: if they are not those of a study.
    """
    folder = Path(folder)
    for name in (KEY, SETTINGS):
        if not (folder / name).is_file():
            raise FileNotFoundError(f"There is no {folder / name}: make a study first (examples/make_study.py make).")
    with reading(folder / SETTINGS, "settings of a study", "Make the study again."):
        settings = read_json(folder / SETTINGS, "JSON")
        if (settings["format"], settings["version"]) != (FORMAT, VERSION):
            raise ValueError(f"its format is {settings['format']} {settings['version']}, not {FORMAT} {VERSION}")
    numbers = [column for column in KEY_COLUMNS if column not in _WORDS]
    with reading(folder / KEY, "the key of a study", "Make the study again."):
        key = pandas.read_csv(
            folder / KEY,
            dtype=dict.fromkeys(_WORDS, str),
            keep_default_na=False,
            na_values=dict.fromkeys(numbers, [""]),
        )
        missing = [column for column in KEY_COLUMNS if column not in key]
        if missing:
            raise ValueError(f"{folder / KEY} lacks the columns {missing}. Make the study again.")
        key[numbers] = key[numbers].apply(pandas.to_numeric)  # a word among numbers is refused
    return Study(folder, key, settings)
