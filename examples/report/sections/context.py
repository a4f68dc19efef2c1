"""What the sections of a report share: one checkpoint on one data set, and how much is measured."""

import inspect
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tactile_diffusers.data.dataset import check_fit

from ..baselines import default_baselines, latent_rate
from ..held_out import HeldOutData, open_held_out, random_generator
from ..sampling import encode, generate, noise_seeds

#: Limits the rate of latents that were trained without noise: half precision, as they are stored.
HALF_PRECISION = 2.0**-11
# segments encoded to find the rate of the latents
_RATE_SEGMENTS = 200


@dataclass(frozen=True)
class Settings:
    """How much is measured; on two cores and 60 held-out surfaces `FULL` takes 20 minutes, `QUICK` three."""

    steps: tuple = (1, 2, 3, 4, 5, 6, 8, 10, 25)  # of the step sweep
    per_surface: int = 4  # non-overlapping segments, of the reference and of what is held out
    takes: int = 16  # textures generated per held-out surface
    judge_takes: int = 3  # of a held-out surface in each part that the second judge gives them
    control_values: tuple = (-2.0, -1.0, 1.0, 2.0)  # of one axis, the others not specified
    control_takes: int = 400  # textures per value: of 100, log friction has a standard error of the tolerance
    response_takes: int = 24  # textures per value of the response curves
    truth_candidates: int = 20_000  # fresh virtual surfaces that are rated
    truth_surfaces: int = 1500  # and explored
    truth_seconds: float = 12.0  # of each exploration
    regression_surfaces: int = 5000  # fresh virtual surfaces that a regression is fitted to
    equal_surfaces: int = 2000  # fresh ones for baselines of control: as many as the bundled checkpoint learned from
    paper_step: float = 0.5  # of ratings, in the paper's mean spectra
    paper_takes: int = 50
    protocol_segments: int = 20  # of the paper's full-pipeline RMSE
    protocol_repeats: int = 5
    repeats: int = 7  # of each timing


FULL = Settings()
QUICK = Settings(
    steps=(1, 5, 10),
    per_surface=2,
    takes=6,
    judge_takes=1,
    control_takes=24,
    response_takes=8,
    truth_candidates=8000,
    truth_surfaces=400,
    truth_seconds=8.0,
    regression_surfaces=600,
    equal_surfaces=200,
    paper_step=1.0,
    paper_takes=12,
    protocol_segments=10,
    protocol_repeats=2,
    repeats=3,
)


@dataclass(eq=False)
class Context:
    """One checkpoint on one data set, and how much is measured; make it with `make_context`.

    `output` is for pictures.
    """

    pipe: object
    data: HeldOutData
    settings: Settings
    seed: int
    output: object
    guidance_scales: list
    quiet: bool = True

    @property
    def steps(self):
        """The pipeline's default number of LCTG steps."""
        return self.pipe.resolve_steps()[0]

    @property
    def default_guidance(self):
        """The pipeline's default guidance scale."""
        return _default_guidance(self.pipe)

    @property
    def axes(self):
        """Names of the axes of ratings: those that the checkpoint knows."""
        return self.data.dataset.ratings.axes

    @property
    def requests(self):
        """Ratings of the held-out surfaces, `takes` rows each, and their surfaces: (n, axes) and (n,)."""
        surfaces = np.repeat(np.unique(self.data.surfaces), self.settings.takes)
        return self.data.dataset.ratings.mean[surfaces], surfaces

    @cached_property
    def latent_rate(self):
        """Numbers per second of the pipeline's latents, and the bits that each carries, on training segments."""
        config, latents = self.pipe.lctg.config, encode(self.pipe, spaced_training(self.data), self.data.rate)
        frames_per_second = self.pipe.feature_extractor.sampling_rate / config.latent_hop
        return config.latent_channels * frames_per_second, latent_rate(latents, config.latent_noise or HALF_PRECISION)

    @cached_property
    def baselines(self):
        """Fitted baselines by slug; those that work from ratings only where there are ratings."""
        training = self.data.training
        rated = np.isfinite(training.ratings).all(-1).any()
        made = default_baselines(*self.latent_rate)
        return {slug: b.fit(training) for slug, b in made.items() if rated or b.knows != "ratings"}

    @cached_property
    def baseline_textures(self):
        """What each baseline answers to the held-out segments: slug -> (n, samples)."""
        return {slug: b.sample(self.data.request, self.rng(slug)) for slug, b in self.baselines.items()}

    @cached_property
    def baseline_points(self):
        """Their embeddings: slug -> (n, features)."""
        return {slug: self.data.reference.embed(textures) for slug, textures in self.baseline_textures.items()}

    @cached_property
    def generated(self):
        """Textures for `requests`, each from noise of its own: guidance scale -> `Generated`."""
        ratings, _ = self.requests
        return {scale: self.generate(ratings, self.seeds(1, len(ratings)), scale) for scale in self.guidance_scales}

    def rng(self, purpose):
        """`random_generator` of the evaluation's seed."""
        return random_generator(self.seed, purpose)

    def seeds(self, purpose, takes):
        """(takes,) seeds of noise; each `purpose` (`int`) has its own."""
        return noise_seeds([self.seed, purpose], takes)

    def generate(self, ratings, seeds, guidance_scale, decode=True):
        """`sampling.generate` at the data's rate and segment length."""
        grid = (self.data.rate, self.data.dataset.segment_samples, self.steps)
        return generate(self.pipe, ratings, seeds, *grid, guidance_scale, decode, quiet=self.quiet)


def make_context(pipe, data, split, settings, seed, output, quiet=True):
    """A checkpoint and a prepared data set, checked against each other: a `Context`.

    A ValueError if the checkpoint does not fit the data, or as of `open_held_out`.
    """
    held_out = open_held_out(data, split, settings.per_surface, seed)
    check_fit(pipe, held_out.dataset)
    if pipe.dale is not None:  # which may know more axes than three, or other ones
        held_out.dataset.set_axes(pipe.dale.config.rating_axes)
        held_out.train.set_axes(pipe.dale.config.rating_axes)
    scales = sorted({1.0, _default_guidance(pipe)})
    return Context(pipe, held_out, settings, seed, output, scales, quiet)


def _default_guidance(pipe):
    return float(inspect.signature(type(pipe).__call__).parameters["guidance_scale"].default)


def spaced_training(data):
    """(n, samples) up to 200 training segments, evenly spaced, on which rates of latents are counted."""
    textures = data.training.textures
    return textures[np.unique(np.linspace(0, len(textures) - 1, _RATE_SEGMENTS).astype(int))]
