"""Sections "generation" and "unseen_surfaces": textures from the ratings of surfaces that training did not see."""

import numpy as np

from tactile_diffusers.evaluation.metrics.copying import TrainingEnvelopes, copied_share
from tactile_diffusers.evaluation.metrics.diversity import covered, diversity, rating_diversity
from tactile_diffusers.evaluation.metrics.errors import out_of_band_ratio_db, rmse
from tactile_diffusers.evaluation.metrics.statistics import estimate, leaf, number
from tactile_diffusers.signal import band_levels_db, level

from ..baselines import BaselineRequest
from ..envelopes import surface_means
from .variation import measure_variation, surface_correlation

#: Of precision and recall.
NEIGHBOURS = 5
#: Names of the metrics of an unseen surface.
UNSEEN = ("nine_band_db", "level_r", "log_friction_r")
# training segments read at once
_CHUNK = 256


def run(context):
    """Both sections; the textures generated at each guidance scale serve both."""
    data, surfaces = context.data, context.requests[1]
    rows = matching_rows(context)
    copying = Copying(context)
    generation, unseen = {"real": set_metrics(context, copying, data.real, data.points, data.surfaces)}, {}
    for scale, generated in context.generated.items():
        textures = generated.textures[rows]
        entry = set_metrics(context, copying, textures, data.reference.embed(textures), surfaces[rows])
        entry["rmse_protocol_n"] = _protocol_rmse(context, scale)
        entry["diversity_of_rating"] = _rating_diversity(context, generated.textures)
        generation[str(scale)] = entry
        frictions = generated.friction_coefficients
        unseen[str(scale)] = unseen_metrics(data, generated.textures, surfaces, generated.levels, frictions)
    generation["baselines"] = {
        slug: set_metrics(context, copying, textures, context.baseline_points[slug], data.surfaces)
        for slug, textures in context.baseline_textures.items()
    }
    table = _unseen_table(context, unseen) | {"variation": measure_variation(context)}
    return {"generation": generation, "unseen_surfaces": table}


def matching_rows(context):
    """Rows of `context.requests`, as many for each surface as there are held-out segments of it."""
    surfaces, held_out = context.requests[1], context.data.surfaces
    take = np.arange(len(surfaces)) % context.settings.takes
    return np.flatnonzero(take < (surfaces[:, None] == held_out).sum(1))


class Copying:
    """How close textures come to the training segments of a `Context`, beside real textures of unseen surfaces."""

    def __init__(self, context):
        data, train = context.data, context.data.train
        blocks = (np.arange(start, min(start + _CHUNK, len(train))) for start in range(0, len(train), _CHUNK))
        self._training = TrainingEnvelopes(map(train.textures, blocks), data.rate, context.quiet)
        self._surfaces = np.tile(data.surfaces, 2)
        other = data.dataset.textures(data.other_rows)
        self._real = self._training.nearest_correlation(np.concatenate([data.real, other]))

    def leaves(self, textures, groups):
        """Leaves "nearest_correlation" and "copied_share" of textures made for surfaces (n,); empty for silence."""
        if not np.any(textures):
            return {"nearest_correlation": number(), "copied_share": number()}
        values = self._training.nearest_correlation(textures)
        share, interval = copied_share(values, groups, self._real, self._surfaces)
        return {"nearest_correlation": leaf(values, groups), "copied_share": number(share, len(values), interval)}


def set_metrics(context, copying, textures, points, groups):
    """Leaves of a set of textures (n, samples) N against the training surfaces and the held-out ones.

    `groups` (n,) are the surfaces whose ratings were requested. Intervals leave a surface out of both sets at once.
    """
    data = context.data
    leaves = data.reference.distances(points, groups, (data.points, data.surfaces))
    leaves["out_of_band_db"] = leaf(out_of_band_ratio_db(textures, data.rate), groups)
    leaves |= {name: number() for name in ("diversity", "precision", "recall")}
    if np.any(textures) and len(np.unique(groups)) < len(groups):
        real = textures is data.real
        bands = data.bands if real else band_levels_db(textures, data.rate, data.edges)
        leaves["diversity"] = estimate(
            lambda made, known: diversity(bands[made], groups[made], data.bands[known], data.surfaces[known]),
            *(groups, data.surfaces),
        )
        # for the real ones: the same of other surfaces, those of training
        others = context.rng("other surfaces").permutation(data.reference.points)[: len(points)] if real else points
        owners = groups[: len(others)]  # training may be smaller
        if min(len(others), len(data.points)) > NEIGHBOURS + max(np.unique(groups, return_counts=True)[1]):
            both = {"precision": lambda a, b: covered(others[a], data.points[b], NEIGHBOURS)}
            both["recall"] = lambda a, b: covered(data.points[b], others[a], NEIGHBOURS)
            leaves |= {name: estimate(share, owners, data.surfaces, limits=(0, 1)) for name, share in both.items()}
    return leaves | copying.leaves(textures, groups)


def _protocol_rmse(context, scale):
    """The paper's section 3.4: RMSE of textures from random ratings to unrelated segments. It rewards quiet ones."""
    settings, rng, real = context.settings, context.rng("protocol"), context.data.real
    if context.data.dataset.unit != "N":
        return number()
    rows = rng.choice(len(real), min(settings.protocol_segments, len(real)), replace=False)
    rows = np.repeat(rows, settings.protocol_repeats)
    ratings = rng.standard_normal((len(rows), len(context.axes)))
    generated = context.generate(ratings, context.seeds(2, len(rows)), scale)
    return leaf(rmse(generated.textures, real[rows]), rows)


def _rating_diversity(context, textures):
    """Leaf: takes of one rating against real training textures with such ratings."""
    data, training, (ratings, surfaces) = context.data, context.data.training, context.requests
    _, first, groups = np.unique(surfaces, return_index=True, return_inverse=True)
    generated, real = (band_levels_db(rows, data.rate, data.edges) for rows in (textures, training.textures))
    known = (ratings[first], real, training.ratings, training.surface_ids)
    value, interval = rating_diversity(generated, groups, *known)
    return number(value, len(textures), interval)


def unseen_errors(data, textures, groups):
    """Error of each held-out surface's mean spectrum: mean over the nine bands, dB, (surfaces,)."""
    bands = band_levels_db(textures, data.rate, data.edges)
    real, generated = surface_means(data.bands, data.surfaces), surface_means(bands, groups)
    return np.abs(generated - real).mean(-1)


def unseen_metrics(data, textures, groups, levels, frictions=None):
    """Leaves over held-out surfaces: error of the mean spectrum; correlation of mean level and mean log friction.

    `groups` (n,) is the surface of each texture, `levels` (n,) the natural log of their RMS.
    """
    frictions = np.full(len(groups), np.nan) if frictions is None else frictions
    return {
        "nine_band_db": leaf(unseen_errors(data, textures, groups)),
        "level_r": surface_correlation(levels, groups, data.dataset.levels[data.rows], data.surfaces),
        "log_friction_r": surface_correlation(np.log(frictions), groups, np.log(data.frictions), data.surfaces),
    }


def _unseen_table(context, by_guidance):
    """`{metric: {slug or "model": leaf}, "guidance": ..., "permuted": ...}`; "nine_band_over_model_db" is paired."""
    data, (ratings, surfaces) = context.data, context.requests
    generated = context.generated[context.default_guidance]
    entries = {"model": by_guidance[str(context.default_guidance)]}
    over_model, ours = {"model": number()}, unseen_errors(data, generated.textures, surfaces)
    for slug, baseline in context.baselines.items():
        textures, groups, request = context.baseline_textures[slug], data.surfaces, data.request
        if not np.any(textures):
            entries[slug] = {name: number() for name in UNSEEN}  # silence has no spectrum
            over_model[slug] = number()
            continue
        if baseline.knows != "recording":  # as many takes as the model has
            request, groups = BaselineRequest(ratings), surfaces
            textures = baseline.sample(request, context.rng(f"{slug} unseen"))
        frictions = None
        if hasattr(baseline, "friction_coefficients"):
            # a generator in the same state: the friction that belongs to these textures
            frictions = baseline.friction_coefficients(request, context.rng(f"{slug} unseen"))
        entries[slug] = unseen_metrics(data, textures, groups, level(textures), frictions)
        over_model[slug] = leaf(unseen_errors(data, textures, groups) - ours)
    table = {name: {slug: leaves[name] for slug, leaves in entries.items()} for name in UNSEEN}
    # the same textures as if they had been requested with another surface's ratings
    names, place = np.unique(surfaces, return_inverse=True)
    wrong = context.rng("permuted").permutation(names)[place]
    permuted = unseen_metrics(data, generated.textures, wrong, generated.levels, generated.friction_coefficients)
    return table | {"nine_band_over_model_db": over_model, "guidance": by_guidance, "permuted": permuted}
