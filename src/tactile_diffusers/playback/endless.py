"""Textures without end: fresh takes of the same ratings, generated where the finger goes."""

import threading

import numpy as np
import torch

from ..pipelines.inputs import parse_ratings
from .generating import GeneratingProcess
from .profile import TextureProfile
from .stream import TextureStream

#: Share of a take that overlaps the next one, where both become one in latent space.
OVERLAP = 0.25
#: Part of that overlap over which the profile of one window gives way to the next one's: away from both ends, which
#: fade out, and where a decoder sees too little of what surrounds it.
HANDOVER = (0.25, 0.75)
#: Windows kept: what a finger nears and has just left, on three axes of a plane. The others come again as they were.
LARGEST_CACHE = 12
#: Distance between the places of the three axes of a plane, in windows.
_AXIS_WINDOWS = 2**20
#: Reads of a profile in which a window counts as near the finger: 0.2 s of blocks of 32.
_RECENT_READS = 60
#: Speeds that windows are made ready for ahead of the finger, mm/s.
_SPEEDS = (20.0, 320.0)
#: Time between two looks at what the finger nears, s.
_PAUSE = 0.01


class EndlessProfile:
    """A profile over position that never repeats: window after window, each generated when the finger nears it.

    Windows are as long as a segment (133 mm with the bundled checkpoint: 1.64 s at its reference speed of 81.3 mm/s)
    and overlap by a quarter. All are takes of the same ratings
    with level, mean spectrum and friction coefficient of the first: one surface. Where they overlap their latents fade
    into each other at constant variance, and both windows are decoded there from the same latents and the same noise,
    so that they nearly agree when the profile passes from one to the other. A window depends on the seed and its place
    alone: whoever comes back finds what was there, to rounding.

    It is read like a [`TextureProfile`]. `read` never waits: where a window is not there yet, another one stands in
    until the finger has left its place (`substituted` counts). One thread may generate while another one reads.

    Args:
        pipe (`TactileTexturePipeline` or `GeneratingProcess`): with a DALE; for one thread at a time.
        ratings: of one texture, as `pipe` takes them.
        seed (`int`, *optional*, defaults to 0): of everything.
        fill (`bool`, *optional*, defaults to `True`): see [`TextureProfile`].
        **options: of `pipe`: `rating_scale`, `guidance_scale`, `num_inference_steps`, `num_latent_inference_steps`.

    Attributes:
        level, friction_coefficient (`float`): of the surface; `None` before the first `generate`.
        reference_speed (`float`): mm/s.
        spacing, window_length (`float`): mm from window to window, and of each.
        substituted (`int`): windows that another one stood in for.

    Raises:
        ValueError: for impossible ratings or options, or a checkpoint without DALE or reference speed.
    """

    def __init__(self, pipe, ratings, seed=0, fill=True, **options):
        self.source, pipe = pipe, getattr(pipe, "pipe", pipe)
        speed = None if pipe.dale is None else pipe.dale.config.reference_speed
        if speed is None:
            raise ValueError("`pipe` has no `dale`, or it knows no `reference_speed`: nothing to place on a surface.")
        if not 0 <= int(seed) < 2**32:
            raise ValueError(f"`seed` must lie in [0, 2^32), got {seed}.")
        latent = {name: value for name, value in options.items() if name != "num_inference_steps"}
        latent_steps = latent.get("num_latent_inference_steps")
        self._steps, latent["num_latent_inference_steps"] = pipe.resolve_steps(
            options.get("num_inference_steps"), latent_steps
        )
        ratings = parse_ratings(ratings, pipe.dale.config, latent.pop("rating_scale", "z"))
        if len(ratings) != 1:
            raise ValueError(f"`ratings` must be those of one texture, got {len(ratings)}.")
        self.pipe, self.ratings, self.seed, self.fill = pipe, ratings, int(seed), fill
        self.options, self._latent_options = options, latent
        self.reference_speed = float(speed)
        self._overlap = round(OVERLAP * pipe.dale.config.latent_frames)
        frames = pipe.dale.config.latent_frames
        seconds = frames * pipe.lctg.config.latent_hop / pipe.feature_extractor.sampling_rate
        self.window_length = seconds * self.reference_speed
        self.spacing = self.window_length * (1 - self._overlap / frames)
        self.length = 3 * _AXIS_WINDOWS * self.spacing
        self.level = self.friction_coefficient = self._spectrum = None
        self.substituted = self._reads = 0
        self._key = self.source.new_key() if isinstance(self.source, GeneratingProcess) else None
        self._takes, self._windows, self._stand_ins, self._recent = {}, {}, {}, {}

    # --- what the generating thread does

    def generate(self, *indices, ready=False):
        """Makes windows in one batch; those that are there are left. Given up without a trace if `pipe.interrupt`.

        Args:
            indices (`int`): of windows; window k begins at k x `spacing`.
            ready (`bool`, *optional*, defaults to `False`): makes all resolutions for 20-320 mm/s, too; otherwise each
                is made when it is first read.
        """
        indices = [index for index in dict.fromkeys(indices) if index not in self._windows]
        if not indices:
            return
        if self._key is not None:
            surface = (self.ratings.numpy(), self.seed, self.fill, {**self.options, "rating_scale": "z"})
            made = self.source.generate(self._key, surface, indices, list(self._recent), ready)
            windows, self.level, self.friction_coefficient = made
            self._windows.update(windows)
            self._forget()
            return
        if not self._generate_takes({index + near for index in indices for near in (-1, 0, 1)}):
            return
        base = torch.stack([self._joined(index) for index in indices])
        samples = base.shape[-1] * self.pipe.lctg.config.latent_hop
        noise = torch.stack([self._noise(index, "decoder", samples) for index in indices])[:, None]
        level = torch.full((len(indices),), self.level)
        made = self.pipe.decode(self.pipe.lctg.pad_detail(base), level, None, self._steps, noise=noise)
        if self.pipe.interrupt:
            return
        for index, texture in zip(indices, made.textures, strict=True):
            filling = self._noise(index, "filling", len(texture)).numpy() if self.fill else None
            window = TextureProfile(
                texture, made.sampling_rate, self.reference_speed, fill=self.fill, repeats=False, noise=filling
            )
            if ready:
                window.prepare(*_SPEEDS)
            self._windows[index] = window
        self._forget()

    def interrupt(self):
        """Makes a `generate` of another thread give up at its next step."""
        if self._key is not None:
            self.source.interrupt()
        self.pipe._interrupt = True

    def _generate_takes(self, indices):
        """Latents of DALE, all of them with the first one's scalars; whether they came about."""
        if self._spectrum is None:
            indices = indices | {0}
        indices = sorted(indices - self._takes.keys())
        if indices:
            generators = [self._generator("take", index) for index in indices]
            made = self.pipe(
                self.ratings,
                num_textures_per_rating=len(indices),
                generator=generators,
                output_type="latent",
                **self._latent_options,
            )
            if self.pipe.interrupt:
                return False
            levels, base = self.pipe.lctg.level_channels, self.pipe.lctg.base_channels
            if self._spectrum is None:
                first = indices.index(0)
                self._spectrum = made.latents[first, :levels].mean(-1, keepdim=True)
                self.level = float(made.level[first])
                self.friction_coefficient = float(made.friction_coefficient[first])
            for index, latents in zip(indices, made.latents[:, :base], strict=True):
                shape = latents[:levels] - latents[:levels].mean(-1, keepdim=True)
                self._takes[index] = torch.cat([shape + self._spectrum, latents[levels:]])
        return True

    def _joined(self, index):
        """Latents of a window: its take, whose ends fade into its neighbours': (base_channels, frames)."""
        before, own, after = (self._takes[index + near] for near in (-1, 0, 1))
        size = self._overlap
        beginning = _faded(before, own, before[:, -size:], own[:, :size])
        end = _faded(own, after, own[:, -size:], after[:, :size])
        return torch.cat([beginning, own[:, size:-size], end], dim=1)

    def _noise(self, index, purpose, samples):
        """White noise over a window, the same as its neighbours' where they overlap: (samples,)."""
        spacing = round(samples * (1 - OVERLAP))
        parts = [torch.randn(spacing, generator=self._generator(purpose, place)) for place in (index, index + 1)]
        return torch.cat(parts)[:samples]

    def _generator(self, purpose, index):
        key = [self.seed, *purpose.encode(), index % 2**32]
        return torch.Generator().manual_seed(int(np.random.SeedSequence(key).generate_state(1)[0]))

    def _forget(self):
        """Drops the windows farthest from the finger, and takes that no window nearby needs."""
        near = list(self._recent) or [0]

        def distance(index):
            return min(abs(index - other) for other in near)

        for index in sorted(self._windows, key=distance)[LARGEST_CACHE:]:
            del self._windows[index]
        for index in [index for index in self._takes if min(abs(index - kept) for kept in self._windows) > 2]:
            del self._takes[index]

    # --- what the reading thread does

    def coverage(self, speed):
        """As [`TextureProfile.coverage`]."""
        return next(iter(self._windows.values())).coverage(speed)

    def read(self, position, speed):
        """As [`TextureProfile.read`].

        Raises:
            RuntimeError: before the first `generate`.
        """
        if not self._windows:
            raise RuntimeError("`generate` a window first: there is nothing to stand in for what is missing.")
        position, speed = np.asarray(position, dtype=np.float64), np.asarray(speed, dtype=np.float64)
        place = position / self.spacing
        index = np.floor(place)
        begin, end = (edge * OVERLAP / (1 - OVERLAP) for edge in HANDOVER)
        share = np.clip((place - index - begin) / (end - begin), 0, 1)
        index, made, needed = index.astype(np.int64), np.zeros(len(position)), set()
        for shift, weight in ((0, share), (-1, 1 - share)):
            if not weight.any():
                continue
            for window in np.unique(index + shift).tolist():
                chosen = np.flatnonzero((index + shift == window) & (weight > 0))
                if len(chosen):
                    x = position[chosen] - window * self.spacing
                    made[chosen] += weight[chosen] * self._window(window).read(x, speed[chosen])
                    needed.add(window)
        self._note(needed)
        return made

    def _window(self, index):
        found = self._stand_ins.get(index) or self._windows.get(index)
        if found is None:
            there = dict(self._windows)  # a copy in one go: another thread may add to it
            found = self._stand_ins[index] = there[min(there, key=lambda other: abs(other - index))]
            self.substituted += 1
        return found

    def _note(self, needed):
        self._reads += 1
        for index in needed:
            self._recent[index] = self._reads
        old = [index for index, when in self._recent.items() if when < self._reads - _RECENT_READS]
        for index in old:
            del self._recent[index]
            self._stand_ins.pop(index, None)

    def missing(self):
        """Windows that the finger needs or nears and that are not there, the nearest first: list of `int`."""
        recent = sorted(dict(self._recent).items(), key=lambda item: -item[1])
        wanted = [index + near for near in (0, 1, -1) for index, _ in recent]
        return [index for index in dict.fromkeys(wanted) if index not in self._windows]


class EndlessStream(TextureStream):
    """A [`TextureStream`] over an [`EndlessProfile`], whose windows a thread of its own generates ahead of the finger.

    Ratings may change while it plays: `change` takes effect as soon as one window is generated, over 20 ms. Close it,
    or use it in a `with`.

    A program that must be on time reads it within [`on_time`] and lets a [`GeneratingProcess`] generate.

    Args:
        profile (`EndlessProfile`): its pipeline, or process, belongs to this stream's thread until it is closed.
        sensor_rate (`float`): of the finger's reports, Hz.
        **options: of [`TextureStream`].

    Raises:
        ValueError: for impossible options.
        RuntimeError: of `read` and `read_friction`, if generating has failed.
    """

    def __init__(self, profile, sensor_rate, **options):
        if not isinstance(profile, EndlessProfile):
            raise ValueError(f"`profile` must be an EndlessProfile, got {type(profile).__name__}.")
        axes = 3 if options.get("dimensions") == 2 else 1
        profile.generate(*(axis * _AXIS_WINDOWS for axis in range(axes)))
        super().__init__(profile, profile.friction_coefficient, sensor_rate, **options)
        self._profile, self._changed, self._failure = profile, None, None
        self._wake, self._closed = threading.Event(), False
        self._worker = threading.Thread(target=self._work, name="EndlessStream", daemon=True)
        self._worker.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Ends the thread; what is there can still be read."""
        self._closed = True
        self._profile.interrupt()
        self._wake.set()
        self._worker.join()

    def change(self, ratings):
        """Other ratings from now on, with everything else as it was; returns at once.

        Args:
            ratings: of one texture, in the `rating_scale` that the [`EndlessProfile`] was made with.

        Raises:
            ValueError: for impossible ratings; the stream goes on as it was.
        """
        now = self._profile
        self._changed = EndlessProfile(now.source, ratings, now.seed, now.fill, **now.options)
        now.interrupt()  # what is being generated is not needed any more
        self._wake.set()

    def _block(self, samples, normal_force):
        if self._failure is not None:
            raise RuntimeError(f"Generating has failed: {self._failure!r}.") from self._failure
        return super()._block(samples, normal_force)

    def _work(self):
        try:
            while not self._closed:
                changed, self._changed = self._changed, None
                if changed is not None:
                    self._exchange(changed)
                    continue
                missing = self._profile.missing()
                if missing:
                    self._profile.generate(missing[0], ready=True)
                else:
                    self._wake.wait(_PAUSE)
                    self._wake.clear()
        except Exception as error:  # of any kind: the reading thread raises it
            self._failure = error

    def _exchange(self, changed):
        """Generates what is under the finger of another surface, and puts it there."""
        needed = list(dict(self._profile._recent)) or [0]
        changed.generate(*needed, ready=True)
        if changed.friction_coefficient is None or not changed._windows:
            if self._changed is None:  # interrupted, and by nobody who wants something else
                self._changed = changed
            return
        self.replace(changed, changed.friction_coefficient)
        self._profile = changed


def _faded(first, second, end, beginning):
    """The end of one take that becomes the beginning of the next: departures from their mean keep their variance."""
    mean = 0.5 * (first.mean(-1, keepdim=True) + second.mean(-1, keepdim=True))
    share = (torch.arange(end.shape[-1], device=end.device) + 0.5) / end.shape[-1]
    mixed = (1 - share) * (end - mean) + share * (beginning - mean)
    return mean + mixed / ((1 - share).square() + share.square()).sqrt()
