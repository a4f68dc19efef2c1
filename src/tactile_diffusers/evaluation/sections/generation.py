"""Sections "generation" and "unseen_surfaces": textures from the ratings of surfaces that no training saw."""

import numpy as np

from ...signal import band_levels_db, level
from ..audio_distance import frechet_audio_distance, log_mel_embedding
from ..baselines import BaselineRequest
from ..metrics.copying import (
    TrainingWaveforms,
    closer_share,
    diversity,
    nearest_distance,
    precision_recall,
    rating_diversity,
)
from ..metrics.errors import out_of_band_ratio_db, rmse
from ..metrics.statistics import excess, jackknife, leaf, number
from ..report_figures import plot_unseen
from ..sampling import noise_seeds

#: Of precision and recall.
NEIGHBOURS = 5
# training segments read at once
_CHUNK = 256


def run(context):
    """Both sections; the textures generated at each guidance scale serve both. Writes unseen.png."""
    judge = _SetJudge(context)
    surfaces = context.requests[1]
    generation, unseen = {"real": judge.metrics(context.real, context.real_points, context.surfaces)}, {}
    for scale in context.guidance_scales:
        made, rows = context.generated(scale), context.matching()
        points = context.reference.embed(made.textures[rows])
        entry = judge.metrics(made.textures[rows], points, surfaces[rows])
        entry |= judge.audio(made.textures)
        entry["rmse_protocol_n"] = _protocol_rmse(context, scale)
        entry["diversity_of_rating"] = _rating_diversity(context, made.textures)
        generation[str(scale)] = entry
        unseen[str(scale)] = _Unseen(context, made.textures, surfaces, made.levels, made.friction_coefficients)
    generation["baselines"] = {
        slug: judge.metrics(textures, context.baseline_points[slug], context.surfaces, correlate=False)
        for slug, textures in context.baseline_textures.items()
    }
    return {"generation": generation, "unseen_surfaces": _unseen_table(context, unseen)}


class _SetJudge:
    """Metrics of a set of textures against the training surfaces and the held-out ones."""

    def __init__(self, context):
        self.context = context
        settings, train = context.settings, context.train
        spread = np.linspace(0, len(train) - 1, min(settings.novelty_segments or len(train), len(train)))
        rows = np.unique(spread.astype(np.int64))
        chunks = (train.textures(rows[start : start + _CHUNK]) for start in range(0, len(rows), _CHUNK))
        self.waveforms = TrainingWaveforms(chunks, context.rate, quiet=context.quiet)
        self.latents = self._flat(context.training.textures)
        self.subset = self._subset(context.surfaces)
        self.real = self._nearest(context.real, context.real_points, self.subset)

    def _flat(self, textures):
        return self.context.encode(textures).reshape(len(textures), -1)

    def _other_surfaces(self, count):
        """Embeddings of so many textures of training surfaces."""
        points = self.context.reference.points
        return points[self.context.rng("other surfaces").permutation(len(points))[:count]]

    def _subset(self, groups):
        """Evenly spaced rows: the textures compared with every training segment at every lag."""
        count = min(self.context.settings.novelty_textures, len(groups))
        return np.unique(np.linspace(0, len(groups) - 1, count).astype(int))

    def _nearest(self, textures, points, subset):
        """How close textures come to training segments; smaller is closer for all three."""
        found = {
            "_embedding": nearest_distance(points, self.context.reference.points),
            "_latent": nearest_distance(self._flat(textures), self.latents),
        }
        if subset is not None:
            found[""] = -self.waveforms.nearest_correlation(textures[subset])
        return found

    def metrics(self, textures, points, groups, correlate=True):
        """Leaves of one set; `groups` are the surfaces whose ratings were asked for.

        `correlate`: whether waveforms are compared with those of training, which takes minutes.
        """
        context, real = self.context, textures is self.context.real
        distances, real_distances = context.reference.distances(points, groups), context.real_distances
        leaves = dict(distances)
        for name, distance in distances.items():
            leaves[f"{name}_real_real"] = real_distances[name]
            leaves[f"{name}_excess"] = excess(distance, real_distances[name])
        leaves["out_of_band_db"] = leaf(out_of_band_ratio_db(textures, context.rate), groups)
        silent = not np.any(textures)
        leaves |= {name: number() for name in ("diversity", "precision", "recall")}
        if not silent and _has_takes(groups):
            bands = context.real_bands if real else band_levels_db(textures, context.rate, context.edges)
            spread = diversity(bands, groups, context.real_bands, context.surfaces)
            leaves["diversity"] = number(spread, len(textures))
            # of the real ones: what other surfaces, of training, make of it
            compared = self._other_surfaces(len(points)) if real else points
            if min(len(compared), len(context.real_points)) > NEIGHBOURS:
                precision, recall = precision_recall(compared, context.real_points, NEIGHBOURS)
                leaves["precision"], leaves["recall"] = number(precision, len(points)), number(recall, len(points))
        subset = self._subset(groups) if correlate else None
        nearest = self.real if real else self._nearest(textures, points, subset)
        leaves["nearest_correlation"] = leaf(-nearest[""], groups[subset]) if correlate else number()
        leaves["novelty_share"] = number()
        for name, values in nearest.items():
            members = groups[subset] if name == "" else groups
            share, interval = _share(values, self.real[name], members)
            leaves[f"novelty_share{name}"] = number() if silent else number(share, len(values), interval)
        return leaves

    def audio(self, textures):
        """The paper's distribution distance, on the offline log-mel embedding or the caller's own."""
        context = self.context
        embedding = context.embedding or log_mel_embedding
        name = "fad_" + getattr(embedding, "__name__", "custom").removesuffix("_embedding")
        count = min(context.settings.audio_textures, len(textures))
        sets = {
            name: context.rng("audio").permutation(textures)[:count],
            f"{name}_matched": textures[context.matching()],  # as many as there are real ones to compare with
            f"{name}_real_real": context.real,
        }
        reference = context.training.textures
        leaves = {}
        rows = [embedding(members[:1], context.rate) for members in (reference, textures)]
        fewest = max(1, np.shape(rows[0])[-1] // max(1, len(rows[0])) + 1)  # textures that a covariance needs
        for key, members in sets.items():
            enough = min(len(members), len(reference)) > fewest
            value = frechet_audio_distance(members, reference, context.rate, embedding) if enough else None
            leaves[key] = number(value, len(members))
        return leaves


def _has_takes(groups):
    """Whether there is more than one take of anything."""
    return len(np.unique(groups)) < len(groups)


def _share(values, real, groups):
    """Share closer to training than the real first percentile, and its interval over surfaces."""
    share, interval = jackknife(lambda mask: closer_share(values[mask], real)[0], groups)
    return share, interval if 0 < share < 1 else None  # a spread over surfaces that is nothing says nothing


def _protocol_rmse(context, scale):
    """The paper's section 3.4: waveform RMSE of textures from random ratings to segments they have nothing to do
    with. It rewards quiet textures and says nothing about quality; it is here because the paper reports it."""
    settings, rng = context.settings, context.rng("protocol")
    if context.held_out.unit != "N":
        return number()
    rows = rng.choice(len(context.real), min(settings.protocol_segments, len(context.real)), replace=False)
    rows = np.repeat(rows, settings.protocol_repeats)
    made = context.generate(rng.standard_normal((len(rows), 3)), noise_seeds([context.seed, 2], len(rows)), scale)
    return leaf(rmse(made.textures, context.real[rows]), rows)


def _rating_diversity(context, textures):
    """Takes of one rating against real training textures with such ratings."""
    ratings, surfaces = context.requests
    groups = np.unique(surfaces, return_inverse=True)[1]
    group_ratings = np.stack([ratings[groups == group][0] for group in range(groups.max() + 1)])
    training = context.training
    bands = (band_levels_db(rows, context.rate, context.edges) for rows in (textures, training.textures))
    made, real = bands
    value = rating_diversity(made, groups, group_ratings, real, training.ratings, training.surface_ids)
    return number(value, len(textures))


class _Unseen:
    """One set of textures against held-out surfaces, surface by surface.

    Attributes:
        spectra (`tuple[np.ndarray, np.ndarray]`): real and made mean band levels, (surfaces, 9) dB each.
        leaves (`dict[str, dict]`): over surfaces: error of the mean spectrum; correlation with the real means of level
            and log friction.
    """

    def __init__(self, context, textures, groups, levels, frictions=None):
        self.context, self.groups = context, groups
        bands = band_levels_db(textures, context.rate, context.edges)
        self.spectra = self._means(context.real_bands, context.surfaces), self._means(bands, groups)
        held_out, rows = context.held_out, context.chosen[0]
        self.leaves = {
            "nine_band_db": leaf(np.abs(self.spectra[1] - self.spectra[0]).mean(-1)),
            "level_r": self._correlation(levels, held_out.levels[rows]),
            "log_friction_r": number(),
        }
        if frictions is not None:
            real_frictions = np.log(context.real_frictions)
            self.leaves["log_friction_r"] = self._correlation(np.log(frictions), real_frictions)

    def _means(self, values, members):
        return np.stack([np.asarray(values)[members == name].mean(0) for name in np.unique(self.context.surfaces)])

    def _correlation(self, made, real):
        both = np.stack([self._means(made, self.groups), self._means(real, self.context.surfaces)])
        if not np.isfinite(both).all() or both.shape[1] < 4 or both.std(1).min() < 1e-9:
            return number()
        surfaces = np.arange(both.shape[1])
        r, interval = jackknife(lambda mask: np.corrcoef(both[:, mask])[0, 1], surfaces)
        return number(r, len(surfaces), interval)


def _unseen_table(context, by_guidance):
    """`{"nine_band_db": {slug or "model": leaf}, "level_r": ..., "log_friction_r": ..., "guidance": ...}`."""
    default = str(context.default_guidance)
    entries = {"model": by_guidance[default]}
    ratings, surfaces = context.requests
    # the control: the same textures as if they had been asked for with another surface's ratings
    shuffled = dict(zip(np.unique(surfaces), context.rng("permuted").permutation(np.unique(surfaces)), strict=True))
    wrong = np.array([shuffled[surface] for surface in surfaces])
    made = context.generated(context.default_guidance)
    permuted = _Unseen(context, made.textures, wrong, made.levels, made.friction_coefficients)
    for slug, baseline in context.baselines.items():
        textures, groups, request = context.baseline_textures[slug], context.surfaces, context.request
        if not np.any(textures):
            entries[slug] = None  # silence has no spectrum
            continue
        if baseline.knows != "recording":  # as many takes as the model has
            request, groups = BaselineRequest(ratings), surfaces
            textures = baseline.sample(request, context.rng(f"{slug} unseen"))
        frictions = None
        if hasattr(baseline, "friction_coefficients"):
            # the same state of the generator: the friction that belongs to these textures
            frictions = baseline.friction_coefficients(request, context.rng(f"{slug} unseen"))
        entries[slug] = _Unseen(context, textures, groups, level(textures), frictions)
    names = [name for name in ("model", "knn_blend", "ridge", "mean_spectrum") if name in entries]
    shown = {name: entries[name].spectra for name in names}
    plot_unseen(shown, context.output / "unseen.png")
    table = {
        name: {slug: entry.leaves[name] if entry else number() for slug, entry in entries.items()}
        for name in ("nine_band_db", "level_r", "log_friction_r")
    }
    guidance = {scale: entry.leaves for scale, entry in by_guidance.items()}
    return table | {"guidance": guidance, "permuted": permuted.leaves}
