"""From settings to textures and what is known of them, without a page: the studio behind it."""

import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from bands import BandRange, draw_latents, estimated_range, rating_range, training_range
from settings import Settings, novelty

from tactile_diffusers.checkpoints import bundled_checkpoint
from tactile_diffusers.pipelines import TactileTextureEditPipeline, TactileTexturePipeline
from tactile_diffusers.signal import RATING_AXES, nine_band_error_db, resample, rms

#: Seed of the draws behind the ranges of bands: they must not move while a visitor tries seeds.
_RANGE_SEED = 0


@dataclass(frozen=True)
class Texture:
    """One texture and what belongs to it.

    Args:
        samples (`np.ndarray`): (n,) float32, N, zero mean.
        sampling_rate (`int`): Hz.
        friction_coefficient (`float`): NaN = unknown.
        ratings (`tuple[float, ...]`): asked for, z-scores, NaN = not specified.
        estimated (`tuple[float, ...]`): what `estimate_ratings` hears, z-scores; NaN = the checkpoint cannot tell.
        seed (`int`): that made it; `None` = it was recorded.
        reference_speed (`float`): mm/s; NaN = unknown.
        checkpoint (`str`, *optional*): name of the one that made it.
    """

    samples: np.ndarray
    sampling_rate: int
    friction_coefficient: float
    ratings: tuple
    estimated: tuple
    seed: int | None
    reference_speed: float
    checkpoint: str | None = None

    @property
    def seconds(self):
        """Duration, s."""
        return len(self.samples) / self.sampling_rate

    @property
    def rms(self):
        """N."""
        return float(rms(self.samples))


@dataclass(frozen=True)
class Result:
    """The answer to one request.

    Args:
        textures (`list[Texture]`): rating by rating, take by take.
        settings (`Settings`): that they were made with.
        seconds (`float`): s.
        likely (`BandRange`, *optional*): of the first ratings; `None` = the checkpoint cannot tell.
        training (`BandRange`, *optional*): of the training textures.
        usual (`np.ndarray`, *optional*): (2, axes) z-scores between which textures of the first ratings are estimated.
        note (`str`): a warning, or empty.
    """

    textures: list[Texture] = field(repr=False)
    settings: Settings
    seconds: float
    likely: BandRange | None
    training: BandRange | None
    usual: np.ndarray | None = None
    note: str = ""


@dataclass(frozen=True)
class Reconstruction:
    """A recording and what the codec makes of it, both [`Texture`] of one rate, and their nine-band error in dB."""

    recorded: Texture
    decoded: Texture
    nine_band_db: float


class Studio:
    """A checkpoint, loaded and warm, that answers one request at a time; nothing of a request is kept.

    Args:
        checkpoint (`str` or `Path`, *optional*): folder; defaults to the bundled one.

    Raises:
        OSError, ValueError: if it cannot be loaded, or has no DALE.
    """

    def __init__(self, checkpoint=None):
        folder = str(checkpoint or bundled_checkpoint())
        self._name = Path(folder).resolve().name
        self._shared = TactileTexturePipeline.from_pretrained(folder)
        if self._shared.dale is None:
            raise ValueError(f"The checkpoint {folder} has no `dale`: it reconstructs, it cannot generate.")
        self._shared.set_progress_bar_config(disable=True)
        # one at a time: two at once would each take twice as long, and twice the memory
        self._lock = threading.Lock()
        self._training = training_range(self._shared, _RANGE_SEED)
        self.config = self._shared.dale.config
        self.generate([(0.0,) * len(RATING_AXES)])  # the first call of anything is slow

    @property
    def distilled_steps(self):
        """Steps up to which the distilled decoder is used; 0 = there is none."""
        distilled = self._shared.lctg_distilled
        return 0 if distilled is None else distilled.config.distilled_steps

    def _pipeline(self, settings):
        """A pipeline of its own for these settings; models are shared."""
        schedulers, order = ("scheduler", "dale_scheduler"), {"multistep_order": settings.order}
        parts = {name: getattr(self._shared, name) for name in schedulers[settings.steps <= self.distilled_steps :]}
        parts = {name: type(one).from_config(one.config, **order) for name, one in parts.items()}
        return TactileTexturePipeline.from_pipe(self._shared, **parts)

    def generate(self, ratings, settings=None):
        """Textures of ratings.

        Args:
            ratings (`Sequence[Sequence[float]]`): rows of z-scores, NaN = not specified.
            settings (`Settings`, *optional*): how.

        Returns:
            [`Result`]

        Raises:
            ValueError: for impossible ratings.
        """
        settings = settings or Settings()
        start = time.perf_counter()
        seeds = [settings.seed + take for take in range(settings.takes)] * len(ratings)
        with self._lock:
            pipe = self._pipeline(settings)
            latent_steps = min(settings.latent_steps, pipe.dale.config.distilled_steps or settings.latent_steps)
            out = pipe(
                [list(row) for row in ratings],
                num_inference_steps=settings.steps,
                num_latent_inference_steps=latent_steps,
                guidance_scale=settings.guidance,
                num_textures_per_rating=settings.takes,
                duration_s=settings.duration_s,
                generator=[torch.Generator("cpu").manual_seed(seed) for seed in seeds],
            )
            estimated = _estimate(pipe, out.textures, out.sampling_rate, out.friction_coefficient)
            drawn = draw_latents(pipe, ratings[0], latent_steps, settings.guidance, _RANGE_SEED)
            likely, usual = rating_range(pipe, drawn), estimated_range(pipe, drawn)
        textures = [
            Texture(
                samples=samples,
                sampling_rate=out.sampling_rate,
                friction_coefficient=float(out.friction_coefficient[number]),
                ratings=tuple(ratings[number // settings.takes]),
                estimated=estimated[number],
                seed=seeds[number],
                reference_speed=out.reference_speed,
                checkpoint=self._name,
            )
            for number, samples in enumerate(out.textures)
        ]
        notes = dict.fromkeys(filter(None, (novelty(row, self.config) for row in ratings)))
        seconds = time.perf_counter() - start
        return Result(textures, settings, seconds, likely, self._training, usual, " ".join(notes))

    def reconstruct(self, samples, sampling_rate, settings=None):
        """A recording through encoder and decoder, beside itself at the delivery rate.

        Args:
            samples (`np.ndarray`): (n,), N, band-passed.
            sampling_rate (`int`): Hz.
            settings (`Settings`, *optional*): steps, order and seed are used.

        Returns:
            [`Reconstruction`]
        """
        settings = settings or Settings()
        with self._lock:
            pipe = self._pipeline(settings)
            generator = torch.Generator("cpu").manual_seed(settings.seed)
            out = pipe.reconstruct(samples, sampling_rate, num_inference_steps=settings.steps, generator=generator)
            decoded, rate = out.textures[0], out.sampling_rate
            recorded = resample(samples, sampling_rate, rate).astype(np.float32)
            size = min(len(recorded), len(decoded))
            pair = np.stack([recorded[:size], decoded[:size]])
            estimated = _estimate(pipe, pair, rate, None)
        unknown = (np.nan,) * len(RATING_AXES)
        textures = [
            Texture(row, rate, np.nan, unknown, estimated[number], seed, out.reference_speed)
            for number, (row, seed) in enumerate(zip(pair, (None, settings.seed), strict=True))
        ]
        return Reconstruction(*textures, float(nine_band_error_db(pair[1], pair[0], rate)))

    def edit(self, samples, sampling_rate, settings=None, **options):
        """A texture before and after an edit, at one rate.

        Args:
            samples (`np.ndarray`): (n,), N, band-passed.
            sampling_rate (`int`): Hz.
            settings (`Settings`, *optional*): steps, order and seed are used.
            options: of `TactileTextureEditPipeline`.

        Returns:
            `tuple[Texture, Texture]`

        Raises:
            ValueError: for an edit that cannot be made.
        """
        settings = settings or Settings()
        with self._lock:
            pipe = TactileTextureEditPipeline.from_pipe(self._pipeline(settings))
            generator = torch.Generator("cpu").manual_seed(settings.seed)
            out = pipe(samples, sampling_rate, num_inference_steps=settings.steps, generator=generator, **options)
            before = resample(samples, sampling_rate, out.sampling_rate).astype(np.float32)
            pair = before, out.textures[0].astype(np.float32)
            frictions = np.nan, float(out.friction_coefficient[0])
            estimated = [_estimate(pipe, row[None], out.sampling_rate, None)[0] for row in pair]
        unknown = (np.nan,) * len(RATING_AXES)
        return tuple(
            Texture(row, out.sampling_rate, friction, unknown, found, None, out.reference_speed)
            for row, friction, found in zip(pair, frictions, estimated, strict=True)
        )


def _estimate(pipe, textures, sampling_rate, friction_coefficient):
    """Estimated ratings of each texture, as tuples; NaN where the checkpoint cannot tell."""
    if pipe.rating_estimator is None:
        return [(np.nan,) * len(RATING_AXES)] * len(textures)
    found = pipe.estimate_ratings(textures, sampling_rate, friction_coefficient)
    return [tuple(float(value) for value in row) for row in found]
