"""From settings to textures and what is known of them, without a page: the studio behind it."""

import functools
import threading
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import torch
from settings import Scale, Settings

from tactile_diffusers import DALEModel
from tactile_diffusers.checkpoints import bundled_checkpoint
from tactile_diffusers.pipelines import TactileTextureEditPipeline, TactileTexturePipeline
from tactile_diffusers.search import PreferenceSearch
from tactile_diffusers.signal import DEVICE_RATE, resample, rms

#: Requests of visitors that are answered by one call, and takes behind the range of what is usual.
MOST_AT_ONCE, USUAL_TAKES = 8, 16
NO_DALE = "The checkpoint {} has no `dale`: it reconstructs, it cannot generate."


@dataclass(frozen=True, eq=False)
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

    @functools.cached_property
    def rms(self):
        """N."""
        return float(rms(self.samples))


class Studio:
    """Checkpoints, loaded and warm, that answer requests; nothing of a request is kept.

    Args:
        checkpoint (`str` or `Path`, *optional*): folder; defaults to the bundled one.
        surfaces (`Sequence`): folders of adapted checkpoints.

    Attributes:
        scale ([`Scale`]): of the sliders.
        checkpoints (`dict[str, Path]`): by name; the first is the page's own.
        steps (`int`): of its decoder, by default.

    Raises:
        OSError, ValueError: if one cannot be loaded, or has no DALE.
    """

    def __init__(self, checkpoint=None, surfaces=()):
        self.checkpoints = {}
        for folder in (checkpoint or bundled_checkpoint(), *surfaces):
            name = Path(folder).absolute().name
            self.checkpoints[name if name not in self.checkpoints else f"{name} ({len(self.checkpoints)})"] = str(
                folder
            )
        self.own = next(iter(self.checkpoints))
        # one call at a time: two at once would each take twice as long; those that wait share the next one
        self._lock, self._waiting, self._guard = threading.Lock(), {}, threading.Lock()
        self._loading = threading.Lock()
        self._pipes = {self.own: _load(self.checkpoints[self.own])}
        self.scale, self.steps = Scale(self._pipes[self.own].dale.config), self._pipes[self.own].resolve_steps()[0]
        for folder in list(self.checkpoints.values())[1:]:  # the others are loaded when they are first asked for
            if not Path(folder, "dale").is_dir():
                raise ValueError(NO_DALE.format(folder))
            if list(DALEModel.load_config(folder, subfolder="dale")["rating_axes"]) != self.scale.axes:
                raise ValueError(f"The checkpoint {folder} has other axes than {self.scale.axes}.")
        self.generate((0.0,) * len(self.scale.axes))  # the first call of anything is slow

    def _pipe(self, checkpoint=None):
        name = checkpoint or self.own
        if name not in self.checkpoints:
            raise ValueError(f"There is no checkpoint {name!r}; there are {list(self.checkpoints)}.")
        with self._loading:
            if name not in self._pipes:
                self._pipes[name] = _load(self.checkpoints[name])
        return self._pipes[name]

    def generate(self, ratings, settings=None, checkpoint=None):
        """A texture of ratings.

        Args:
            ratings (`Sequence[float]`): z-scores, NaN = not specified.
            settings ([`Settings`], *optional*): how.
            checkpoint (`str`, *optional*): name of one; default: the page's own.

        Returns:
            [`Texture`]

        Raises:
            ValueError: for impossible ratings, or an unknown checkpoint.
        """
        settings, answer = settings or Settings(), Future()
        self._pipe(checkpoint)
        kind = (checkpoint or self.own, settings.guidance, settings.duration_s, settings.steps)
        with self._guard:
            self._waiting.setdefault(kind, []).append((tuple(ratings), settings.seed, answer))
        with self._lock:
            while not answer.done():  # somebody else's call may have brought it
                with self._guard:
                    asked, rest = self._waiting[kind][:MOST_AT_ONCE], self._waiting.pop(kind)[MOST_AT_ONCE:]
                    self._waiting |= {kind: rest} if rest else {}
                self._answer(kind, asked)
        return answer.result()

    def _answer(self, kind, asked):
        """Makes the textures of several requests of one kind in one call."""
        checkpoint, guidance, duration_s, steps = kind
        try:
            rows, seeds, _ = zip(*asked, strict=True)
            generators = [torch.Generator("cpu").manual_seed(seed) for seed in seeds]
            pipe, how = self._pipe(checkpoint), {"guidance_scale": guidance, "duration_s": duration_s}
            how["generator"] = generators if len(generators) > 1 else generators[0]
            out = pipe([list(row) for row in rows], num_inference_steps=steps, **how)
            made = self._textures(pipe, out, rows, seeds, checkpoint)
        except Exception as error:
            for *_, answer in asked:
                answer.set_exception(error)
        else:
            for (*_, answer), texture in zip(asked, made, strict=True):
                answer.set_result(texture)

    def usual(self, ratings, settings, checkpoint=None):
        """What takes of these ratings are like: (estimated ratings (takes, axes), textures (takes, samples), Hz)."""
        with self._lock:
            pipe, generator = self._pipe(checkpoint), torch.Generator("cpu").manual_seed(0)
            how = {"num_textures_per_rating": USUAL_TAKES, "guidance_scale": settings.guidance, "generator": generator}
            out = pipe(list(ratings), **how)
            return np.array(_estimate(pipe, out, len(self.scale.axes))), out.textures, out.sampling_rate

    def edit(self, texture, settings=None, checkpoint=None, **options):
        """A texture after an edit; `options` of `TactileTextureEditPipeline`.

        Returns:
            [`Texture`]: of the delivery rate, or, where a stretch was filled, of the rate of the one that was given.

        Raises:
            ValueError: for an edit that cannot be made.
        """
        settings = settings or Settings()
        with self._lock:
            pipe = TactileTextureEditPipeline.from_pipe(self._pipe(checkpoint))
            options["generator"] = torch.Generator("cpu").manual_seed(settings.seed)
            if "ratings" in options:
                options["friction_coefficient"] = texture.friction_coefficient
            out = pipe(texture.samples, texture.sampling_rate, num_inference_steps=settings.steps, **options)
            if np.isfinite(texture.friction_coefficient) and "ratings" not in options:
                out.friction_coefficient = np.array([texture.friction_coefficient])
            return self._textures(self._pipe(checkpoint), out, [texture.ratings], [settings.seed], checkpoint)[0]

    def recorded(self, samples, sampling_rate):
        """A recording, (n,) in N and band-passed, as a [`Texture`] of the delivery rate."""
        with self._lock:
            pipe = self._pipe()
            samples, unknown = resample(samples, sampling_rate, DEVICE_RATE), (np.nan,) * len(self.scale.axes)
            out = SimpleNamespace(textures=samples[None], sampling_rate=DEVICE_RATE, friction_coefficient=None)
            [estimated] = _estimate(pipe, out, len(unknown))
        return Texture(samples.astype(np.float32), DEVICE_RATE, np.nan, unknown, estimated, None, np.nan)

    def search(self, axes, answers, seed):
        """A [`PreferenceSearch`] that was given these answers: (first, second, answer) each."""
        search = PreferenceSearch(self._pipe(), axes=axes, directions=0, seed=seed)
        for first, second, answer in answers:
            search.answer(answer, first, second)
        return search

    def textures_of(self, search, points):
        """Textures of points (n, dimensions) of a search."""
        with self._lock:
            out = search.space.textures(np.asarray(points))
            ratings = [tuple(row) for row in search.space.ratings(np.asarray(points)).tolist()]
            return self._textures(self._pipe(), out, ratings, [search.seed] * len(points), None)

    def _textures(self, pipe, out, ratings, seeds, checkpoint):
        estimated = _estimate(pipe, out, len(self.scale.axes))
        friction, speed, name = out.friction_coefficient, out.reference_speed, checkpoint or self.own
        return [
            Texture(samples, out.sampling_rate, float(friction[n]), ratings[n], estimated[n], seeds[n], speed, name)
            for n, samples in enumerate(out.textures.astype(np.float32))
        ]


def _load(folder):
    pipe = TactileTexturePipeline.from_pretrained(folder)
    if pipe.dale is None:
        raise ValueError(NO_DALE.format(folder))
    pipe.set_progress_bar_config(disable=True)
    return pipe


def _estimate(pipe, out, axes):
    """Estimated ratings of each texture, as tuples; NaN where the checkpoint cannot tell."""
    if pipe.rating_estimator is None:
        return [(np.nan,) * axes] * len(out.textures)
    found = pipe.estimate_ratings(out.textures, out.sampling_rate, out.friction_coefficient)
    return [tuple(float(value) for value in row) for row in found]
