"""Trial lists: three tasks, each in a random, balanced order that depends on the participant's number.

ABX: A and B are the reference take of a surface and another texture of it; X is one of the two again. Each pair comes
four times, once in each arrangement (which of the two is A, which is X), in four blocks that hold every pair once, and
in which arrangements are as equally frequent as can be.
Similarity: the same pairs once each, and each reference with that of another surface, the low end of the scale.
Ratings: every texture once, on each axis.
"""

from itertools import permutations

import numpy as np
import pandas

from ..signal import RATING_AXES
from ..signal.rating_scales import RATING_SCALE
from .folder import write_csv
from .stimuli import REFERENCE

ABX, SIMILARITY, RATING = TASKS = ("abx", "similarity", "rating")
#: The pair of two references, of different surfaces.
OTHER_SURFACE = "other_surface"
SCALES = {SIMILARITY: (0.0, 100.0), RATING: tuple(map(float, RATING_SCALE))}
#: What the ends of each axis are called: 0 and 8.
ENDS = {"roughness": ("smooth", "rough"), "bumpiness": ("even", "bumpy"), "slipperiness": ("sticky", "slippery")}
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
#: Which is A and which is X: (the reference is A, the reference is X).
_ARRANGEMENTS = ((True, True), (True, False), (False, True), (False, False))


def participant_trials(key, number, seed, tasks=TASKS, name=None):
    """The trial list of one participant.

    Tasks rotate over participants, and so do the six orders of the axes, which stay the same for one participant.

    Args:
        key (`pandas.DataFrame`): of the study.
        number (`int`): of the participant, 1 or more.
        seed (`int`): of the study.
        tasks (`Sequence[str]`): of `TASKS`.
        name (`str`, *optional*): of the participant; defaults to p and the number.

    Returns:
        `pandas.DataFrame`: columns `TRIAL_COLUMNS`; what does not apply, and every response, is an empty string.

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
    made = {task: make[task](key, number, rng) for task in TASKS}  # tasks left out change nothing of the others
    first = (number - 1) % len(tasks)
    rows = [{"task": task, **row} for task in (*tasks[first:], *tasks[:first]) for row in made[task]]
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
    orders = list(permutations(RATING_AXES))
    axes = orders[(number - 1) % len(orders)]
    ids = rng.permutation(np.sort(key.loc[key["copy_of"] == "", "id"].to_numpy(str)))
    return [{"stimulus_a": stimulus, "axis": axis} for stimulus in ids for axis in axes]


def write_trials(folder, key, participants, seed, tasks=TASKS):
    """Writes the trial lists of participants 1, 2, ... as `participant_001.csv` and so on.

    Args:
        folder (`Path`): exists.
        key (`pandas.DataFrame`): of the study.
        participants (`int`): how many.
        seed (`int`): of the study.
        tasks (`Sequence[str]`): of `TASKS`.
    """
    for number in range(1, participants + 1):
        write_csv(folder / f"participant_{number:03d}.csv", participant_trials(key, number, seed, tasks))
