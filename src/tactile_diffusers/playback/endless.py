"""Textures without end: `EndlessProfile`, which generates windows where the finger goes, and `EndlessStream`."""

import collections
import threading
import warnings
from functools import partial

import numpy as np

from .stream import TextureStream
from .window_generator import OVERLAP, WindowGenerator

#: Part of the overlap over which one window gives way to the next: away from both ends, which fade out, and where a
#: decoder sees too little of what surrounds it.
HANDOVER = (0.25, 0.75)
#: Windows kept: what a finger nears and has just left, on three axes of a plane. The others come again as they were.
LARGEST_CACHE = 12
#: Distance between the places of the three axes of a plane, in windows.
_AXIS_WINDOWS = 2**20
#: Reads of a profile in which a window counts as near the finger: 0.2 s of blocks of 32.
_RECENT_READS = 60
#: Time between two looks at what the finger nears, s.
_PAUSE = 0.01


class EndlessProfile:
    """A profile over position that never repeats: window after window, each generated when the finger nears it.

    It is read like a [`TextureProfile`]. Windows are as long as a segment (133 mm with the bundled checkpoint) and
    overlap by a quarter. All are takes of one surface (see `WindowGenerator`). A window depends on the seed and its
    place alone: a finger that comes back meets the same texture, to rounding. Events of stick-slip are played in place.

    A window may be missing when the finger reaches it. By default `read` never waits: another window stands in until
    the finger has left (`substituted` counts). With `wait=True` it generates the window first, for files and tests
    that are read faster than real time. One thread may generate while another one reads.

    Args:
        pipe (`TactileTexturePipeline` or `GeneratingProcess`): with a DALE.
        ratings: of one texture, as `pipe` takes them.
        seed (`int`, *optional*, defaults to 0): of everything.
        fill (`bool`, *optional*, defaults to `True`): see [`TextureProfile`].
        wait (`bool`, *optional*, defaults to `False`): whether `read` waits for missing windows.
        **options: of `pipe`: `rating_scale`, `guidance_scale`, `num_inference_steps`, `num_latent_inference_steps`.

    Attributes:
        windows (`dict[int, TextureProfile]`): the windows that are there; window k is centred at k x `spacing`, so
            that a finger that starts at 0 needs one window alone.
        substituted (`int`): windows that another one stood in for.
        level, friction_coefficient (`float`): of the surface; `None` before the first `generate`.
        reference_speed (`float`): mm/s.
        spacing, window_length (`float`): mm from window to window, and of each.
        length (`float`): mm, of all places that a plane needs.

    Raises:
        ValueError: for impossible ratings or options, or a checkpoint without DALE or reference speed.
    """

    def __init__(self, pipe, ratings, seed=0, fill=True, wait=False, **options):
        make = getattr(pipe, "window_generator", None) or partial(WindowGenerator, pipe)  # in a process, or here
        generator = make(ratings, seed, fill, **options)
        self._generator, self.ratings, self.seed = generator, generator.ratings, generator.seed
        self.pipe, self.fill, self.wait, self.options = pipe, fill, wait, options
        self.reference_speed, self.spacing = generator.reference_speed, generator.spacing
        self.window_length, self.length = generator.window_length, 3 * _AXIS_WINDOWS * generator.spacing
        self.substituted, self.windows = 0, {}
        # windows by the number of the read that last needed them, what stands in for missing ones, and their middles
        self._reads, self._recent, self._stand_ins, self._openings = 0, {}, {}, {}

    @property
    def level(self):
        return self._generator.level

    @property
    def friction_coefficient(self):
        return self._generator.friction_coefficient

    def with_ratings(self, ratings):
        """Another surface: other ratings, in the same `rating_scale`, with everything else as it is here."""
        return EndlessProfile(self.pipe, ratings, self.seed, self.fill, self.wait, **self.options)

    # --- what the generating thread does

    def generate(self, *indices):
        """Generates the windows of these `indices` that are not there yet, in one batch.

        Those that are there now (`dict[int, TextureProfile]`): all, or after `interrupt` those that were there before.
        """
        with self._generator.lock:
            found = {index: self.windows[index] for index in indices if index in self.windows}
            missing = [index for index in dict.fromkeys(indices) if index not in found]
            if missing:
                found |= self._generator.generate(missing)
                self.windows.update(found)
                # kept: those just generated, those near the finger, and the latest others
                rank = {index: place for place, index in enumerate([*missing, *self._wanted()])}
                for old in sorted(reversed(self.windows), key=lambda k: rank.get(k, len(rank)))[LARGEST_CACHE:]:
                    del self.windows[old]
        return found

    def open(self, *indices):
        """Generates the middles of these windows alone, in less than half the time, for a finger that is there now.

        `read` uses them until the windows themselves are there. `False` after `interrupt`.
        """
        with self._generator.lock:
            self._openings |= self._generator.open(indices)
        self._recent |= dict.fromkeys(indices, self._reads)
        return bool(self._openings)

    def interrupt(self):
        """Lets a `generate` of another thread give up at its next step."""
        self._generator.interrupt()

    def near_finger(self):
        """Windows that were read within the last 0.2 s, the latest first: list of `int`."""
        return [index for index, _ in sorted(dict(self._recent).items(), key=lambda item: -item[1])]

    def missing(self):
        """Windows that the finger needs or nears and that are not there, the nearest first: list of `int`."""
        return [index for index in self._wanted() if index not in self.windows]

    def _wanted(self):
        recent = self.near_finger()
        return list(dict.fromkeys(index + near for near in (0, 1, -1) for index in recent))[:LARGEST_CACHE]

    # --- what the reading thread does

    def read(self, position, speed):
        """As [`TextureProfile.read`]; a RuntimeError before the first `generate`, unless `wait`."""
        position, speed = np.asarray(position, dtype=np.float64), np.asarray(speed, dtype=np.float64)
        self._reads += 1
        position = position + self.window_length / 2  # from the beginning of window 0
        place = position / self.spacing
        index = np.floor(place)
        begin, end = (edge * OVERLAP / (1 - OVERLAP) for edge in HANDOVER)
        share = np.clip((place - index - begin) / (end - begin), 0, 1)
        index, texture = index.astype(np.int64), np.zeros(len(position))
        for shift, weight in ((0, share), (-1, 1 - share)):
            for window in np.unique(index[weight > 0] + shift).tolist():
                chosen = np.flatnonzero((index + shift == window) & (weight > 0))
                x = position[chosen] - window * self.spacing
                texture[chosen] += weight[chosen] * self._read(window, x, speed[chosen])
        for old in [index for index, read in self._recent.items() if read < self._reads - _RECENT_READS]:
            del self._recent[old]
            self._stand_ins.pop(old, None)
        return texture

    def _read(self, index, x, speed):
        """Texture at places x in a window; where its opening was read, the window takes over within this block."""
        texture = self._window(index).read(x, speed)
        if index in self.windows and (opening := self._openings.pop(index, None)):
            share = (np.arange(len(x)) + 0.5) / len(x)
            texture = share * texture + (1 - share) * opening.read(x, speed)
        return texture

    def _window(self, index):
        """The window of an index, or what stands in for it: its opening, or another window."""
        self._recent[index] = self._reads
        found = self._stand_ins.get(index) or self.windows.get(index) or self._openings.get(index)
        while found is None and self.wait:
            found = self.generate(index).get(index)  # again if another thread interrupted it
        if found is None:
            there = self._openings | self.windows  # a copy in one go: another thread may add to them
            if not there:
                raise RuntimeError("`generate` a window first: there is nothing to stand in for what is missing.")
            found = self._stand_ins[index] = there[min(there, key=lambda other: abs(other - index))]
            self.substituted += 1
        return found


class EndlessStream(TextureStream):
    """A [`TextureStream`] over an [`EndlessProfile`], whose windows a thread of its own generates ahead of the finger.

    Ratings may change while it plays (`change`). Close it, or use it in a `with`. A program that must be on time reads
    it within [`on_time`] and lets a [`GeneratingProcess`] generate.

    Read it in real time: blocks that are read faster, or a finger that is too fast, find windows that are not generated
    yet. Another window then stands in, with one UserWarning (`substituted` counts). With an `EndlessProfile(...,
    wait=True)` it reads at any pace: `read` waits for its windows, and `change` until the new surface is there.

    `profile` is under the finger; `sensor_rate` (Hz) and `options` are those of [`TextureStream`]. If generating
    has failed, `read` and `read_friction` raise a RuntimeError.
    """

    def __init__(self, profile, sensor_rate, **options):
        if not isinstance(profile, EndlessProfile):
            raise ValueError(f"`profile` must be an EndlessProfile, got {type(profile).__name__}.")
        first = [axis * _AXIS_WINDOWS for axis in range(3 if options.get("dimensions") == 2 else 1)]
        while not (profile.generate(*first) if profile.wait else profile.open(*first)):
            pass  # another stream of the same pipeline interrupted it
        super().__init__(profile, profile.friction_coefficient, sensor_rate, **options)
        self._changes, self._wake = collections.deque(maxlen=1), threading.Event()
        self._closed, self._failure, self._substituted, self._warned = False, None, 0, False
        self._worker = threading.Thread(target=self._work, name="EndlessStream", daemon=True)
        self._worker.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Ends the thread; what is there can still be read."""
        self._closed = True
        self.profile.interrupt()
        self._wake.set()
        self._worker.join()

    @property
    def substituted(self):
        """Windows so far that another one stood in for, because they were not generated in time."""
        return self._substituted + self.profile.substituted

    def change(self, ratings):
        """Changes the ratings, in the `rating_scale` of the [`EndlessProfile`], with everything else as it was.

        Returns at once, and the change is felt, over 20 ms, as soon as the middle of a window is generated. With
        `wait=True` it returns when that is done, with the whole window.

        Raises:
            ValueError: for impossible ratings; the stream goes on as it was.
        """
        changed = self.profile.with_ratings(ratings)
        if not changed.wait:
            self._changes.append(changed)
        self.profile.interrupt()  # what is being generated is not needed any more
        self._wake.set()
        if changed.wait:
            self._exchange(changed)

    def _block(self, samples, normal_force):
        if self._failure is not None:
            raise RuntimeError(f"Generating has failed: {self._failure!r}.") from self._failure
        block = super()._block(samples, normal_force)
        if not self._warned and self.substituted:
            self._warned = True
            warnings.warn(
                "The finger reached a window of the endless texture that is not generated yet, and another one stands "
                "in (`substituted` counts such windows). Read in real time, use a GeneratingProcess or fewer steps, or "
                "let `read` wait with `EndlessProfile(..., wait=True)`.",
                UserWarning,
                stacklevel=3,
            )
        return block

    def _work(self):
        try:
            while not self._closed:
                if self._changes:
                    self._exchange(self._changes.pop())
                elif missing := self.profile.missing():
                    self.profile.generate(missing[0])
                else:
                    self._wake.wait(_PAUSE)
                    self._wake.clear()
        except Exception as error:  # of any kind: the reading thread raises it
            self._failure = error

    def _exchange(self, changed):
        """Generates what is under the finger of another surface, and puts it there, unless another change comes."""
        needed = self.profile.near_finger() or [0]
        while not (self._changes or self._closed):
            if changed.generate(*needed) if changed.wait else changed.open(*needed):
                before = self.profile
                self.replace(changed, changed.friction_coefficient)
                self._substituted += before.substituted
                return
