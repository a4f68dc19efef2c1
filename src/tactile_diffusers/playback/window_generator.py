"""The windows of an endless surface: takes of the same ratings that fade into each other as latents."""

import threading
import weakref
from typing import NamedTuple

import numpy as np
import torch

from ..pipelines.inputs import parse_ratings
from ..signal.checks import check_seed
from .profile import LEAST_SECONDS, TextureProfile

#: Share of a window that overlaps the next one, where the latents of both become one.
OVERLAP = 0.25
#: Latents of takes that are kept, a few kilobytes each: a window needs those of its neighbours.
LARGEST_TAKES = 64
#: One for each pipeline: several surfaces may share it, and it generates for one at a time.
_LOCKS = weakref.WeakKeyDictionary()


class Opening(NamedTuple):
    """The middle of a window, read like a window: beyond its ends it repeats."""

    profile: TextureProfile
    begin: float  # mm from the beginning of the window

    def read(self, position, speed):
        return self.profile.read(position - self.begin, speed)


class WindowGenerator:
    """Generates the windows of one endless surface, with a pipeline of this process or (`GeneratingProcess`) another.

    Windows begin `spacing` mm after each other and overlap by a quarter. Each is a take of the same ratings, with
    the level, mean spectrum and friction coefficient of take 0. Where two overlap, their latents fade into each other
    at constant variance, and both are decoded from these latents and the same noise, so that they nearly agree. A
    window depends on the seed and its index alone, to rounding.

    Arguments, attributes and errors are those of [`EndlessProfile`]. `lock` is to be held while generating: surfaces of
    one pipeline share it.
    """

    def __init__(self, pipe, ratings, seed=0, fill=True, **options):
        speed = None if pipe.dale is None else pipe.dale.config.reference_speed
        if speed is None:
            raise ValueError("`pipe` has no `dale`, or its config has no `reference_speed`, which a surface needs.")
        latent_options = dict(options)
        self._steps, latent_options["num_latent_inference_steps"] = pipe.resolve_steps(
            latent_options.pop("num_inference_steps", None), options.get("num_latent_inference_steps")
        )
        ratings = parse_ratings(ratings, pipe.dale.config, latent_options.pop("rating_scale", "z"))
        if len(ratings) != 1:
            raise ValueError(f"`ratings` must be those of one texture, got {len(ratings)}.")
        self.pipe, self.ratings, self.seed, self.fill = pipe, ratings, check_seed(seed), fill
        self._latent_options = latent_options
        self.lock = _LOCKS.setdefault(pipe, threading.RLock())
        frames = pipe.dale.config.latent_frames
        self._overlap = round(OVERLAP * frames)
        self.reference_speed = float(speed)
        seconds = frames * pipe.lctg.config.latent_hop / pipe.feature_extractor.sampling_rate
        self.window_length = seconds * self.reference_speed
        self.frame_length = self.window_length / frames
        self.spacing = self.window_length * (1 - self._overlap / frames)
        rate = pipe.feature_extractor.delivery_rate
        self._profile = {"sampling_rate": rate, "reference_speed": self.reference_speed, "fill": fill}
        self.level = self.friction_coefficient = self._scalars = None
        self._takes = {}

    def generate(self, indices):
        """Windows of these indices in one batch (`dict[int, TextureProfile]`); empty if `interrupt` came in between."""
        if not self._generate_takes(sorted({index + near for index in indices for near in (-1, 0, 1)})):
            return {}
        frames = self.pipe.dale.config.latent_frames
        decoded = self._decode(indices, [self._joined(index) for index in indices], slice(0, frames))
        windows = {}
        for index, texture in decoded.items():
            filling = self._noise(index, "filling", len(texture)).numpy() if self.fill else None
            windows[index] = TextureProfile(texture, **self._profile, repeats=False, noise=filling)
            windows[index].prepare()
        return windows

    def open(self, indices):
        """The middle of these windows, in less than half the time: `dict[int, Opening]`; empty if interrupted.

        There, a window is its own take alone, and agrees with what `generate` makes to 0.999 (correlation).
        """
        if not self._generate_takes(sorted(indices)):
            return {}
        frames, margin = self.pipe.dale.config.latent_frames, self._overlap
        if (frames - 2 * margin) * self.frame_length / self.reference_speed < LEAST_SECONDS:
            margin = 0
        decoded = self._decode(indices, [self._takes[index] for index in indices], slice(margin, frames - margin))
        begin = margin * self.frame_length
        openings = {}
        for index, texture in decoded.items():
            openings[index] = Opening(TextureProfile(texture, **self._profile, separate=False), begin)
            openings[index].profile.prepare()
        return openings

    def _decode(self, indices, latents, part):
        """Textures of these frames of windows: `dict[int, np.ndarray]`; empty if interrupted."""
        hop, frames = self.pipe.lctg.config.latent_hop, latents[0].shape[-1]
        noise = torch.stack([self._noise(index, "decoder", frames * hop) for index in indices])[:, None]
        latents = self.pipe.lctg.pad_detail(torch.stack(latents))
        level, band_levels = torch.full((len(indices),), self.level), self.pipe.lctg.band_levels(latents)
        if band_levels is not None:  # of the part alone
            power = self.pipe.feature_extractor.power_over_time(band_levels)
            level += 0.5 * torch.log(power[:, part].mean(-1) / power.mean(-1)).float()
        noise = noise[..., part.start * hop : part.stop * hop]
        out = self.pipe.decode(latents[..., part], level, None, self._steps, noise=noise)
        return {} if self.pipe.interrupt else dict(zip(indices, out.textures, strict=True))

    def interrupt(self):
        """Lets a `generate` of another thread give up at its next step."""
        interrupt(self.pipe)

    def _generate_takes(self, indices):
        """Latents of DALE, all with the scalars of take 0; `False` if interrupted."""
        missing = sorted({*indices, *([0] if self._scalars is None else [])} - self._takes.keys())
        if missing:
            out = self.pipe(
                self.ratings,
                num_textures_per_rating=len(missing),
                generator=[self._random("take", index) for index in missing],
                output_type="latent",
                **self._latent_options,
            )
            if self.pipe.interrupt:
                return False
            dale, base = self.pipe.dale, self.pipe.lctg.base_channels
            states = dale.pack(out.latents[:, :base], out.level, out.friction_coefficient)
            fields, scalars = dale.split_scalars(states)
            if self._scalars is None:
                first = missing.index(0)
                self._scalars = scalars[first]
                self.level = float(out.level[first])
                self.friction_coefficient = float(out.friction_coefficient[first])
            takes = dale.unpack(dale.append_scalars(fields, self._scalars.expand_as(scalars)))[0]
            self._takes |= dict(zip(missing, takes, strict=True))
        unused = [index for index in self._takes if index not in indices]
        for index in unused[: max(0, len(self._takes) - LARGEST_TAKES)]:
            del self._takes[index]
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
        parts = [torch.randn(spacing, generator=self._random(purpose, place)) for place in (index, index + 1)]
        return torch.cat(parts)[:samples]

    def _random(self, purpose, index):
        key = [self.seed, *purpose.encode(), index % 2**32]
        return torch.Generator().manual_seed(int(np.random.SeedSequence(key).generate_state(1)[0]))


def interrupt(pipe):
    """Interrupts a running pipeline from another thread, as diffusers' callbacks do."""
    pipe._interrupt = True


def _faded(first, second, end, beginning):
    """The end of one take fading into the beginning of the next: departures from their mean keep their variance."""
    mean = 0.5 * (first.mean(-1, keepdim=True) + second.mean(-1, keepdim=True))
    share = (torch.arange(end.shape[-1], device=end.device) + 0.5) / end.shape[-1]
    mixed = (1 - share) * (end - mean) + share * (beginning - mean)
    return mean + mixed / ((1 - share).square() + share.square()).sqrt()
