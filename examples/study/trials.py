"""Trial lists and their answers: three tasks, in a random, balanced order that depends on the participant's number.

ABX: A and B are the reference take of a surface and another texture of it; X is one of the two again. Each pair comes
four times, once in each arrangement (which of the two is A, which is X), in four blocks that hold every pair once.
Similarity: the same pairs once each, and each reference with that of another surface, the low end of the scale.
Ratings: every texture once, on each axis.
"""

import warnings
from itertools import permutations
from pathlib import Path

import numpy as np
import pandas

from tactile_diffusers.io.reading import reading
from tactile_diffusers.signal.rating_scales import RATING_SCALE

from .stimuli import REFERENCE, axes_of

ABX, SIMILARITY, RATING = TASKS = ("abx", "similarity", "rating")
#: The pair of two references, of different surfaces.
OTHER_SURFACE = "other_surface"
SCALES = {SIMILARITY: (0.0, 100.0), RATING: tuple(map(float, RATING_SCALE))}
#: What the ends of each axis are called: 0 and 8.
ENDS = {"roughness": ("smooth", "rough"), "bumpiness": ("even", "bumpy"), "slipperiness": ("sticky", "slippery")}


def ends_of(axis):
    """What 0 and 8 are called on an axis."""
    return ENDS.get(axis, (f"no {axis}", f"much {axis}"))


#: Columns of a trial list and what they hold; a response file is a trial list with the last column filled in.
TRIAL_COLUMNS = {
    "participant": "p and the participant's number",
    "trial": "1, 2, ... in the order in which they are done",
    "task": "abx, similarity or rating",
    "stimulus_a": "played first; the only one of a rating",
    "stimulus_b": "played second (abx, similarity)",
    "stimulus_x": "played third (abx)",
    "axis": "what is rated (rating)",
    "response": "abx: A or B; similarity: 0 to 100; rating: 0 to 8, to be filled in",
}
_NEEDED = ("participant", "trial", "response")
#: Participants that a program played are called so, and are never mixed with others.
SIMULATED = "simulated"
#: Which is A and which is X: (the reference is A, the reference is X).
_ARRANGEMENTS = ((True, True), (True, False), (False, True), (False, False))


def participant_trials(key, number, seed, tasks=TASKS, name=None):
    """The trial list of one participant: columns `TRIAL_COLUMNS`; what does not apply, and every response, is "".

    Tasks rotate over participants, and so do the orders of the axes, which stay the same for one participant.

    Args:
        key (`pandas.DataFrame`): of the study.
        number (`int`): of the participant, 1 or more.
        seed (`int`): of the study.
        tasks (`Sequence[str]`): of `TASKS`.
        name (`str`, *optional*): of the participant; defaults to p and the number.

    Raises:
        ValueError: if a task is unknown or given twice, or `number` is below 1.
    """
    unknown = [task for task in tasks if task not in TASKS]
    if unknown or not tasks or len(set(tasks)) < len(tasks):
        raise ValueError(f"`tasks` must be different ones of {TASKS}, got {tuple(tasks)}.")
    if number < 1:
        raise ValueError(f"`number` must be at least 1, got {number}.")
    rng = np.random.default_rng([seed, 4, number])
    make = {ABX: _abx, SIMILARITY: _similarity, RATING: _rating}
    trials_of = {task: make[task](key, number, rng) for task in TASKS}  # tasks left out change nothing of the others
    first = (number - 1) % len(tasks)
    rows = [{"task": task, **row} for task in (*tasks[first:], *tasks[:first]) for row in trials_of[task]]
    empty = dict.fromkeys(TRIAL_COLUMNS, "") | {"participant": name or participant_name(number)}
    return pandas.DataFrame([{**empty, "trial": trial, **row} for trial, row in enumerate(rows, 1)])


def participant_name(number):
    """Name of a participant by number: p001."""
    return f"p{number:03d}"


def pairs_of(key):
    """Ids of pairs to compare with the reference of their surface: columns surface, condition, reference, other."""
    originals = key[key["copy_of"] == ""].sort_values("id")  # whatever the order of the key
    references = originals[originals["condition"] == REFERENCE].set_index("surface")["id"]
    others = originals[originals["condition"] != REFERENCE]
    pairs = others[["surface", "condition"]].assign(other=others["id"])
    return pairs.assign(reference=pairs["surface"].map(references)).reset_index(drop=True)


def _abx(key, number, rng):
    references, others = pairs_of(key)[["reference", "other"]].to_numpy().T
    copies = key[key["copy_of"] != ""].set_index("copy_of")["id"].to_dict()
    count, kinds = len(references), len(_ARRANGEMENTS)
    first, order = rng.permutation(count) % kinds, rng.permutation(kinds)
    rows = []
    for block in range(kinds):
        for pair in rng.permutation(count):
            reference_first, reference_again = _ARRANGEMENTS[order[(first[pair] + block) % kinds]]
            both = (references[pair], others[pair])
            a, b = both if reference_first else both[::-1]
            rows.append({"stimulus_a": a, "stimulus_b": b, "stimulus_x": copies[both[0 if reference_again else 1]]})
    return rows


def _similarity(key, number, rng):
    pairs = pairs_of(key)[["reference", "other"]].to_numpy()
    around = rng.permutation(np.unique(pairs[:, 0]))  # each with the next one: every reference twice
    pairs = np.concatenate([pairs, np.stack([around, np.roll(around, -1)], axis=-1)])
    turned = rng.permutation(len(pairs)) % 2 == 0
    pairs[turned] = pairs[turned, ::-1]
    return [{"stimulus_a": a, "stimulus_b": b} for a, b in rng.permutation(pairs)]


def _rating(key, number, rng):
    axes = axes_of(key)
    # with more axes a Latin square: each comes once in each place
    orders = list(permutations(axes)) if len(axes) < 4 else [axes[k:] + axes[:k] for k in range(len(axes))]
    axes = orders[(number - 1) % len(orders)]
    ids = rng.permutation(np.sort(key.loc[key["copy_of"] == "", "id"].to_numpy(str)))
    return [{"stimulus_a": stimulus, "axis": axis} for stimulus in ids for axis in axes]


def read_tables(folder):
    """All CSV files of a folder, trial lists or responses, as one table of stripped strings, with the column `file`.

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
        `tuple[pandas.DataFrame, int]`: the answered trials with `response`, in capitals for ABX, and `value`, the
        number of an answer on a scale, NaN for ABX; and how many trials were not answered.

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
