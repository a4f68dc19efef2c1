"""The truth of a request: what real textures of surfaces with such ratings are like.

A request is a rating vector with NaN where an axis is not specified. No surface has exactly the requested ratings, so
surfaces count by a Gaussian kernel over the specified axes. Where the ratings are cheap and the textures are not
(virtual surfaces), surfaces are drawn where the requests need them and weighted back: importance sampling with
self-normalised weights.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from ..data import HoldOut, PreparedDataset, SegmentLimits
from ..signal import RATING_AXES
from ..virtual import FIRST_FRESH, RECIPE_VERSION, VirtualSurface, fresh_ratings, fresh_textures, rater_settings
from .metrics.statistics import jackknife_interval

#: Standard deviation of the kernel over ratings, z-scores: a third of what ratings spread over surfaces.
KERNEL_WIDTH = 0.25
#: Below so many surfaces that count, a request lies outside of what the data hold: extrapolation.
LEAST_EFFECTIVE_SIZE = 20
VIRTUAL_SOURCE = "virtual surfaces"
# textures that are described at once
_CHUNK = 256


@dataclass
class RatedTextures:
    """Measures of textures of rated surfaces, from which the truth of any request is estimated.

    Args:
        measures (`dict[str, np.ndarray]`): name -> (n, ...), one entry per texture.
        surface_ids (`np.ndarray`): (n,) row of `ratings`; every row has at least one texture.
        ratings (`np.ndarray`): (S, 3) of each surface; NaN = not rated.
        importance (`np.ndarray`): (S,) how much of the population a surface stands for: ones if surfaces were taken as
            they come, draws over probability if they were drawn.
        dropped (`int`): surfaces that were drawn but gave no texture.

    Raises:
        ValueError: if shapes do not fit together, a surface has no texture, or an importance is not above zero.
    """

    measures: dict
    surface_ids: np.ndarray
    ratings: np.ndarray
    importance: np.ndarray
    dropped: int = 0

    def __post_init__(self):
        self.surface_ids = np.asarray(self.surface_ids, dtype=np.int64)
        self.ratings = np.asarray(self.ratings, dtype=np.float64)
        self.importance = np.asarray(self.importance, dtype=np.float64)
        self.measures = {name: np.asarray(values) for name, values in self.measures.items()}
        surfaces = len(self.importance)
        if self.ratings.shape != (surfaces, len(RATING_AXES)):
            raise ValueError(f"`ratings` must have the shape ({surfaces}, 3), got {self.ratings.shape}.")
        if not (np.isfinite(self.importance).all() and (self.importance > 0).all()):
            raise ValueError("`importance` must be finite and above zero: leave out surfaces that were not drawn.")
        for name, values in self.measures.items():
            if len(values) != len(self.surface_ids):
                raise ValueError(f"`measures[{name!r}]` has {len(values)} rows for {len(self.surface_ids)} textures.")
        if not np.array_equal(np.unique(self.surface_ids), np.arange(surfaces)):
            raise ValueError(f"`surface_ids` must name each of the {surfaces} surfaces at least once, and no other.")
        self._textures = np.bincount(self.surface_ids)

    def surface_weights(self, request, width=KERNEL_WIDTH):
        """How much each surface counts for a request: (S,), of sum 1.

        Args:
            request (`Sequence[float]`): (3,) z-scores; NaN or None = not specified.
            width (`float`): standard deviation of the kernel, z-scores.

        Raises:
            ValueError: if `request` is not three ratings, `width` is not above zero, or no surface is rated on a
                specified axis.
        """
        logs = log_kernel(self.ratings, request, width) + np.log(self.importance)
        weights = np.exp(logs - logs.max())
        return weights / weights.sum()

    def weights(self, request, width=KERNEL_WIDTH):
        """How much each texture counts for a request: (n,), of sum 1; a surface's textures share its weight."""
        return (self.surface_weights(request, width) / self._textures)[self.surface_ids]

    def effective_size(self, request, width=KERNEL_WIDTH):
        """Number of equally weighted surfaces that would be as good: (sum w)^2 / sum w^2 (Kish 1965).

        Below `LEAST_EFFECTIVE_SIZE` the request is extrapolation.
        """
        return float(1 / np.sum(self.surface_weights(request, width) ** 2))

    def mean_rating(self, request, width=KERNEL_WIDTH):
        """Mean ratings of the surfaces that count for a request: (3,).

        On specified axes they lie nearer to the middle than the request, because the kernel finds more surfaces on
        that side; on the others they say what comes along (bumpy surfaces are rougher). NaN where none is rated.
        """
        weights = self.surface_weights(request, width)[:, None] * ~np.isnan(self.ratings)
        total = weights.sum(0)
        return np.where(total > 0, (weights * np.nan_to_num(self.ratings)).sum(0) / np.maximum(total, 1e-300), np.nan)

    def draw_ratings(self, request, count, width=KERNEL_WIDTH):
        """Ratings of the surfaces that count for a request: what to ask for, to be compared with them.

        Args:
            request, width: as for `surface_weights`; one specified axis at most.
            count (`int`): evenly spread over their distribution.

        Returns:
            `np.ndarray`: (count, 3) z-scores, ascending; NaN on axes that are not specified.

        Raises:
            ValueError: if `request` specifies more than one axis.
        """
        request = np.asarray(request, dtype=np.float64)
        specified = np.flatnonzero(~np.isnan(request))
        if len(specified) > 1:
            raise ValueError(f"`request` must specify one axis at most, got {request.tolist()}.")
        drawn = np.full((count, len(request)), np.nan)
        if len(specified):
            values = self.ratings[:, specified[0]]
            order = np.argsort(values)
            shares = np.cumsum(np.nan_to_num(self.surface_weights(request, width))[order])
            places = np.searchsorted(shares, (np.arange(count) + 0.5) / count * shares[-1])
            drawn[:, specified[0]] = values[order][np.minimum(places, len(order) - 1)]
        return drawn

    def mean(self, name, request, width=KERNEL_WIDTH):
        """Weighted mean of a measure over textures: (...,)."""
        return np.tensordot(self.weights(request, width), self.measures[name], 1)

    def spread(self, name, request, width=KERNEL_WIDTH):
        """Weighted standard deviation of a measure over textures, of and within surfaces: (...,)."""
        values = self.measures[name]
        squares = np.square(values - self.mean(name, request, width))
        return np.sqrt(np.tensordot(self.weights(request, width), squares, 1))

    def interval(self, name, request, width=KERNEL_WIDTH):
        """95 % interval of `mean`, from a jackknife that leaves out one surface at a time.

        Returns:
            `tuple[np.ndarray, np.ndarray]`: low and high, (...,) each; NaN if fewer than two surfaces count.
        """
        values, weights = self.measures[name], self.surface_weights(request, width)
        sums = np.zeros((len(weights), *values.shape[1:]))
        np.add.at(sums, self.surface_ids, values)
        column = (slice(None), *[None] * (values.ndim - 1))
        shares = sums * (weights / self._textures)[column]
        estimate, size = shares.sum(0), self.effective_size(request, width)
        if size < 2:
            return np.full_like(estimate, np.nan), np.full_like(estimate, np.nan)
        left_out = (estimate - shares) / (1 - weights)[column]
        return jackknife_interval(estimate, left_out, size)


def log_kernel(ratings, request, width=KERNEL_WIDTH):
    """Log of the Gaussian kernel between surfaces' ratings and a request over its specified axes.

    Args:
        ratings (`np.ndarray`): (S, 3) z-scores; a surface that is not rated on a specified axis gets -inf.
        request (`Sequence[float]`): (3,) z-scores; NaN or None = not specified.
        width (`float`): standard deviation, z-scores.

    Returns:
        `np.ndarray`: (S,), 0 at the request itself.

    Raises:
        ValueError: if `request` is not three ratings, `width` is not above zero, or no surface is rated on a specified
            axis.
    """
    request = np.asarray(request, dtype=np.float64)  # None becomes NaN
    if request.shape != (len(RATING_AXES),) or np.isinf(request).any():
        raise ValueError(f"`request` must be {len(RATING_AXES)} ratings, NaN = not specified, got {request.tolist()}.")
    if not width > 0:
        raise ValueError(f"`width` must be above zero, got {width}.")
    specified = ~np.isnan(request)
    logs = -0.5 * np.square((ratings[:, specified] - request[specified]) / width).sum(1)
    if np.isnan(logs).all():
        names = [name for name, given in zip(RATING_AXES, specified, strict=True) if given]
        raise ValueError(f"No surface is rated on {' and '.join(names)}: leave these axes of `request` unspecified.")
    return np.where(np.isnan(logs), -np.inf, logs)


def draw_surfaces(ratings, requests, count, seed=0):
    """Draws surfaces where requests need them, with replacement.

    The probability of a surface is the mean over requests of its share in the request's kernel weights, so that each
    request gets the same number of surfaces on average.

    Args:
        ratings (`np.ndarray`): (candidates, 3) z-scores.
        requests (`Sequence`): rating vectors; three NaN stand for the whole population.
        count (`int`): draws.
        seed (`int`): of the draws.

    Returns:
        `tuple[np.ndarray, np.ndarray]`: the distinct surfaces drawn, in ascending order, and their importance: draws
        over probability.
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
    """The truth of requests to a model of virtual surfaces, from fresh surfaces of the same collection.

    Surfaces, explorers and raters are like those of the ordinary splits; what is held out takes no part.

    Args:
        dataset (`PreparedDataset`): of virtual surfaces, at its native rate: it says which collection, raters, limits
            and filter; its training surfaces set the units of the ratings, its subset whether limits hold.
        requests (`Sequence`): (3,) rating vectors that the truth is wanted of, NaN = not specified; three NaN stand for
            the whole population.
        describe (`callable`): (textures (k, samples) float32 in N, levels (k,), friction coefficients (k,)) -> dict of
            arrays (k, ...), the measures. Called with some hundreds of textures at a time.
        surfaces (`int`): draws; a surface that is drawn twice is explored once and counts twice.
        candidates (`int`): fresh surfaces that are rated and drawn from.
        seconds (`float`): of each recording.
        per_surface (`int`): textures of each surface at most.
        seed (`int`): of the draws.
        workers (`int`): threads that explore; the result is the same.
        quiet (`bool`): no progress bar.

    Returns:
        `RatedTextures`. A surface whose first recordings hold no segment is explored once more, then dropped.

    Raises:
        ValueError: if `dataset` is none of virtual surfaces or of another version of the recipe, its textures are not
            at their native rate, or an argument is out of range.
    """
    facts = _check_virtual(dataset, requests, surfaces, per_surface)
    training = np.unique(PreparedDataset(dataset.path, "train", "full").surface_ids)
    numbers = [int(dataset.surfaces[surface].split("-")[0]) for surface in training]
    asked = rater_settings(facts)
    asked["raters"] = _ordinary(facts, "raters", [f"rater-{number}" for number in range(asked["raters"])])
    ratings = fresh_ratings(candidates, facts["seed"], training=numbers, **asked)
    met = _ordinary_candidates(facts, candidates)
    drawn, importance = draw_surfaces(ratings[met], requests, surfaces, seed)
    drawn = met[drawn]
    limits = SegmentLimits(**facts["limits"])
    settings = dict(
        seed=facts["seed"],
        explorers=_ordinary(facts, "explorers", sorted({name.split("/")[1] for name in dataset.recordings})),
        seconds=seconds,
        limits=limits if dataset.subset == "filtered" else limits.without_conditions(),
        band=dataset.band,
        order=facts["filter_order"],
        passes=facts["filter_passes"],
        turnarounds=facts["turnarounds"],
        per_surface=per_surface,
    )
    counts, measures = _explore_and_describe(drawn + FIRST_FRESH, describe, settings, workers, quiet)
    kept = counts > 0
    if not kept.any():
        raise ValueError(f"No fresh surface has a segment within {limits} in {seconds} s: explore for longer.")
    surface_ids = np.repeat(np.arange(kept.sum()), counts[kept])
    return RatedTextures(_joined(measures), surface_ids, ratings[drawn[kept]], importance[kept], int(np.sum(~kept)))


def _explore_and_describe(numbers, describe, settings, workers, quiet):
    """Number of textures of each surface, (surfaces,), and what `describe` said of them, a list of dicts."""

    def explore(number):
        first = fresh_textures(number, trial=0, **settings)
        return first if len(first[0]) else fresh_textures(number, trial=1, **settings)

    step = max(1, _CHUNK // settings["per_surface"])
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


def recorded_truth(dataset, describe, per_surface=4, seed=0):
    """The truth of requests from all surfaces of a data set as they are: for data that cannot be made afresh.

    Args:
        dataset (`PreparedDataset`): use the split "all": every surface counts.
        describe (`callable`): as in `virtual_truth`; levels and friction coefficients may be NaN.
        per_surface (`int`): segments of each surface at most; they share no sample.
        seed (`int`): of the choice of segments.

    Returns:
        `RatedTextures`, of importance 1; surfaces without a segment are not in it.
    """
    chosen = dataset.non_overlapping(per_surface, seed)
    chunks = [chosen[start : start + _CHUNK] for start in range(0, len(chosen), _CHUNK)]
    measures = [
        describe(dataset.textures(rows), dataset.levels[rows], dataset.friction_coefficients[rows]) for rows in chunks
    ]
    surfaces, surface_ids = np.unique(dataset.surface_ids[chosen], return_inverse=True)
    return RatedTextures(_joined(measures), surface_ids, dataset.surface_ratings[surfaces], np.ones(len(surfaces)))


def truth_of(dataset, requests, describe, seed=0, quiet=True, **settings):
    """`virtual_truth` if the data are virtual surfaces, else `recorded_truth`.

    Args:
        dataset (`PreparedDataset` or `str` or `Path`): the data set, or its file, of which all surfaces are taken.
        requests, describe, seed, quiet: of `virtual_truth`.
        **settings: further arguments of `virtual_truth`; only "per_surface" counts for recorded data.

    Returns:
        `RatedTextures`
    """
    if not isinstance(dataset, PreparedDataset):
        dataset = PreparedDataset(dataset, split="all")
    if dataset.attributes["source"] == VIRTUAL_SOURCE:
        return virtual_truth(dataset, requests, describe, seed=seed, quiet=quiet, **settings)
    chosen = {"per_surface": settings["per_surface"]} if "per_surface" in settings else {}
    return recorded_truth(dataset, describe, seed=seed, **chosen)


def _joined(measures):
    return {name: np.concatenate([part[name] for part in measures]) for name in measures[0]}


def _ordinary(facts, kind, names):
    """Numbers of the raters or explorers that are not held out, from names such as "rater-3"."""
    held = HoldOut(**facts["hold_out"]).held(kind, names) if facts["hold_out"] else [False] * len(names)
    return [int(name.rsplit("-", 1)[1]) for name, out in zip(names, held, strict=True) if not out]


def _ordinary_candidates(facts, candidates):
    """Which of the fresh surfaces are of no class that is held out: (n,) int64."""
    if not facts["hold_out"] or not facts["hold_out"]["surfaces"]:
        return np.arange(candidates)
    names = [VirtualSurface(facts["seed"], FIRST_FRESH + number).name for number in range(candidates)]
    return np.flatnonzero(~HoldOut(**facts["hold_out"]).held("surfaces", names))


def _check_virtual(dataset, requests, surfaces, per_surface):
    """The file's attributes, once they are known to describe a collection that can be continued."""
    facts = dataset.attributes
    if facts["source"] != VIRTUAL_SOURCE:
        raise ValueError(f"`dataset` must hold virtual surfaces, got {facts['source']!r}. Use `recorded_truth`.")
    if facts.get("recipe_version") != RECIPE_VERSION:
        raise ValueError(
            f"`dataset` is of recipe {facts.get('recipe_version')}, the code makes surfaces of recipe "
            f"{RECIPE_VERSION}: generate the data again, or use `recorded_truth`."
        )
    if dataset.sampling_rate != facts["sampling_rate"]:
        raise ValueError(
            f"`dataset` must be at its native rate, {facts['sampling_rate']} Hz: open it without `sampling_rate`."
        )
    if not len(requests):
        raise ValueError("`requests` must not be empty; three NaN stand for the whole population.")
    for name, value in (("surfaces", surfaces), ("per_surface", per_surface)):
        if int(value) != value or value < 1:
            raise ValueError(f"`{name}` must be a whole number of at least 1, got {value}.")
    return facts
