"""The whole study: stimuli, key, trial lists and protocol in one folder."""

import json
import math
import os
import tempfile
from pathlib import Path

from ..data import PreparedDataset
from ..io.files import write_text
from ..signal.checks import check_whole_number
from ..version import __version__
from .folder import FORMAT, KEY, PRIVATE, PROTOCOL, SETTINGS, STIMULI, TRIALS, VERSION, Study, read_study, write_csv
from .protocol import protocol_markdown
from .responses import SIMULATED, check_responses, read_tables
from .stimuli import make_stimuli, write_stimuli
from .trials import TASKS, participant_trials, write_trials


def make_study(pipe, data, output, settings, participants=12, tasks=TASKS, checkpoint="", quiet=True):
    """Makes a study.

    Args:
        pipe (`TactileTexturePipeline`): with a DALE.
        data (`str` or `Path`): a prepared data set.
        output (`str` or `Path`): a folder that is absent or empty.
        settings (`StimulusSettings`): what is made.
        participants (`int`): trial lists to write.
        tasks (`Sequence[str]`): of `TASKS`.
        checkpoint (`str`): what the protocol calls the checkpoint.
        quiet (`bool`): no progress bars.

    Returns:
        `Study`

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
    write_trials(folder / TRIALS, stimuli.key, facts["participants"], facts["seed"], facts["tasks"])
    write_csv(folder / KEY, stimuli.key)
    write_text(folder / PROTOCOL, protocol_markdown(facts))
    write_text(folder / SETTINGS, json.dumps(facts, indent=1, allow_nan=False) + "\n")


def read_answers(folder, responses, allow_missing=False):
    """The study, its answers and how many are missing.

    Args:
        folder (`str` or `Path`): of the study.
        responses (`str` or `Path`): a folder of CSV files.
        allow_missing (`bool`): whether unanswered trials are left out, not refused.

    Returns:
        `tuple[Study, pandas.DataFrame, int]`: see `check_responses`.

    Raises:
        FileNotFoundError, ValueError: if the study or the responses are not there, or not what they should be.
    """
    study = read_study(folder)
    trials, responses = read_tables(study.folder / TRIALS), read_tables(responses)
    if responses["participant"].str.startswith(SIMULATED).all():  # they did the lists of the participants to come
        trials["participant"] = trials["participant"].str.replace(r"^p", SIMULATED, regex=True)
    answers, missing = check_responses(trials.drop(columns="file"), responses, allow_missing)
    return study, answers, missing
