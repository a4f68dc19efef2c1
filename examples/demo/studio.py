"""From settings to textures and what is known of them, without a page: the studio behind it."""

import dataclasses
import functools
import threading
import time
from concurrent.futures import Future
from pathlib import Path

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
GATHER_SECONDS, TWO_FROM = 0.004, 4
NO_DALE = "The checkpoint {} has no `dale`: it reconstructs, it cannot generate."


@dataclasses.dataclass(frozen=True, eq=False)
class Texture:
    """One texture: (n,) float32 samples in N, and what belongs to them. NaN = unknown, or not specified."""

    studio: "Studio"
    samples: np.ndarray
    sampling_rate: int  # Hz
    friction_coefficient: float
    ratings: tuple  # asked for, z-scores
    seed: int | None  # None = it was recorded
    reference_speed: float  # mm/s
    checkpoint: str | None = None

    @property
    def seconds(self):
        """Duration, s."""
        return len(self.samples) / self.sampling_rate

    @functools.cached_property
    def rms(self):
        """N."""
        return float(rms(self.samples))

    @functools.cached_property
    def estimated(self):
        """Estimated ratings, z-scores. They take as long as the texture itself: only who looks at them pays."""
        [ratings] = self.studio.estimate(self.samples[None], self.sampling_rate, self.friction_coefficient)
        return ratings


class Studio:
    """Checkpoints, loaded and warm, that answer requests; nothing of a request is kept.

    Args:
        checkpoint (`str` or `Path`, *optional*): folder; defaults to the bundled one.
        surfaces (`Sequence`): folders of adapted checkpoints.

    Raises:
        OSError, ValueError: if one cannot be loaded, or has no DALE.
    """

    def __init__(self, checkpoint=None, surfaces=()):
        self.checkpoints = {}  # folders by name; the first is the page's own
        for folder in map(str, (checkpoint or bundled_checkpoint(), *surfaces)):
            name = Path(folder).absolute().name
            self.checkpoints[name if name not in self.checkpoints else f"{name} ({len(self.checkpoints)})"] = folder
        self.own, *others = self.checkpoints
        # one call at a time: two at once would each take twice as long; those that wait share the next one
        self._lock, self._waiting, self._guard = threading.RLock(), {}, threading.Lock()
        self._crowded = False
        self._pipes = {self.own: _load(self.checkpoints[self.own])}
        self.scale, self.steps = Scale(self._pipe().dale.config), self._pipe().resolve_steps()[0]
        for folder in map(self.checkpoints.get, others):  # they are loaded when they are first asked for
            if not Path(folder).is_dir():
                raise ValueError(f"`--surfaces` must be folders of adapted checkpoints, {folder} is no folder.")
            if not Path(folder, "dale").is_dir():
                raise ValueError(NO_DALE.format(folder))
            if list(DALEModel.load_config(folder, subfolder="dale")["rating_axes"]) != self.scale.axes:
                raise ValueError(f"The checkpoint {folder} has other axes than {self.scale.axes}.")
        self.generate((0.0,) * len(self.scale.axes))  # the first call of anything is slow

    def _pipe(self, checkpoint=None):
        name = checkpoint or self.own
        if name not in self.checkpoints:
            raise ValueError(f"There is no checkpoint {name!r}; there are {list(self.checkpoints)}.")
        if name not in self._pipes:
            with self._lock:
                if name not in self._pipes:  # whoever held the lock may have loaded it
                    self._pipes[name] = _load(self.checkpoints[name])
        return self._pipes[name]

    def generate(self, ratings, settings=None, checkpoint=None):
        """A [`Texture`] of ratings, z-scores, NaN = not specified.

        Raises:
            ValueError: for impossible ratings, or an unknown checkpoint.
        """
        settings, answer = settings or Settings(), Future()
        self._pipe(checkpoint)
        kind = (checkpoint or self.own, settings.guidance, settings.duration_s, settings.steps)
        with self._guard:
            self._waiting.setdefault(kind, []).append((tuple(ratings), settings.seed, answer))
        with self._lock:
            if self._crowded and not answer.done():  # those whom the last call answered ask again at once
                time.sleep(GATHER_SECONDS)
            while not answer.done():  # somebody else's call may have brought it
                with self._guard:
                    asked, rest = self._waiting[kind][:MOST_AT_ONCE], self._waiting.pop(kind)[MOST_AT_ONCE:]
                    self._waiting |= {kind: rest} if rest else {}
                self._answer(kind, asked)
        return answer.result()

    def _answer(self, kind, asked):
        """Makes the textures of several requests of one kind in one call."""
        checkpoint, guidance, duration_s, steps = kind
        self._crowded = len(asked) > 1
        torch.set_num_threads(2 if len(asked) >= TWO_FROM else 1)
        try:
            rows, seeds, _ = zip(*asked, strict=True)
            generators = [torch.Generator("cpu").manual_seed(seed) for seed in seeds]
            how = {"guidance_scale": guidance, "duration_s": duration_s, "num_inference_steps": steps}
            how["generator"] = generators if len(generators) > 1 else generators[0]
            made = self._textures(self._pipe(checkpoint)([list(row) for row in rows], **how), rows, seeds, checkpoint)
        except Exception as error:
            for *_, answer in asked:
                answer.set_exception(error)
        else:
            for (*_, answer), texture in zip(asked, made, strict=True):
                answer.set_result(texture)

    def estimate(self, samples, sampling_rate, friction_coefficient=None):
        """Estimated ratings of (n, samples), as tuples; NaN where the checkpoint cannot tell."""
        with self._lock:
            if self._pipe().rating_estimator is None:
                return [(np.nan,) * len(self.scale.axes)] * len(samples)
            found = self._pipe().estimate_ratings(samples, sampling_rate, friction_coefficient)
        return [tuple(float(value) for value in row) for row in found]

    def usual(self, ratings, guidance=Settings.guidance, checkpoint=None):
        """What takes of these ratings are like: (estimated ratings (takes, axes), textures (takes, samples), Hz)."""
        with self._lock:
            how = {"num_textures_per_rating": USUAL_TAKES, "guidance_scale": guidance}
            out = self._pipe(checkpoint)(list(ratings), generator=torch.Generator("cpu").manual_seed(0), **how)
            estimated = self.estimate(out.textures, out.sampling_rate, out.friction_coefficient)
        return np.array(estimated), out.textures, out.sampling_rate

    def edit(self, texture, settings=None, checkpoint=None, **options):
        """A [`Texture`] after an edit, by its own checkpoint unless another is given; `options` of
        `TactileTextureEditPipeline`, which says what it raises."""
        settings, checkpoint = settings or Settings(), checkpoint or texture.checkpoint
        with self._lock:
            pipe = TactileTextureEditPipeline.from_pipe(self._pipe(checkpoint))
            options["generator"] = torch.Generator("cpu").manual_seed(settings.seed)
            if "ratings" in options:
                options["friction_coefficient"] = texture.friction_coefficient
            out = pipe(texture.samples, texture.sampling_rate, num_inference_steps=settings.steps, **options)
        if np.isfinite(texture.friction_coefficient) and "ratings" not in options:
            out.friction_coefficient = np.array([texture.friction_coefficient])
        if moved := options.get("ratings"):  # from what is estimated, as the pipeline does
            before = zip(self.scale.axes, texture.estimated, strict=True)
            texture = dataclasses.replace(
                texture, ratings=tuple(z + moved[axis] if axis in moved else np.nan for axis, z in before)
            )
        return self._textures(out, [texture.ratings], [settings.seed], checkpoint)[0]

    def recorded(self, samples, sampling_rate):
        """A recording, (n,) in N and band-passed, as a [`Texture`] of the delivery rate."""
        samples = resample(samples, sampling_rate, DEVICE_RATE).astype(np.float32)
        return Texture(self, samples, DEVICE_RATE, np.nan, (np.nan,) * len(self.scale.axes), None, np.nan)

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
        return self._textures(out, ratings, [search.seed] * len(points), None)

    def _textures(self, out, ratings, seeds, checkpoint):
        rows = zip(out.textures.astype(np.float32), out.friction_coefficient.tolist(), ratings, seeds, strict=True)
        speed, name = out.reference_speed, checkpoint or self.own
        return [Texture(self, row, out.sampling_rate, *about, speed, name) for row, *about in rows]


def _load(folder):
    pipe = TactileTexturePipeline.from_pretrained(folder)
    if pipe.dale is None:
        raise ValueError(NO_DALE.format(folder))
    pipe.set_progress_bar_config(disable=True)
    return pipe
