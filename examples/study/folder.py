"""The folder of a study: stimuli, key, trial lists and protocol, written as a whole and read again."""

import json
import math
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import jinja2
import pandas

from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.io.files import atomic_path, write_text
from tactile_diffusers.io.reading import read_json, reading
from tactile_diffusers.signal.checks import check_whole_number
from tactile_diffusers.version import __version__

from .stimuli import KEY_COLUMNS, axes_of, make_stimuli, write_stimuli
from .study_report import label
from .trials import SIMULATED, TASKS, TRIAL_COLUMNS, check_responses, ends_of, participant_trials, read_tables

FORMAT, VERSION = "tactile-study", 1
STIMULI, TRIALS, PROTOCOL = "stimuli", "trials", "protocol.md"
#: What participants, and who meets them, must not see.
PRIVATE = "experimenter"
KEY, SETTINGS = f"{PRIVATE}/key.csv", f"{PRIVATE}/study.json"
TEMPLATE = Path(__file__).parent / "protocol.jinja"
_WORDS = ("id", "surface", "condition", "copy_of", "recording")


@dataclass(frozen=True)
class Study:
    """A study as its experimenter sees it: its key has `KEY_COLUMNS`, one row a file, its settings are study.json's."""

    folder: Path
    key: pandas.DataFrame
    settings: dict


def write_csv(path, frame):
    """Writes a table without its index, whole or not at all."""
    with atomic_path(path) as temporary:
        frame.to_csv(temporary, index=False)


def read_study(folder):
    """Reads the key and the settings of a folder that `make_study` wrote: a `Study`.

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
    with reading(folder / KEY, "the key of a study", "Make the study again."):
        key = pandas.read_csv(folder / KEY, dtype=str, keep_default_na=False)
        missing = [column for column in KEY_COLUMNS if column not in key] or ([] if axes_of(key) else ["asked_<axis>"])
        if missing:
            raise ValueError(f"{folder / KEY} lacks the columns {missing}. Make the study again.")
        numbers = [column for column in key if column not in _WORDS]
        key[numbers] = (
            key[numbers].where(key[numbers] != "").apply(pandas.to_numeric)
        )  # a word among numbers is refused
    return Study(folder, key, settings)


def make_study(pipe, data, output, settings, participants=12, tasks=TASKS, checkpoint="", quiet=True):
    """Makes a study: a `Study`.

    Args:
        pipe (`TactileTexturePipeline`): with a DALE.
        data (`str` or `Path`): a prepared data set.
        output (`str` or `Path`): a folder that is absent or empty.
        settings (`StimulusSettings`): what is made.
        participants (`int`): trial lists to write.
        tasks (`Sequence[str]`): of `TASKS`.
        checkpoint (`str`): what the protocol calls the checkpoint.
        quiet (`bool`): no progress bars.

    Raises:
        ValueError: if the folder is not empty, a number is out of range, or the data or the checkpoint do not fit.
    """
    output = Path(output)
    if output.exists() and (not output.is_dir() or any(output.iterdir())):
        raise ValueError(f"`output` {output} must be a new or an empty folder: ids of two studies must not mix.")
    check_whole_number("participants", participants)
    stimuli = make_stimuli(pipe, data, settings, quiet)
    trials = participant_trials(stimuli.key, 1, settings.seed, tasks)  # refuses before anything is written
    facts = {
        "format": FORMAT,
        "version": VERSION,
        "seed": settings.seed,
        "checkpoint": checkpoint,
        "data": Path(data).name,
        "source": PreparedDataset(data, "test").source,
        "surfaces": stimuli.key["surface"].unique().tolist(),
        "conditions": stimuli.key["condition"].unique().tolist(),
        "axes": list(axes_of(stimuli.key)),
        "tasks": list(tasks),
        "participants": participants,
        "trials": len(trials),
        "level": settings.level,
        "full_scale": stimuli.full_scale,
        "attenuation_db": stimuli.attenuation_db,
        "rms_n": [float(stimuli.key["rms_n"].min()), float(stimuli.key["rms_n"].max())],
        "sampling_rate": stimuli.sampling_rate,
        "seconds": stimuli.textures.shape[-1] / stimuli.sampling_rate,
        "speed": None if math.isnan(stimuli.speed) else stimuli.speed,
        "package": __version__,
    }
    output.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=output.parent, prefix=f".{output.name}.") as temporary:
        whole = Path(temporary) / "study"
        _write(whole, stimuli, facts)
        if output.exists():
            output.rmdir()
        os.replace(whole, output)  # a study is whole or absent
    return Study(output, stimuli.key, facts)


def _write(folder, stimuli, facts):
    for name in (STIMULI, TRIALS, PRIVATE):
        (folder / name).mkdir(parents=True)
    write_stimuli(folder / STIMULI, stimuli)
    for number in range(1, facts["participants"] + 1):
        trials = participant_trials(stimuli.key, number, facts["seed"], facts["tasks"])
        write_csv(folder / TRIALS / f"participant_{number:03d}.csv", trials)
    write_csv(folder / KEY, stimuli.key)
    write_text(folder / PROTOCOL, protocol_markdown(facts))
    write_text(folder / SETTINGS, json.dumps(facts, indent=1, allow_nan=False) + "\n")


def protocol_markdown(settings):
    """protocol.md from experimenter/study.json: the stimuli, the instructions, and the columns of the files."""
    template = jinja2.Template(TEMPLATE.read_text(encoding="utf-8"), trim_blocks=True, keep_trailing_newline=True)
    conditions = ", ".join(map(label, settings["conditions"]))
    axes = settings["axes"]
    requests = {f"asked_{axis}": f"{axis} of the surface, z-score: the request" for axis in axes}
    tables = {"TRIAL_COLUMNS": TRIAL_COLUMNS, "KEY_COLUMNS": KEY_COLUMNS | requests}
    tables["ENDS"] = {axis: ends_of(axis) for axis in axes}
    folders = {"STIMULI": STIMULI, "TRIALS": TRIALS, "KEY": KEY, "PRIVATE": PRIVATE}
    return template.render(settings | tables | folders | {"conditions": conditions})


def read_answers(folder, responses, allow_missing=False):
    """The study in a folder, the answers in a folder of CSV files, and how many are missing: see `check_responses`.

    Raises:
        FileNotFoundError, ValueError: if the study or the responses are not there, or not what they should be.
    """
    study = read_study(folder)
    trials, responses = read_tables(study.folder / TRIALS), read_tables(responses)
    if responses["participant"].str.startswith(SIMULATED).all():  # they did the lists of the participants to come
        trials["participant"] = trials["participant"].str.replace(r"^p", SIMULATED, regex=True)
    answers, missing = check_responses(trials.drop(columns="file"), responses, allow_missing)
    return study, answers, missing
