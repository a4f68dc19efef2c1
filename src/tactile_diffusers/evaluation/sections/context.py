"""What all sections of a report share: the checkpoint, the data, the reference set and how much is measured."""

import inspect
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...data import PreparedDataset
from ...data.splits import SPLITS
from ...signal import band_edges, band_levels_db
from ..baselines import BaselineRequest, TrainingTextures, default_baselines, latent_rate
from ..held_out import check_fit, check_unseen
from ..metrics.reference import Reference
from ..sampling import generate, latent_summary, noise_seeds

#: What limits the rate of latents that no noise was added to in training: half precision, as they are stored.
HALF_PRECISION = 2.0**-11
# segments encoded to find the rate of the latents, textures encoded at once
_RATE_SEGMENTS, _BATCH = 200, 64


@dataclass(frozen=True)
class Settings:
    """How much is measured; `FULL` takes about an hour on one core, `QUICK` about ten minutes.

    Attributes:
        steps (`tuple[int, ...]`): of the step sweep.
        per_surface (`int`): non-overlapping segments per surface, of the reference and of what is held out.
        takes (`int`): textures generated per held-out surface.
        audio_textures (`int`): textures of the paper's distribution distance.
        novelty_textures (`int`): generated and real textures compared with training segments.
        novelty_segments (`int` or `None`): training segments searched; `None` = all.
        control_values (`tuple[float, ...]`): ratings of one axis while the others are not specified.
        control_takes (`int`): textures per value.
        truth_candidates, truth_surfaces (`int`): fresh virtual surfaces rated, and explored.
        truth_seconds (`float`): of each exploration.
        regression_surfaces (`int`): fresh virtual surfaces, draws, that a regression is fitted to.
        shift_step (`float`), shift_takes (`int`): of the paper's latent shift.
        spectra_step (`float`), spectra_takes (`int`): of the paper's average spectra.
        protocol_segments, protocol_repeats (`int`): of the paper's full-pipeline RMSE.
        repeats (`int`): of each timing.
        long_textures (`int`), long_seconds (`float`): long textures checked at their joints.
        anchor_steps (`tuple[int, ...]`): LCTG steps at which anchors are measured.
    """

    steps: tuple = (1, 2, 3, 4, 5, 6, 8, 10, 15, 25, 50)
    per_surface: int = 4
    takes: int = 16
    audio_textures: int = 500
    novelty_textures: int = 160
    novelty_segments: int | None = None
    control_values: tuple = (-2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0)
    control_takes: int = 100
    truth_candidates: int = 20_000
    truth_surfaces: int = 1500
    truth_seconds: float = 12.0
    regression_surfaces: int = 5000
    shift_step: float = 0.2
    shift_takes: int = 30
    spectra_step: float = 0.5
    spectra_takes: int = 50
    protocol_segments: int = 20
    protocol_repeats: int = 5
    repeats: int = 7
    long_textures: int = 4
    long_seconds: float = 30.0
    anchor_steps: tuple = (5, 10, 25)


FULL = Settings()
QUICK = Settings(
    steps=(1, 3, 5, 10, 25),
    per_surface=2,
    takes=16,
    audio_textures=120,
    novelty_textures=40,
    novelty_segments=3000,
    control_values=(-2.0, -1.0, 1.0, 2.0),
    control_takes=24,
    truth_candidates=8000,
    truth_surfaces=400,
    truth_seconds=8.0,
    regression_surfaces=600,
    shift_step=1.0,
    shift_takes=10,
    spectra_step=1.0,
    spectra_takes=12,
    protocol_segments=10,
    protocol_repeats=2,
    repeats=3,
    long_textures=1,
    long_seconds=10.0,
)


class Context:
    """One checkpoint on one data set.

    Args:
        pipe (`TactileTexturePipeline`): with or without DALE.
        data (`str` or `Path`): a prepared data set of the pipeline's band and segment length; textures are compared at
            its rate.
        split (`str`): held-out surfaces: any of the data's splits but "train", so "test" or, of data that have it,
            "hard".
        settings (`Settings`): how much is measured.
        seed (`int`): of every choice and every noise.
        output (`Path`): where figures go.
        guidance_scales (`tuple[float, ...]`, *optional*): besides 1.0 (off) and the pipeline's default.
        embedding (`Callable`, *optional*): of the audio distance; see `frechet_audio_distance`.
        vibromaf (`bool`): whether to add the optional metrics of vibromaf.
        quiet (`bool`): no progress bars.
        anchors (`dict[str, Anchor]`, *optional*): name -> checkpoint to compare reconstructions with.
        baseline_surfaces (`int`, *optional*): training surfaces that baselines learn from, for a checkpoint that
            learned from so many (`--max_train_surfaces`); the judge and the reference keep all.

    Raises:
        ValueError: if the checkpoint or an anchor does not fit the data, `split` is unknown or not held out, or the
            data have nothing in it or train on its surfaces.
    """

    def __init__(
        self,
        pipe,
        data,
        split,
        settings,
        seed,
        output,
        guidance_scales=(),
        embedding=None,
        vibromaf=False,
        quiet=True,
        anchors=None,
        baseline_surfaces=None,
    ):
        if split not in SPLITS[1:]:
            raise ValueError(f"`split` must be held out, one of {SPLITS[1:]}, got {split!r}.")
        self.pipe, self.split, self.settings, self.seed, self.quiet = pipe, split, settings, seed, quiet
        self.output, self.embedding, self.vibromaf = output, embedding, vibromaf
        self.anchors, self.baseline_surfaces = dict(anchors or {}), baseline_surfaces
        self.held_out, self.train = PreparedDataset(data, split), PreparedDataset(data, "train")
        check_unseen(self.held_out, self.train)
        check_fit(pipe, self.held_out)
        for name, anchor in self.anchors.items():
            check_fit(anchor.pipe, self.held_out, f"anchor {name}")
        self.rate, self.edges = self.held_out.sampling_rate, band_edges(9, self.held_out.band)
        defaults = inspect.signature(type(pipe).__call__).parameters
        self.steps, _ = pipe.resolve_steps()  # of LCTG, but for the step sweep
        self.default_guidance = float(defaults["guidance_scale"].default)
        self._generated = {}
        self.guidance_scales = sorted({1.0, self.default_guidance, *map(float, guidance_scales)})
        _ = self.chosen  # refuses data without another take before any work

    def rng(self, purpose):
        """A random generator of its own for each purpose, so that sections do not depend on each other's order."""
        return np.random.default_rng([self.seed, *purpose.encode()])

    def frictions(self, dataset, rows):
        """(n,) friction coefficients of segments; all NaN unless all of the held-out and training data have one."""
        known = (self.held_out.friction_coefficients[np.concatenate(self.chosen)], self.train.friction_coefficients)
        if not all((values > 0).all() for values in known):  # NaN fails too
            return np.full(len(rows), np.nan)
        return dataset.friction_coefficients[rows]

    @cached_property
    def knows_friction(self):
        """Whether friction is part of what is compared."""
        return bool(np.isfinite(self.real_frictions).all())

    @cached_property
    def real_frictions(self):
        """(n,) of the chosen held-out segments."""
        return self.frictions(self.held_out, self.chosen[0])

    @cached_property
    def training(self):
        """Non-overlapping segments of the training surfaces: the reference, and what baselines and judge learn from."""
        train = self.train
        rows = train.non_overlapping(self.settings.per_surface, self.seed)
        surfaces = train.surface_ids[rows]
        ratings = train.surface_ratings[surfaces]
        frictions = self.frictions(train, rows)
        return TrainingTextures(train.textures(rows), ratings, frictions, surfaces, self.rate, train.band)

    @cached_property
    def known_training(self):
        """What baselines learn from: `training`, or `baseline_surfaces` surfaces of it."""
        training = self.training
        if self.baseline_surfaces is None:
            return training
        kept = PreparedDataset(self.train.path, "train", max_surfaces=self.baseline_surfaces).surface_ids
        rows = np.isin(training.surface_ids, kept)
        fields = ("textures", "ratings", "friction_coefficients", "surface_ids")
        return replace(training, **{name: getattr(training, name)[rows] for name in fields})

    @cached_property
    def reference(self):
        """The embedded training surfaces."""
        return Reference(self.training.textures, self.rate, self.training.surface_ids)

    @cached_property
    def chosen(self):
        """Indices of held-out segments and, for each, of another take of its surface: two arrays (n,).

        No two of them share a sample, so that what is known of one half is not read off the other.
        """
        rows = self.held_out.non_overlapping(2 * self.settings.per_surface, self.seed)
        rows = self.rng("halves").permutation(rows)
        first, second = [], []
        for surface in np.unique(self.held_out.surface_ids[rows]):
            own = rows[self.held_out.surface_ids[rows] == surface]
            half = len(own) // 2
            first, second = [*first, *own[:half]], [*second, *own[half : 2 * half]]
        if len(np.unique(self.held_out.surface_ids[np.array(first, dtype=int)])) < 2:
            raise ValueError(
                f"`data` must have two surfaces or more with two segments each that share no sample in the split "
                f"{self.split!r}, to compare with another take and another surface. Record longer, or "
                "hold more out: `--test 2` or more of examples/prepare_data.py; then train again, since what is held "
                "out now was trained on."
            )
        return np.array(first), np.array(second)

    @cached_property
    def surfaces(self):
        """(n,) surface of each chosen segment."""
        return self.held_out.surface_ids[self.chosen[0]]

    @cached_property
    def real(self):
        """(n, samples) the chosen held-out segments, N."""
        return self.held_out.textures(self.chosen[0])

    @cached_property
    def real_bands(self):
        """(n, 9) their band levels, dB re 1 N^2."""
        return band_levels_db(self.real, self.rate, self.edges)

    @cached_property
    def real_points(self):
        """(n, 53) their embeddings."""
        return self.reference.embed(self.real)

    @cached_property
    def real_distances(self):
        """FTD and KTD of the held-out segments to the reference: what no generator can be expected to beat."""
        return self.reference.distances(self.real_points, self.surfaces)

    @cached_property
    def request(self):
        """The held-out segments as baselines see them."""
        ratings = self.held_out.surface_ratings[self.surfaces]
        return BaselineRequest(ratings, self.real, self.held_out.textures(self.chosen[1]))

    @cached_property
    def baselines(self):
        """Fitted baselines by slug; those that work from ratings only where there are ratings."""
        made = default_baselines(*self.latent_rate)
        training = self.known_training
        rated = np.isfinite(training.ratings).all(-1).any()
        return {slug: b.fit(training) for slug, b in made.items() if rated or b.knows != "ratings"}

    @cached_property
    def latent_rate(self):
        """`rate_of` the checkpoint's latents."""
        return self.rate_of(self.pipe)

    def rate_of(self, pipe):
        """Numbers per second of a pipeline's latents and the bits that each carries."""
        config = pipe.lctg.config
        spaced = np.linspace(0, len(self.training.textures) - 1, _RATE_SEGMENTS).astype(int)
        latents = _encode(pipe, self.training.textures[np.unique(spaced)], self.rate)
        sigma = config.latent_noise or HALF_PRECISION
        frames_per_second = pipe.feature_extractor.sampling_rate / config.latent_hop
        return config.latent_channels * frames_per_second, float(latent_rate(latents, sigma))

    @cached_property
    def baseline_textures(self):
        """What each baseline answers to the held-out segments: slug -> (n, samples)."""
        return {slug: made.sample(self.request, self.rng(slug)) for slug, made in self.baselines.items()}

    @cached_property
    def baseline_points(self):
        """Their embeddings: slug -> (n, 53)."""
        return {slug: self.reference.embed(textures) for slug, textures in self.baseline_textures.items()}

    @cached_property
    def different(self):
        """(n, samples) for each chosen segment one of another surface."""
        rng, rows = self.rng("different"), np.arange(len(self.surfaces))
        return self.real[[rng.choice(rows[self.surfaces != surface]) for surface in self.surfaces]]

    @cached_property
    def requests(self):
        """Ratings of the held-out surfaces, `takes` rows each, and their surfaces: (n, 3) and (n,)."""
        surfaces = np.repeat(np.unique(self.surfaces), self.settings.takes)
        return self.held_out.surface_ratings[surfaces], surfaces

    def generated(self, guidance_scale):
        """Textures for `requests`, each from noise of its own."""
        if guidance_scale not in self._generated:
            ratings, _ = self.requests
            seeds = noise_seeds([self.seed, 1], len(ratings))
            self._generated[guidance_scale] = self.generate(ratings, seeds, guidance_scale)
        return self._generated[guidance_scale]

    def matching(self):
        """Rows of `requests` as many for each surface as there are held-out segments of it: sets of equal size."""
        _, surfaces = self.requests
        counts = {surface: int((self.surfaces == surface).sum()) for surface in np.unique(self.surfaces)}
        take = np.arange(len(surfaces)) % self.settings.takes
        return np.flatnonzero(take < [counts[surface] for surface in surfaces])

    def generate(self, ratings, seeds, guidance_scale, decode=True):
        """`generate` at the data's rate and segment length."""
        return generate(
            self.pipe,
            ratings,
            seeds,
            self.rate,
            self.held_out.segment_samples,
            self.steps,
            guidance_scale,
            decode,
            quiet=self.quiet,
        )

    def encode(self, textures):
        """Base layer of the latents, which is what DALE generates: (n, base_channels, frames) float32."""
        return self.encode_all(textures)[:, : self.pipe.lctg.base_channels]

    def encode_all(self, textures):
        """All layers of the latents: (n, latent_channels, frames) float32."""
        return _encode(self.pipe, textures, self.rate)

    def summarise(self, textures):
        """`latent_summary` of textures."""
        return latent_summary(self.encode(textures))


def _encode(pipe, textures, rate):
    parts = [textures[start : start + _BATCH] for start in range(0, len(textures), _BATCH)]
    return np.concatenate([pipe.encode(part, rate).latents.float().cpu().numpy() for part in parts])
