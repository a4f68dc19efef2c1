"""Sections "generation" and "unseen_surfaces": textures from the ratings of surfaces that training did not see."""

import numpy as np

from ...signal import band_levels_db, level
from ..baselines import BaselineRequest
from ..envelopes import surface_means
from ..metrics.copying import TrainingWaveforms, closer_share, nearest_distance
from ..metrics.diversity import diversity, precision_recall, rating_diversity
from ..metrics.errors import out_of_band_ratio_db, rmse
from ..metrics.statistics import excess, jackknife, leaf, number
from ..report_figures import plot_unseen

#: Of precision and recall.
NEIGHBOURS = 5
#: Names of the metrics of an unseen surface.
UNSEEN = ("nine_band_db", "level_r", "log_friction_r")
# training segments read at once
_CHUNK = 256


def run(context):
    """Both sections; the textures generated at each guidance scale serve both. Writes unseen.png."""
    data, surfaces = context.data, context.requests[1]
    rows = matching_rows(context)
    nearest = NearestTraining(context)
    generation, unseen = {"real": set_metrics(context, nearest, data.real, data.points, data.surfaces)}, {}
    for scale, generated in context.generated.items():
        textures = generated.textures[rows]
        entry = set_metrics(context, nearest, textures, data.reference.embed(textures), surfaces[rows])
        entry["rmse_protocol_n"] = _protocol_rmse(context, scale)
        entry["diversity_of_rating"] = _rating_diversity(context, generated.textures)
        generation[str(scale)] = entry
        frictions = generated.friction_coefficients
        unseen[str(scale)] = unseen_metrics(data, generated.textures, surfaces, generated.levels, frictions)
    generation["baselines"] = {
        slug: set_metrics(context, nearest, textures, context.baseline_points[slug], data.surfaces, correlate=False)
        for slug, textures in context.baseline_textures.items()
    }
    return {"generation": generation, "unseen_surfaces": _unseen_table(context, unseen)}


def matching_rows(context):
    """Rows of `context.requests`, as many for each surface as there are held-out segments of it."""
    surfaces, held_out = context.requests[1], context.data.surfaces
    take = np.arange(len(surfaces)) % context.settings.takes
    return np.flatnonzero(take < (surfaces[:, None] == held_out).sum(1))


class NearestTraining:
    """How close textures come to the training segments of a `Context`: by waveform, by embedding, and by latent."""

    def __init__(self, context):
        self.context, data = context, context.data
        settings, train = context.settings, data.train
        spread = np.linspace(0, len(train) - 1, min(settings.novelty_segments or len(train), len(train)))
        rows = np.unique(spread.astype(np.int64))
        chunks = (train.textures(rows[start : start + _CHUNK]) for start in range(0, len(rows), _CHUNK))
        self.waveforms = TrainingWaveforms(chunks, data.rate, quiet=context.quiet)
        self.latents = self._flat_latents(data.training.textures)
        self.real = self._closeness(data.real, data.points, self._subset(data.surfaces))

    def _flat_latents(self, textures):
        return self.context.encode(textures).reshape(len(textures), -1)

    def _subset(self, groups):
        """Evenly spaced rows: the textures compared with every training segment at every lag."""
        count = min(self.context.settings.novelty_textures, len(groups))
        return np.unique(np.linspace(0, len(groups) - 1, count).astype(int))

    def _closeness(self, textures, points, subset):
        """Distances to the nearest training segment; smaller is closer for all three."""
        found = {
            "_embedding": nearest_distance(points, self.context.data.reference.points),
            "_latent": nearest_distance(self._flat_latents(textures), self.latents),
        }
        if subset is not None:
            found[""] = -self.waveforms.nearest_correlation(textures[subset])
        return found

    def leaves(self, textures, points, groups, correlate=True):
        """Leaves "nearest_correlation" and "novelty_share", "_embedding", "_latent": shares closer than real ones."""
        subset, silent = self._subset(groups) if correlate else None, not np.any(textures)
        is_real = textures is self.context.data.real
        nearest = self.real if is_real else self._closeness(textures, points, subset)
        leaves = {"nearest_correlation": leaf(-nearest[""], groups[subset]) if correlate else number()}
        leaves["novelty_share"] = number()
        for name, values in nearest.items():
            real, members = self.real[name], groups[subset] if name == "" else groups
            share, interval = jackknife(lambda mask, v=values, r=real: closer_share(v[mask], r)[0], members)
            # without a spread over surfaces there is no interval
            entry = number(share, len(values), interval if 0 < share < 1 else None)
            leaves[f"novelty_share{name}"] = number() if silent else entry
        return leaves


def set_metrics(context, nearest, textures, points, groups, correlate=True):
    """Leaves of a set of textures (n, samples) N against the training surfaces and the held-out ones.

    `groups` (n,) are the surfaces whose ratings were requested; `correlate` compares waveforms with those of training,
    which takes minutes.
    """
    data, distances = context.data, context.data.reference.distances(points, groups)
    leaves = dict(distances)
    for name, distance in distances.items():
        leaves[f"{name}_real_real"] = data.distances[name]
        leaves[f"{name}_excess"] = excess(distance, data.distances[name])
    leaves["out_of_band_db"] = leaf(out_of_band_ratio_db(textures, data.rate), groups)
    leaves |= {name: number() for name in ("diversity", "precision", "recall")}
    if np.any(textures) and len(np.unique(groups)) < len(groups):
        real = textures is data.real
        bands = data.bands if real else band_levels_db(textures, data.rate, data.edges)
        leaves["diversity"] = number(diversity(bands, groups, data.bands, data.surfaces), len(textures))
        # for the real ones: the same of other surfaces, those of training
        compared = _other_surfaces(context, len(points)) if real else points
        if min(len(compared), len(data.points)) > NEIGHBOURS:
            precision, recall = precision_recall(compared, data.points, NEIGHBOURS)
            leaves["precision"], leaves["recall"] = number(precision, len(points)), number(recall, len(points))
    return leaves | nearest.leaves(textures, points, groups, correlate)


def _other_surfaces(context, count):
    """Embeddings of so many textures of training surfaces."""
    points = context.data.reference.points
    return points[context.rng("other surfaces").permutation(len(points))[:count]]


def _protocol_rmse(context, scale):
    """The paper's section 3.4: RMSE of textures from random ratings to unrelated segments. It rewards quiet ones."""
    settings, rng, real = context.settings, context.rng("protocol"), context.data.real
    if context.data.dataset.unit != "N":
        return number()
    rows = rng.choice(len(real), min(settings.protocol_segments, len(real)), replace=False)
    rows = np.repeat(rows, settings.protocol_repeats)
    generated = context.generate(rng.standard_normal((len(rows), 3)), context.seeds(2, len(rows)), scale)
    return leaf(rmse(generated.textures, real[rows]), rows)


def _rating_diversity(context, textures):
    """Leaf: takes of one rating against real training textures with such ratings."""
    data, training, (ratings, surfaces) = context.data, context.data.training, context.requests
    _, first, groups = np.unique(surfaces, return_index=True, return_inverse=True)
    generated, real = (band_levels_db(rows, data.rate, data.edges) for rows in (textures, training.textures))
    value = rating_diversity(generated, groups, ratings[first], real, training.ratings, training.surface_ids)
    return number(value, len(textures))


def mean_spectra(data, textures, groups):
    """Mean band levels of the held-out surfaces, real and generated: (surfaces, 9) dB each."""
    bands = band_levels_db(textures, data.rate, data.edges)
    return surface_means(data.bands, data.surfaces), surface_means(bands, groups)


def unseen_metrics(data, textures, groups, levels, frictions=None):
    """Leaves over held-out surfaces: error of the mean spectrum; correlation of mean level and mean log friction.

    `groups` (n,) is the surface of each texture, `levels` (n,) the natural log of their RMS.
    """
    real, generated = mean_spectra(data, textures, groups)
    frictions = np.full(len(groups), np.nan) if frictions is None else frictions
    return {
        "nine_band_db": leaf(np.abs(generated - real).mean(-1)),
        "level_r": _correlation(data, levels, groups, data.dataset.levels[data.rows]),
        "log_friction_r": _correlation(data, np.log(frictions), groups, np.log(data.frictions)),
    }


def _correlation(data, values, groups, real):
    """Leaf: Pearson correlation over surfaces of the means of generated and real values."""
    both = np.stack([surface_means(np.asarray(values), groups), surface_means(real, data.surfaces)])
    if not np.isfinite(both).all() or both.shape[1] < 4 or both.std(1).min() < 1e-9:
        return number()
    surfaces = np.arange(both.shape[1])
    r, interval = jackknife(lambda mask: np.corrcoef(both[:, mask])[0, 1], surfaces)
    return number(r, len(surfaces), interval)


def _unseen_table(context, by_guidance):
    """`{"nine_band_db": {slug or "model": leaf}, "level_r": ..., "log_friction_r": ..., "guidance": ...}`."""
    data, (ratings, surfaces) = context.data, context.requests
    generated = context.generated[context.default_guidance]
    entries = {"model": by_guidance[str(context.default_guidance)]}
    shown = {"model": mean_spectra(data, generated.textures, surfaces)}
    for slug, baseline in context.baselines.items():
        textures, groups, request = context.baseline_textures[slug], data.surfaces, data.request
        if not np.any(textures):
            entries[slug] = {name: number() for name in UNSEEN}  # silence has no spectrum
            continue
        if baseline.knows != "recording":  # as many takes as the model has
            request, groups = BaselineRequest(ratings), surfaces
            textures = baseline.sample(request, context.rng(f"{slug} unseen"))
        frictions = None
        if hasattr(baseline, "friction_coefficients"):
            # a generator in the same state: the friction that belongs to these textures
            frictions = baseline.friction_coefficients(request, context.rng(f"{slug} unseen"))
        entries[slug] = unseen_metrics(data, textures, groups, level(textures), frictions)
        if slug in ("knn_blend", "ridge", "mean_spectrum"):
            shown[slug] = mean_spectra(data, textures, groups)
    plot_unseen(shown, context.output / "unseen.png")
    table = {name: {slug: leaves[name] for slug, leaves in entries.items()} for name in UNSEEN}
    # the same textures as if they had been requested with another surface's ratings
    names, place = np.unique(surfaces, return_inverse=True)
    wrong = context.rng("permuted").permutation(names)[place]
    permuted = unseen_metrics(data, generated.textures, wrong, generated.levels, generated.friction_coefficients)
    return table | {"guidance": by_guidance, "permuted": permuted}
