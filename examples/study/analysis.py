"""Analysis of answers: ABX, similarity and ratings, with intervals over participants.

Each participant gives one number per measure and condition. The group's number is the mean over participants; its 95 %
interval is a bootstrap over participants, bias-corrected and accelerated (Efron 1987), with percentiles expanded for
few participants (Hesterberg 2015, "What teachers should know about the bootstrap"). It holds for these surfaces.

ABX follows the differencing model (Macmillan and Creelman, "Detection Theory: A User's Guide"; `dprime.ABX(method =
"diff")` of the R package psyphy). Two textures are Gaussian values of unit variance, d' apart; the observer compares X
with the middle between A and B:

    p(correct) = Phi(d'/sqrt 2) Phi(d'/sqrt 6) + Phi(-d'/sqrt 2) Phi(-d'/sqrt 6)
"""

import numpy as np
import pandas
from scipy import stats
from scipy.optimize import brentq
from scipy.special import ndtr

from tactile_diffusers.data import RaterScores, rating_reliability
from tactile_diffusers.evaluation.metrics.statistics import number

from .stimuli import OTHER_TAKE, REFERENCE, asked, axes_of
from .trials import ABX, OTHER_SURFACE, RATING, SIMILARITY, SIMULATED

FORMAT, VERSION = "tactile-study-report", 1
RESAMPLES = 4000
#: A bootstrap over fewer has nothing to draw from.
LEAST_PARTICIPANTS = 3
#: No larger sensitivity is looked for: there the observer is wrong once in 50 000 trials.
LARGEST_DPRIME = 10.0
#: A slope over fewer surfaces says nothing.
_LEAST_SURFACES = 3


def analyse(key, answers, missing=0, seed=0):
    """The report of a study.

    Args:
        key (`pandas.DataFrame`): of the study.
        answers (`pandas.DataFrame`): of `check_responses`.
        missing (`int`): trials that were not answered.
        seed (`int`): of the bootstrap.

    Returns:
        `dict`: JSON; leaves are over participants. "abx": condition -> leaves "proportion_correct", "dprime" (of the
        mean proportion) and "difference" (to another take); "abx_participants": participant -> condition -> numbers;
        "similarity": condition -> leaves "similarity" and "difference"; "ratings": condition -> axis -> leaves "slope"
        (answer units per requested z-score), "difference", "correlation" and the number "spread"; "reliability": axis
        -> numbers. A task that nobody did is None.

    Raises:
        ValueError: if there are no answers.
    """
    if answers.empty:
        raise ValueError("`answers` must hold one answer or more, got none.")
    answers = describe(key, answers)
    participants = sorted(answers["participant"].unique())
    return {
        "format": FORMAT,
        "version": VERSION,
        "simulated": bool(participants[0].startswith(SIMULATED)),
        "participants": len(participants),
        "answers": {task: int(count) for task, count in answers["task"].value_counts().sort_index().items()},
        "missing": int(missing),
        "seed": seed,
        "abx": _abx(answers, seed),
        "abx_participants": _abx_participants(answers),
        "similarity": _compared(similarity_scores(answers), "similarity", seed),
        "ratings": _ratings(answers, axes_of(key), seed),
        "reliability": _reliability(answers, axes_of(key)),
    }


def describe(key, answers):
    """Adds to answers the columns `condition`, `surface`, `correct` (ABX) and `asked` (requested ratings).

    The condition of a pair is that of the texture beside the reference; of two references it is "other_surface".
    """
    known = key.set_index("id")
    a, b = (answers[name].map(known["condition"]) for name in ("stimulus_a", "stimulus_b"))
    beside = a.where(a != REFERENCE, b)
    condition = beside.where((beside != REFERENCE) | (answers["task"] == RATING), OTHER_SURFACE)
    condition = condition.where(answers["task"] != RATING, a)
    x_is_a = answers["stimulus_x"].map(known["copy_of"]) == answers["stimulus_a"]
    correct = ((answers["response"] == "A") == x_is_a).astype(float).where(answers["task"] == ABX)
    rows = known.index.get_indexer(answers["stimulus_a"])
    columns = pandas.Index(axes_of(key)).get_indexer(answers["axis"])
    values = np.where(columns >= 0, asked(known)[rows, columns], np.nan)
    surface = answers["stimulus_a"].map(known["surface"])
    return answers.assign(condition=condition, surface=surface, correct=correct, asked=values)


def abx_scores(described):
    """Proportion correct: (participants, conditions)."""
    return _pivot(described[described["task"] == ABX], "correct")


def similarity_scores(described):
    """Mean similarity to the reference: (participants, conditions)."""
    return _pivot(described[described["task"] == SIMILARITY], "value")


def _pivot(answers, values):
    return answers.pivot_table(index="participant", columns="condition", values=values, aggfunc="mean", sort=False)


def rating_scores(described):
    """Regression of answers on requested ratings over surfaces: (participants, (measure, condition, axis)).

    Measures are "slope", in answer units per z-score, and "correlation" (Pearson), NaN for fewer than three surfaces.
    """
    rated = described[described["task"] == RATING]
    scores = {}
    for (participant, condition, axis), rows in rated.groupby(["participant", "condition", "axis"], sort=False):
        asked, answered = rows["asked"].to_numpy(), rows["value"].to_numpy()
        slope = correlation = np.nan
        if len(rows) >= _LEAST_SURFACES and np.ptp(asked) > 0:
            slope = np.cov(asked, answered)[0, 1] / np.var(asked, ddof=1)
            correlation = np.corrcoef(asked, answered)[0, 1] if np.ptp(answered) > 0 else np.nan
        scores.setdefault(participant, {}).update(
            {("slope", condition, axis): slope, ("correlation", condition, axis): correlation}
        )
    return pandas.DataFrame(scores).T


def bootstrap(values, seed=0):
    """Leaf of the mean of one number per participant, (participants,), NaN left out, with its 95 % interval.

    The interval is None for fewer than three participants.
    """
    values = np.asarray(values, dtype=np.float64)
    values = values[np.isfinite(values)]
    if not len(values):
        return number()
    interval = None
    if len(values) >= LEAST_PARTICIPANTS:
        interval = (values[0], values[0])  # all alike: nothing to resample
        if np.ptp(values) > 0:
            count = len(values)
            reach = np.sqrt(count / (count - 1)) * stats.t.ppf(0.975, count - 1)
            drawn = {"n_resamples": RESAMPLES, "random_state": np.random.default_rng(seed), "method": "BCa"}
            found = stats.bootstrap((values,), np.mean, confidence_level=2 * stats.norm.cdf(reach) - 1, **drawn)
            interval = found.confidence_interval
    return number(values.mean(), len(values), interval, values.min(), values.max(), np.median(values))


def _compared(scores, name, seed):
    """Leaves of each condition, and of its difference to another take of the surface, participant by participant."""
    if scores.empty:
        return None
    entries = {}
    for condition in scores:
        entries[condition] = {name: bootstrap(scores[condition], seed), "difference": number()}
        if OTHER_TAKE in scores and condition != OTHER_TAKE:
            entries[condition]["difference"] = bootstrap(scores[condition] - scores[OTHER_TAKE], seed)
    return entries


def _abx(answers, seed):
    entries = _compared(abx_scores(answers), "proportion_correct", seed)
    if entries is None:
        return None
    trials = answers[answers["task"] == ABX].groupby("condition").size()
    for condition, entry in entries.items():
        entry["trials"] = int(trials[condition])
        entry["dprime"] = dprime_leaf(entry["proportion_correct"], entry["trials"])
    return entries


def dprime_leaf(proportion, trials):
    """Leaf of d' of one observer with the group's proportion correct, limited as one of `trials` trials is.

    The mean of single participants' d' would depend on how many trials each did: d' bends, steeply so near chance.
    """
    bounds = proportion["interval"]
    interval = bounds and [_dprime(bound, trials) for bound in bounds]
    return number(_dprime(proportion["mean"], trials), proportion["n"], interval)


def _dprime(proportion, trials):
    return None if proportion is None else abx_dprime(min(max(proportion, 0.0), 1.0), trials)


def _abx_participants(answers):
    done = answers[answers["task"] == ABX]
    if done.empty:
        return None
    entries = {}
    for (participant, condition), correct in done.groupby(["participant", "condition"], sort=False)["correct"]:
        entries.setdefault(participant, {})[condition] = {
            "trials": len(correct),
            "proportion_correct": float(correct.mean()),
            "dprime": abx_dprime(correct.mean(), len(correct)),
        }
    return entries


def _ratings(answers, axes, seed):
    scores = rating_scores(answers)
    if scores.empty:
        return None
    answered = _answers_of_ratings(answers)
    entries = {}
    for condition in scores.columns.get_level_values(1).unique():
        entries[condition] = {}
        for axis in axes:
            if ("slope", condition, axis) not in scores:
                continue
            entry = {name: bootstrap(scores[name, condition, axis], seed) for name in ("slope", "correlation")}
            entry["difference"] = number()
            if condition != REFERENCE and ("slope", REFERENCE, axis) in scores:
                excess = scores["slope", condition, axis] - scores["slope", REFERENCE, axis]
                entry["difference"] = bootstrap(excess, seed)
            # of participants about one texture, averaged over textures
            spread = answered.loc[(condition, axis)].std(axis=1).mean()
            entries[condition][axis] = entry | {"spread": None if np.isnan(spread) else float(spread)}
    return entries


def _answers_of_ratings(answers):
    """Answers by (condition, axis, texture) and participant."""
    rated = answers[answers["task"] == RATING]
    return rated.pivot_table(index=["condition", "axis", "stimulus_a"], columns="participant", values="value")


def _reliability(answers, axes):
    """Agreement of participants over all textures: mean correlation of pairs and Cronbach's alpha of each axis."""
    rated = answers[answers["task"] == RATING]
    if rated.empty:
        return None
    participants, textures = sorted(rated["participant"].unique()), sorted(rated["stimulus_a"].unique())
    tables = [
        rated[rated["axis"] == axis]
        .pivot_table(index="participant", columns="stimulus_a", values="value")
        .reindex(index=participants, columns=textures)
        for axis in axes
    ]
    found = rating_reliability(RaterScores(np.stack(tables, -1), tuple(participants), tuple(textures), axes), axes)
    columns = (found.mean_correlation, found.alpha, found.pairs)
    return {
        axis: {"mean_correlation": _plain(r), "alpha": _plain(alpha), "pairs": int(pairs)}
        for axis, r, alpha, pairs in zip(axes, *columns, strict=True)
    }


def _plain(value):
    return float(value) if np.isfinite(value) else None


def abx_proportion_correct(dprime):
    """Proportion correct of an unbiased observer: float or array in [0.5, 1), of `dprime` >= 0 (likewise for < 0)."""
    first, second = np.asarray(dprime) / np.sqrt(2), np.asarray(dprime) / np.sqrt(6)
    return ndtr(first) * ndtr(second) + ndtr(-first) * ndtr(-second)


def abx_dprime(proportion_correct, trials=None):
    """Sensitivity from a proportion correct in [0, 1] (float or array; NaN stays NaN): at most `LARGEST_DPRIME`.

    A proportion below one half is a chance result: it gives the negative of what its mirror image gives. With `trials`,
    proportions are limited to 1 / (2 trials) from 0 and 1 (Macmillan and Kaplan 1985), so that d' is finite.

    Raises:
        ValueError: if a proportion is outside [0, 1].
    """
    proportion = np.asarray(proportion_correct, dtype=np.float64)
    outside = (proportion < 0) | (proportion > 1)
    if outside.any():
        raise ValueError(f"`proportion_correct` must be in [0, 1], got {proportion[outside].flat[0]}.")
    if trials is not None:
        margin = 1 / (2 * np.asarray(trials))
        proportion = np.clip(proportion, margin, 1 - margin)
    found = _solve(np.abs(proportion - 0.5) + 0.5) * np.sign(proportion - 0.5)
    return float(found) if found.ndim == 0 else found


@np.vectorize
def _solve(proportion):
    """The d' of one proportion correct of at least one half."""
    if np.isnan(proportion):
        return np.nan
    if proportion >= abx_proportion_correct(LARGEST_DPRIME):
        return LARGEST_DPRIME
    return brentq(lambda dprime: abx_proportion_correct(dprime) - proportion, 0.0, LARGEST_DPRIME)
