"""Simulated participants of known sensitivity, to try the analysis and the power of a design.

Nothing here is a result about people. Every spread is an assumption; those of ratings are of the virtual raters.
"""

from dataclasses import dataclass, field

import numpy as np
import pandas
from tqdm.auto import tqdm

from tactile_diffusers.signal import RATING_AXES
from tactile_diffusers.signal.checks import check_number, check_whole_number
from tactile_diffusers.virtual.raters import DISAGREEMENT, GAIN_SPREAD, OFFSET_SPREAD, TYPICAL_GAIN

from .analysis import abx_scores, bootstrap, describe, rating_scores, similarity_scores
from .stimuli import GENERATED, OTHER_TAKE, RECONSTRUCTED, REFERENCE, axes_of
from .trials import (
    ABX,
    OTHER_SURFACE,
    RATING,
    SCALES,
    SIMILARITY,
    SIMULATED,
    TASKS,
    check_responses,
    participant_trials,
)

#: d' from the reference take, assumed for a rehearsal; a baseline has that of `BASELINE_DPRIME`.
DPRIME = {OTHER_TAKE: 0.5, RECONSTRUCTED: 0.8, GENERATED: 1.5, OTHER_SURFACE: 4.0}
BASELINE_DPRIME = 2.0
#: Share of the surface's rating that is felt; a baseline has that of `BASELINE_RATING_SHARE`.
RATING_SHARE = {REFERENCE: 1.0, OTHER_TAKE: 1.0, RECONSTRUCTED: 0.9, GENERATED: 0.6}
BASELINE_RATING_SHARE = 0.2
#: Points of similarity that each unit of d' costs, from the top of the scale, before noise.
SIMILARITY_PER_DPRIME = 18.0


@dataclass(frozen=True)
class Population:
    """A population of simulated participants."""

    dprime: dict = field(default_factory=dict)  # condition -> sensitivity to its difference from the reference
    rating_share: dict = field(default_factory=dict)  # condition -> share of the requested rating that is felt
    dprime_spread: float = 0.25  # over participants, of the logarithm of a factor on every d'
    similarity_noise: float = 12.0  # of each answer, points
    rating_gain: float = TYPICAL_GAIN  # answer units per z-score of a typical participant
    rating_gain_spread: float = GAIN_SPREAD  # over participants and axes, of the log gain
    rating_offset: float = OFFSET_SPREAD  # over participants and axes
    rating_noise: float = 1.0  # factor on the virtual raters' disagreement about a texture

    def __post_init__(self):
        for condition, value in self.dprime.items():
            check_number(f"dprime[{condition!r}]", value, at_least=0)
        for condition, value in self.rating_share.items():
            check_number(f"rating_share[{condition!r}]", value)

    def check(self, conditions):
        """Raises a ValueError for a condition that no texture of a study has."""
        compared = {*conditions, OTHER_SURFACE} - {REFERENCE}
        for name, known in (("dprime", compared), ("rating_share", set(conditions))):
            unknown = sorted(set(getattr(self, name)) - known)
            if unknown:
                raise ValueError(f"`{name}` names {unknown[0]!r}, it must be one of {sorted(known)}.")

    def dprime_of(self, condition):
        return {**DPRIME, **self.dprime}.get(condition, BASELINE_DPRIME)

    def rating_share_of(self, condition):
        return {**RATING_SHARE, **self.rating_share}.get(condition, BASELINE_RATING_SHARE)


def simulate(key, trials, population, rng):
    """Fills in the responses of simulated participants: the trial lists with `response`, strings.

    ABX: A, B and X are drawn in each trial from Gaussians of unit variance, 0 and d' for the two textures, and decided
    by the differencing model (`analysis.py`). Similarity falls by `SIMILARITY_PER_DPRIME` points a d', with noise.
    Ratings are the surface's rating times the share that is felt, plus noise, times the gain, plus the offset, rounded.

    Args:
        key (`pandas.DataFrame`): of the study.
        trials (`pandas.DataFrame`): lists of one participant or more.
        population (`Population`): whom the participants are drawn from.
        rng (`np.random.Generator`): draws everything.
    """
    described = describe(key, trials.assign(value=np.nan))
    person, names = pandas.factorize(trials["participant"])
    noise = rng.standard_normal((len(trials), 3))
    sensitivity = np.exp(population.dprime_spread * rng.standard_normal(len(names)))[person]
    dprime = sensitivity * described["condition"].map(population.dprime_of).to_numpy()
    likeness = SCALES[SIMILARITY][1] - SIMILARITY_PER_DPRIME * dprime
    answers = {
        ABX: _abx(key, trials, dprime, noise),
        SIMILARITY: _whole(likeness + population.similarity_noise * noise[:, 0], SIMILARITY),
        RATING: _whole(_perceived(described, axes_of(key), population, person, noise[:, 0], rng), RATING),
    }
    tasks = [(trials["task"] == task).to_numpy() for task in answers]
    return trials.assign(response=np.select(tasks, list(answers.values()), default=""))


def _abx(key, trials, dprime, noise):
    """A or B by the differencing model, for every row; what is not ABX gets an answer that is not used."""
    conditions, originals = (key.set_index("id")[name] for name in ("condition", "copy_of"))
    played = (trials["stimulus_a"], trials["stimulus_b"], trials["stimulus_x"].map(originals))
    changed = np.stack([stimulus.map(conditions) != REFERENCE for stimulus in played], axis=-1)
    a, b, x = (dprime[:, None] * changed + noise).T
    return np.where((x - (a + b) / 2) * (a - b) > 0, "A", "B")


def _perceived(described, axes, population, person, noise, rng):
    """Ratings before rounding, for every row; NaN where nothing is rated."""
    shape = (person.max() + 1, len(axes))
    gains = population.rating_gain * np.exp(population.rating_gain_spread * rng.standard_normal(shape))
    offsets = population.rating_offset * rng.standard_normal(shape)
    axis = pandas.Index(axes).get_indexer(described["axis"])  # -1 where nothing is rated
    disagreement = pandas.Series(DISAGREEMENT, RATING_AXES).reindex(axes, fill_value=DISAGREEMENT.mean()).to_numpy()
    rating_share = described["condition"].map(population.rating_share_of).to_numpy()
    perceived = rating_share * described["asked"].to_numpy() + population.rating_noise * disagreement[axis] * noise
    return np.mean(SCALES[RATING]) + offsets[person, axis] + gains[person, axis] * perceived


def _whole(values, task):
    """Rounded and clipped to the task's scale, as strings."""
    return np.array([f"{value:.0f}" for value in np.clip(np.round(values), *SCALES[task])])


def simulated_trials(key, participants, seed, tasks=TASKS):
    """Trial lists of simulated participants: those of participants 1, 2, ... under names that say what they are."""
    names = {number: f"{SIMULATED}{number:03d}" for number in range(1, participants + 1)}
    lists = [participant_trials(key, number, seed, tasks, name) for number, name in names.items()]
    return pandas.concat(lists, ignore_index=True)


def simulate_participants(key, participants, seed, population, tasks=TASKS):
    """Trial lists of simulated participants with their responses, columns `TRIAL_COLUMNS`; arguments as in `power`."""
    population.check(set(key["condition"]))
    trials = simulated_trials(key, participants, seed, tasks)
    return simulate(key, trials, population, np.random.default_rng([seed, 5]))


def power(key, participants, seed, population, tasks=TASKS, repeats=100, quiet=True):
    """How often a design would find what the population has.

    Args:
        key (`pandas.DataFrame`): of the study.
        participants (`int`): how many.
        seed (`int`): of the study.
        population (`Population`): whom they are drawn from.
        tasks (`Sequence[str]`): of `TASKS`.
        repeats (`int`): simulated studies, with other participants each.
        quiet (`bool`): no progress bar.

    Returns:
        `dict[str, dict]`: measure -> condition (for slopes: "condition: axis") -> share of the studies whose 95 %
        interval leaves out what there is if there is nothing to find.

    Raises:
        ValueError: if `repeats` is below 1 or the population names conditions that the study has not.
    """
    check_whole_number("repeats", repeats)
    population.check(set(key["condition"]))
    trials, found = simulated_trials(key, participants, seed, tasks), {}
    for repeat in tqdm(range(1, repeats + 1), desc="simulated studies", disable=quiet):
        done = simulate(key, trials, population, np.random.default_rng([seed, 5, repeat]))
        answers, _ = check_responses(trials, done)
        for place, excess in _excesses(describe(key, answers)).items():
            interval = bootstrap(excess, repeat)["interval"]
            found.setdefault(place, []).append(interval is not None and not interval[0] <= 0 <= interval[1])
    power = {}
    for (measure, *condition), hits in found.items():
        power.setdefault(measure, {})[": ".join(condition)] = float(np.mean(hits))
    return power


def _excesses(described):
    """What is zero if there is nothing to find, one number per participant: (measure, condition[, axis]) -> values."""
    abx, similarity, ratings = abx_scores(described), similarity_scores(described), rating_scores(described)
    excesses = {("abx_above_chance", name): abx[name] - 0.5 for name in abx}
    for measure, scores in (("abx", abx), ("similarity", similarity)):
        for name in scores:
            if name != OTHER_TAKE and OTHER_TAKE in scores:
                excesses[f"{measure}_unlike_other_take", name] = scores[name] - scores[OTHER_TAKE]
    for measure, condition, axis in ratings:
        if measure == "slope":
            excesses["slope_unlike_zero", condition, axis] = ratings[measure, condition, axis]
    return excesses
