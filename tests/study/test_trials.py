"""Trial lists: complete, balanced, the same for the same number, and silent about what is what."""

from itertools import permutations

import numpy as np
import pytest
from study import TASKS, participant_trials
from study.trials import TRIAL_COLUMNS

from tactile_diffusers.signal import RATING_AXES


def test_every_pair_comes_in_every_arrangement(key):
    trials = participant_trials(key, 1, seed=0)
    assert list(trials) == list(TRIAL_COLUMNS) and (trials["response"] == "").all()
    assert trials["trial"].tolist() == list(range(1, len(trials) + 1))
    abx = trials[trials["task"] == "abx"]
    condition, copy_of = (dict(zip(key["id"], key[name], strict=True)) for name in ("condition", "copy_of"))
    surface = dict(zip(key["id"], key["surface"], strict=True))
    seen = set()
    for row in abx.itertuples():
        reference_first = condition[row.stimulus_a] == "reference"
        other = row.stimulus_b if reference_first else row.stimulus_a
        assert condition[row.stimulus_b if not reference_first else row.stimulus_a] == "reference"
        assert surface[row.stimulus_a] == surface[row.stimulus_b]
        assert copy_of[row.stimulus_x] in (row.stimulus_a, row.stimulus_b)
        seen.add((other, reference_first, copy_of[row.stimulus_x] == row.stimulus_a))
    assert len(seen) == len(abx) == 4 * 6 * 4  # arrangements, surfaces, conditions beside the reference
    # four blocks of every pair once, arrangements in each as frequent as can be
    for block in range(4):
        rows = abx.iloc[24 * block : 24 * (block + 1)]
        assert len({frozenset((r.stimulus_a, r.stimulus_b)) for r in rows.itertuples()}) == 24
        assert sum(condition[a] == "reference" for a in rows["stimulus_a"]) == 12


def test_similarity_and_ratings_are_complete(key):
    trials = participant_trials(key, 2, seed=0)
    condition = dict(zip(key["id"], key["condition"], strict=True))
    pairs = trials[trials["task"] == "similarity"]
    first, second = (pairs[name].map(condition) for name in ("stimulus_a", "stimulus_b"))
    both = (first == "reference") & (second == "reference")
    assert len(pairs) == 6 * 4 + 6 and both.sum() == 6
    surface = dict(zip(key["id"], key["surface"], strict=True))
    assert (pairs["stimulus_a"].map(surface) != pairs["stimulus_b"].map(surface))[both].all()
    assert abs((first == "reference")[~both].sum() - 12) <= 3  # balanced over all 30 pairs, not over these 24
    rated = trials[trials["task"] == "rating"]
    originals = set(key.loc[key["copy_of"] == "", "id"])
    assert set(zip(rated["stimulus_a"], rated["axis"], strict=True)) == {(i, a) for i in originals for a in RATING_AXES}
    assert len(rated) == 3 * len(originals)


def test_tasks_and_axes_change_places(key):
    orders, axes = set(), set()
    for number in range(1, 7):
        trials = participant_trials(key, number, seed=0)
        orders.add(tuple(trials["task"].unique()))
        axes.add(tuple(trials.loc[trials["task"] == "rating", "axis"].unique()))
    assert orders == {TASKS, (*TASKS[1:], TASKS[0]), (TASKS[2], *TASKS[:2])}
    assert axes == set(permutations(RATING_AXES))


def test_the_same_number_gets_the_same_list(key):
    first = participant_trials(key, 4, seed=7)
    assert first.equals(participant_trials(key, 4, seed=7))
    assert not first.equals(participant_trials(key, 5, seed=7).assign(participant="p004"))
    assert not first.equals(participant_trials(key, 4, seed=8))


def test_a_task_left_out_changes_nothing_of_the_others(key):
    whole, part = participant_trials(key, 1, seed=0), participant_trials(key, 1, seed=0, tasks=["rating"])
    kept = whole[whole["task"] == "rating"]
    np.testing.assert_array_equal(kept[["stimulus_a", "axis"]], part[["stimulus_a", "axis"]])


@pytest.mark.parametrize("tasks", [[], ["abx", "abx"], ["abx", "taste"]])
def test_bad_tasks_are_refused(key, tasks):
    with pytest.raises(ValueError, match="`tasks` must be different ones"):
        participant_trials(key, 1, 0, tasks)
