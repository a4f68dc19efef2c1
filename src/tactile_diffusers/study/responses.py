"""Answers of participants: read from CSV files and checked against the trial lists."""

import warnings
from pathlib import Path

import numpy as np
import pandas

from ..io.reading import reading
from .trials import ABX, SCALES, TRIAL_COLUMNS

_NEEDED = ("participant", "trial", "response")
#: Participants that a program played are called so, and are never mixed with others.
SIMULATED = "simulated"


def read_tables(folder):
    """All CSV files of a folder as one table of stripped strings, with the column `file`.

    Args:
        folder (`str` or `Path`): of trial lists or of responses.

    Returns:
        `pandas.DataFrame`

    Raises:
        FileNotFoundError: if there is no CSV file.
        ValueError: if a file is no table with the columns participant, trial and response.
    """
    # what begins with a point is of a file system: "._p001.csv" of a Mac's on a stick
    files = sorted(path for path in Path(folder).glob("*.csv") if not path.name.startswith("."))
    if not files:
        raise FileNotFoundError(f"There is no .csv file in {folder}: put trial lists there, with responses filled in.")
    return pandas.concat([_read_table(path) for path in files], ignore_index=True)


def _read_table(path):
    with reading(path, "a table of comma-separated values, UTF-8", "Export it again."), warnings.catch_warnings():
        warnings.simplefilter("ignore", pandas.errors.ParserWarning)  # of cells that have no name
        # spreadsheets put a mark before UTF-8, a comma after each line, and empty cells below the last one
        table = pandas.read_csv(path, dtype=str, keep_default_na=False, encoding="utf-8-sig", index_col=False)
    table = table[(table != "").any(axis=1)]
    missing = [column for column in _NEEDED if column not in table]
    if missing:
        raise ValueError(
            f"{path} lacks the columns {missing} (it has {list(table)}): fill in the column `response` of the trial "
            "list and export it with commas."
        )
    return table.apply(lambda column: column.str.strip()).assign(file=path.name)


def check_responses(trials, responses, allow_missing=False):
    """Joins answers with their trials, and refuses those that do not belong there.

    Args:
        trials (`pandas.DataFrame`): trial lists, columns `TRIAL_COLUMNS`.
        responses (`pandas.DataFrame`): of `read_tables`: participant, trial, response; other columns of the trial list
            are compared where they are there.
        allow_missing (`bool`): whether unanswered trials are left out, not refused.

    Returns:
        `tuple[pandas.DataFrame, int]`: the answered trials with `response` as it was given, in capitals for ABX, and
        `value`, the number of an answer on a scale, NaN for ABX; and how many trials were not answered.

    Raises:
        ValueError: on unknown participants, trials or ids, answers that are given twice, missing or outside of the
            scale, and simulated participants among others. The message names file, participant and trial.
    """
    responses = responses.copy()
    simulated = responses["participant"].str.startswith(SIMULATED)
    if simulated.any() and not simulated.all():
        raise ValueError(
            f"The responses of {_where(responses[simulated].iloc[0])} are simulated, others are not. Keep them apart."
        )
    _refuse(responses, ~responses["participant"].isin(trials["participant"]), "participants without a trial list")
    number = pandas.to_numeric(responses["trial"], errors="coerce")
    trial_keys = pandas.MultiIndex.from_frame(trials[["participant", "trial"]].astype({"trial": float}))
    rows = pandas.MultiIndex.from_arrays([responses["participant"], number])
    _refuse(responses, ~rows.isin(trial_keys), "trials that are not in the participant's list")
    _refuse(responses, rows.duplicated(), "trials that are answered twice")

    planned = trials.set_index(trial_keys).reindex(rows)
    for column in TRIAL_COLUMNS:
        if column in responses and column not in _NEEDED:
            changed = responses[column].to_numpy() != planned[column].to_numpy()
            _refuse(responses, changed, f"another `{column}` than in the trial list")
    task, answer = planned["task"].to_numpy(), responses["response"].str.upper()
    value = pandas.to_numeric(answer, errors="coerce").where(task != ABX)
    answered = (answer != "").to_numpy()
    _refuse(responses, answered & (task == ABX) & ~answer.isin(["A", "B"]), "an answer to ABX that is not A or B")
    for scaled, (low, high) in SCALES.items():
        bad = answered & (task == scaled) & ~value.between(low, high)
        _refuse(responses, bad, f"an answer to {scaled} that is no number from {low:g} to {high:g}")

    taking_part = trials["participant"].isin(responses["participant"]).to_numpy()
    unanswered = trials[taking_part & ~trial_keys.isin(rows[answered])]
    if len(unanswered) and not allow_missing:
        first = unanswered.iloc[0]
        raise ValueError(
            f"{len(unanswered)} trials are not answered, first {first['participant']}, trial {first['trial']}. "
            "Complete them, or allow missing answers, which leaves them out."
        )
    made = planned.reset_index(drop=True).assign(response=answer.to_numpy(), value=value.to_numpy(np.float64))
    return made[answered].reset_index(drop=True), len(unanswered)


def _refuse(responses, bad, what):
    """Raises for the first row of a mask."""
    bad = np.asarray(bad)
    if bad.any():
        row = responses[bad].iloc[0]
        raise ValueError(f"Responses hold {what}: {_where(row)}, response {row['response']!r} ({bad.sum()} such rows).")


def _where(row):
    return f"{row.get('file', 'table')}, participant {row['participant']}, trial {row['trial']}"
