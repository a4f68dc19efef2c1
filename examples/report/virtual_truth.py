"""The truth of requests to a model of virtual surfaces, from fresh surfaces of the same collection.

Ratings of virtual surfaces are cheap, their textures are not: importance sampling with self-normalised weights.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from tqdm.auto import tqdm

from tactile_diffusers.data import HoldOut, PreparedDataset, SegmentLimits
from tactile_diffusers.evaluation.truth import CHUNK, RatedTextures, joined, log_kernel, recorded_truth
from tactile_diffusers.signal.checks import check_whole_number
from tactile_diffusers.signal.constants import VIRTUAL_SOURCE
from tactile_diffusers.virtual import RECIPE_VERSION, Collection, VirtualSurface

from .baselines import TrainingTextures
from .fresh import FIRST_FRESH, fresh_ratings, fresh_textures


def draw_surfaces(ratings, requests, count, seed=0):
    """Draws `count` of the candidates, rated (candidates, 3) z-scores, so that each of `requests` gets as many on
    average.

    With replacement. Returns the distinct surfaces in ascending order, and their importance: draws over probability.
    """
    probability = np.zeros(len(ratings))
    for request in requests:
        logs = log_kernel(ratings, request)
        weights = np.exp(logs - logs.max())
        probability += weights / weights.sum() / len(requests)
    # rounding must not keep the sum from 1, which numpy insists on
    draws = np.random.default_rng(seed).multinomial(count, probability / probability.sum())
    drawn = np.flatnonzero(draws)
    return drawn, draws[drawn] / probability[drawn]


def virtual_truth(
    dataset,
    requests,
    describe,
    surfaces=1500,
    candidates=20000,
    seconds=12.0,
    per_surface=2,
    seed=0,
    workers=1,
    quiet=True,
):
    """The truth of requests to a model of virtual surfaces, which are explored afresh: `RatedTextures`.

    Surfaces, explorers and raters are like those of the ordinary splits, or of "hard" if `dataset` is that. Training
    surfaces set the units of the ratings. `surfaces` are drawn for `requests`, (3,) ratings each, from `candidates`
    fresh ones; one that is drawn twice is explored once and counts twice. A surface whose first recordings, `seconds`
    each, hold no segment is explored once more, then dropped. `describe` takes some hundreds of textures (k, samples)
    float32 in N, levels and friction coefficients (k,), and returns the measures, a dict of arrays (k, ...). `workers`
    are threads; the result is the same.

    A ValueError if `dataset` is none of virtual surfaces or of another recipe, not at its native rate, or an argument
    is out of range.
    """
    facts = _check_virtual(dataset, requests, surfaces, per_surface)
    ratings = _rated(dataset, candidates)
    met = _met_candidates(facts, candidates, dataset.split == "hard")
    drawn, importance = draw_surfaces(ratings[met], requests, surfaces, seed)
    drawn = met[drawn]
    settings = _settings(dataset, seconds, per_surface)
    counts, measures = _explore_and_describe(drawn + FIRST_FRESH, describe, settings, workers, quiet)
    kept = counts > 0
    if not kept.any():
        raise ValueError(
            f"No fresh surface has a segment within {settings['limits']} in {seconds} s: explore for longer."
        )
    surface_ids = np.repeat(np.arange(kept.sum()), counts[kept])
    return RatedTextures(joined(measures), surface_ids, ratings[drawn[kept]], importance[kept], int(np.sum(~kept)))


def fresh_training(dataset, surfaces, after, seconds=12.0, per_surface=2, workers=1, quiet=True):
    """`TrainingTextures` of so many fresh surfaces, those beyond the first `after`: more than a file holds.

    Explored, and refused, as by `virtual_truth`; of what that draws from no more than `after` candidates, none is here.
    """
    _check_virtual(dataset, [()], surfaces, per_surface)
    counts, made = _explore_and_describe(
        FIRST_FRESH + after + np.arange(surfaces),
        lambda textures, levels, frictions: {"textures": textures, "frictions": frictions},
        *(_settings(dataset, seconds, per_surface), workers, quiet),
    )
    made, ids = joined(made), np.repeat(np.arange(surfaces), counts)
    ratings = _rated(dataset, after + surfaces)[after:][ids]
    return TrainingTextures(made["textures"], ratings, made["frictions"], ids, dataset.sampling_rate, dataset.band)


def _rated(dataset, candidates):
    """Ratings of the first so many fresh surfaces, (candidates, axes) z-scores in units of the training surfaces."""
    facts = dataset.attributes
    training = np.unique(PreparedDataset(dataset.path, "train", "full").surface_ids)
    numbers = [int(dataset.surfaces[surface].split("-")[0]) for surface in training]
    collection = Collection.from_attributes(facts)
    names = [f"rater-{number}" for number in range(collection.raters)]
    asked = _people(facts, "raters", names, dataset.split == "hard")
    ratings = fresh_ratings(candidates, collection, training=numbers, raters=asked)
    return ratings[:, [collection.rating_axes.index(axis) for axis in dataset.ratings.axes]]


def _settings(dataset, seconds, per_surface):
    """Keyword arguments of `fresh_textures`, as the data set was explored and prepared."""
    facts, names = dataset.attributes, sorted({name.split("/")[1] for name in dataset.recordings})
    limits = SegmentLimits(**facts["limits"])
    return dict(
        collection=Collection.from_attributes(facts),
        explorers=_people(facts, "explorers", names, dataset.split == "hard"),
        seconds=seconds,
        limits=limits if dataset.subset == "filtered" else limits.without_conditions(),
        band=dataset.band,
        turnarounds=facts["turnarounds"],
        per_surface=per_surface,
    )


def _explore_and_describe(numbers, describe, settings, workers, quiet):
    """Number of textures of each surface, (surfaces,), and the measures of `describe`, a list of dicts."""

    def explore(number):
        first = fresh_textures(number, trial=0, **settings)
        return first if len(first[0]) else fresh_textures(number, trial=1, **settings)

    step = max(1, CHUNK // settings["per_surface"])
    counts, measures = [], []
    bar = tqdm(total=len(numbers), desc="truth", unit="surface", disable=quiet)
    with bar, ThreadPoolExecutor(workers) as pool:
        for start in range(0, len(numbers), step):
            explored = list(pool.map(explore, numbers[start : start + step]))
            counts += [len(textures) for textures, *_ in explored]
            textures, friction, levels, _ = (np.concatenate(column) for column in zip(*explored, strict=True))
            if len(textures):
                measures.append(describe(textures, levels, friction))
            bar.update(len(explored))
    return np.array(counts), measures


def _people(facts, kind, names, hard):
    """Numbers of the raters or explorers of a split, from names such as "rater-3"."""
    return [int(name.rsplit("-", 1)[1]) for name, met in zip(names, _met(facts, kind, names, hard), strict=True) if met]


def _met_candidates(facts, candidates, hard):
    """Which of the fresh surfaces are of classes of a split: (n,) int64."""
    if not facts["hold_out"] or not facts["hold_out"]["surfaces"]:
        return np.arange(candidates)
    names = [VirtualSurface(facts["seed"], FIRST_FRESH + number).name for number in range(candidates)]
    return np.flatnonzero(_met(facts, "surfaces", names, hard))


def _met(facts, kind, names, hard):
    """Which names belong to a split: those that are not held out, or in "hard" those that are, if any are."""
    held = HoldOut(**facts["hold_out"]).held(kind, names) if facts["hold_out"] else np.zeros(len(names), bool)
    return held | (not held.any()) if hard else ~held


def _check_virtual(dataset, requests, surfaces, per_surface):
    """The file's attributes, once they are known to describe a collection that can be continued."""
    facts = dataset.attributes
    if not can_be_continued(dataset):
        made = f"{facts['source']!r}, recipe {facts.get('recipe_version')}"
        raise ValueError(
            f"`dataset` must hold virtual surfaces of recipe {RECIPE_VERSION}, got {made}: use `recorded_truth`."
        )
    if dataset.sampling_rate != facts["sampling_rate"]:
        raise ValueError(f"`dataset` must be at its native rate, {facts['sampling_rate']} Hz.")
    if not len(requests):
        raise ValueError("`requests` must not be empty; three NaN stand for the whole population.")
    check_whole_number("surfaces", surfaces)
    check_whole_number("per_surface", per_surface)
    return facts


def can_be_continued(dataset):
    """Whether fresh surfaces can be drawn from the world of a `PreparedDataset`: virtual ones of the code's recipe."""
    facts = dataset.attributes
    return facts["source"] == VIRTUAL_SOURCE and facts.get("recipe_version") == RECIPE_VERSION


def truth_of(dataset, requests, describe, seed=0, quiet=True, **settings):
    """`virtual_truth` if a data set, or all of a file, is of virtual surfaces of the code's recipe, else
    `recorded_truth`.
    """
    if not isinstance(dataset, PreparedDataset):
        dataset = PreparedDataset(dataset, split="all")
    if can_be_continued(dataset):
        return virtual_truth(dataset, requests, describe, seed=seed, quiet=quiet, **settings)
    chosen = {"per_surface": settings["per_surface"]} if "per_surface" in settings else {}
    return recorded_truth(dataset, describe, seed=seed, **chosen)
