"""Section "second_judge": how often takes are told from real takes of the same surface, and by which features."""

from collections import Counter
from functools import cached_property, partial

import numpy as np
from scipy.optimize import linear_sum_assignment

from tactile_diffusers.evaluation.metrics.embedding import FEATURE_NAMES, SCALE_FLOORS, tactile_features
from tactile_diffusers.evaluation.metrics.statistics import leaf, number

from ..afferents import AFFERENT_FLOORS, AFFERENT_NAMES, afferent_features
from ..baselines import BaselineRequest
from ..figures import plot_told_apart
from ..sampling import reconstruct
from ..second_judge import FOLDS, tell_apart
from ..stand_ins import NoNetwork, with_stand_in

#: Feature sets: name -> features of textures, their names and their least spreads.
FEATURES = {
    "signal": (tactile_features, FEATURE_NAMES, SCALE_FLOORS),
    "afferents": (afferent_features, AFFERENT_NAMES, AFFERENT_FLOORS),
}
#: Whether a judge knows other takes of the surface.
KINDS = ("alone", "beside_surface")
#: Features named for each row.
NAMED = 5
_PARTS = 3


def run(context):
    """The section: `{"second_judge": ...}`, None with too few surfaces; writes second_judge.png.

    "rows": row -> feature set -> kind -> leaves "all", "eventful" (the quarter of surfaces with the most events) and
    "over_chance" (paired with another real take), shares of right answers over surfaces; and "features" with their
    contribution to the log odds, difference from real takes in standard deviations, and ratio of spreads. "network":
    layers -> feature set -> kind -> LCTG's share minus that of no network. "left_out": surfaces with a take that is
    silent or equal to one of another surface.
    """
    takes, rows, shares = Takes(context), {}, {}
    if len(takes.surfaces) < FOLDS:
        return {"second_judge": None}
    for name, make in _rows(context, takes).items():  # another real take comes first
        textures = make()
        rows[name], shares[name] = {features: {} for features in FEATURES}, {}
        for features, kind, leaves, shares[name][features, kind] in takes.judge(textures):
            over = shares[name][features, kind] - shares["other_take"][features, kind]
            rows[name][features][kind] = leaves | {"over_chance": share(over, least=-1)}
    network = {
        layers: {
            features: {
                kind: share(shares["lctg" + end][features, kind] - shares["no_network" + end][features, kind], -1)
                for kind in KINDS
            }
            for features in FEATURES
        }
        for layers, end in (("all_layers", ""), ("base_layer", "_base"))
        if "lctg" + end in rows
    }
    plot_told_apart(rows, context.output / "second_judge.png")
    facts = {"surfaces": len(takes.surfaces), "left_out": takes.left_out, "takes": takes.number}
    return {"second_judge": facts | {"rows": rows, "network": network}}


class Takes:
    """Real takes of the held-out surfaces, and what judges make of others in their place.

    Takes play three parts: the surface's, the real one, and the one in whose place another is put. They are dealt anew,
    for each surface, in as many rounds as there are takes: one round alone moves the share at chance by 0.04 (60
    surfaces).
    """

    def __init__(self, context):
        self.data, self.seed, self.number = context.data, context.seed, context.settings.judge_takes
        needed, dataset, rng = _PARTS * self.number, self.data.dataset, context.rng("second judge")
        rows, ids = rng.permutation(self.data.unseen_rows(needed)), dataset.surface_ids
        own = {surface: rows[ids[rows] == surface] for surface in np.unique(ids[rows])}
        own = {surface: found for surface, found in own.items() if len(found) == needed}
        # a judge refuses takes that it was fitted on, under whatever name: such surfaces are no two surfaces
        takes = {
            surface: [take.tobytes() * bool(take.any()) for take in dataset.textures(r)] for surface, r in own.items()
        }
        owners = Counter(take for found in takes.values() for take in set(found))
        kept = [s for s, found in takes.items() if all(take and owners[take] == 1 for take in found)]
        self.left_out = len(own) - len(kept)
        self.surfaces, self.each, self.rows = np.array(kept, int), needed, [own[surface] for surface in kept]
        self.rounds = [rng.permuted(np.tile(np.arange(needed), (len(kept), 1)), axis=1) for _ in range(needed)]

    @cached_property
    def textures(self):
        """(surfaces * takes, samples): each is a real take and has others put in its place."""
        return self.data.dataset.textures(np.concatenate(self.rows))

    @cached_property
    def real(self):
        """Feature set -> (surfaces, takes, features) of the real takes."""
        return {name: self._features(name, self.textures) for name in FEATURES}

    def _features(self, name, textures):
        return FEATURES[name][0](textures, self.data.rate).reshape(len(self.surfaces), self.each, -1)

    def judge(self, textures):
        """Textures in the place of the real ones: yields feature set, kind, leaves, shares (rounds, surfaces)."""
        events = self.real["signal"][..., FEATURE_NAMES.index("event_rate")].mean(1)
        for name, (_, names, least) in FEATURES.items():
            real, fake = self.real[name], self._features(name, textures)
            spread = np.maximum(real.std((0, 1)), least)
            difference, ratio = (fake.mean(1) - real.mean(1)) / spread, np.maximum(fake.std((0, 1)), least) / spread
            for kind in KINDS:
                told = [self._told(real, fake, np.split(order, _PARTS, 1), least, kind) for order in self.rounds]
                shares, added = (np.array(part) for part in zip(*told, strict=True))
                added = added.mean(0)  # over rounds: (surfaces, features)
                features = [
                    {
                        **{"name": names[k], "contribution": leaf(added[:, k])},
                        **{"difference": leaf(difference[:, k]), "spread_ratio": number(ratio[k])},
                    }
                    for k in np.argsort(-added.mean(0))[:NAMED]
                ]
                eventful = share(shares[:, events >= np.quantile(events, 0.75)])
                yield name, kind, {"all": share(shares), "eventful": eventful, "features": features}, shares

    def _told(self, real, fake, parts, least, kind):
        surface, own, place = (
            np.take_along_axis(takes, part[..., None], 1) for takes, part in zip((real, real, fake), parts, strict=True)
        )
        references = surface if kind == "beside_surface" else None
        return tell_apart(own, place, self.surfaces, least, references, self.seed)


def share(shares, least=0):
    """Leaf of shares (rounds, surfaces); its interval holds the spread over surfaces and over rounds.

    Surfaces alone give one too narrow, since judges are shared: at chance, by 1.4 (measured over seeds).
    """
    entry = leaf(shares.mean(0))
    if entry["interval"]:
        reach = (entry["interval"][1] - entry["mean"], 1.96 * shares.mean(1).std(ddof=1) / np.sqrt(len(shares)))
        entry["interval"] = np.clip(entry["mean"] + np.hypot(*reach) * np.array([-1, 1]), least, 1).tolist()
    return entry


def _rows(context, takes):
    """Row -> function that makes its textures (n, samples), one in the place of each of `takes.rows`."""
    data, pipe = context.data, context.pipe
    real, ratings = takes.textures, data.dataset.ratings.mean[np.repeat(takes.surfaces, takes.each)]

    def decoded(decoder, steps, change=None):
        return partial(reconstruct, decoder, real, data.rate, steps, context.seed, quiet=context.quiet, change=change)

    def base_layer(latents):
        return pipe.lctg.pad_detail(latents[:, : pipe.lctg.base_channels])

    no_network = with_stand_in(pipe, NoNetwork)
    rows = {"other_take": lambda: real}
    rows |= {"lctg": decoded(pipe, context.steps), "no_network": decoded(no_network, 1)}
    if pipe.lctg.config.detail_channels:
        rows["lctg_base"] = decoded(pipe, context.steps, base_layer)
        rows["no_network_base"] = decoded(no_network, 1, base_layer)
    if pipe.dale is not None and "ridge" in context.baselines:
        seeds = context.seeds(3, len(ratings))
        rows["model"] = lambda: context.generate(ratings, seeds, context.default_guidance).textures
        rows["nearest_surface"] = lambda: _nearest(data.training, ratings, takes)
        for slug in ("knn_blend", "ridge"):
            sample = context.baselines[slug].sample
            rows[slug] = partial(sample, BaselineRequest(ratings), context.rng(f"second judge {slug}"))
    return rows


def _nearest(training, ratings, takes):
    """Real takes of the training surfaces with the nearest ratings, each surface for one request, in turn."""
    rated = training.keep(np.isfinite(training.ratings).all(-1))
    names, first = np.unique(rated.surface_ids, return_index=True)
    wanted = ratings.reshape(len(takes.surfaces), -1, ratings.shape[-1])[:, 0]
    squares = np.square(np.nan_to_num(wanted[:, None] - rated.ratings[first])).sum(-1)
    requests, found = linear_sum_assignment(squares)
    chosen = np.zeros(len(wanted), int)
    chosen[requests] = found
    own = [np.flatnonzero(rated.surface_ids == names[k]) for k in chosen]
    return rated.textures[np.concatenate([np.resize(rows, takes.each) for rows in own])]
