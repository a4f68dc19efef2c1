"""Many surfaces under one finger, of which only what is touched is decoded: `TextureScene`."""

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Mapping

import numpy as np
import torch

from ..pipelines import TactileTexturePipeline
from ..pipelines.inputs import parse_ratings
from ..signal.checks import check_seed, check_whole_number
from .profile import LOOP_SHARE, TextureProfile
from .scene_files import Patches, SceneState, read_scene, write_scene

#: Distance from a patch, mm, and time before it is reached, s, from which on `prepare` decodes it: a finger moves up to
#: 0.2 m/s, mostly, and a segment takes 0.1 s to decode on one slow core.
MARGIN_MM, AHEAD_SECONDS = 10.0, 0.3


class TextureScene:
    r"""
    Surfaces described by ratings, as textures for `TextureStream`, each decoded when it is needed and not before.

    DALE generates the latents of all surfaces at the first need, in one batch for each length. LCTG decodes a surface
    when its profile is first asked for, as long as the longest stroke within its patch and at least one segment; the
    `cache_size` profiles asked for last are kept. A surface depends on `seed`, its name, ratings and patch alone, also
    from a file: bit for bit within a process; among other surfaces, or in another process, sums are rounded
    differently, 100 dB below the texture.

    All calls may come from different threads. A profile in the cache does not wait for one that is being decoded, so
    that `prepare` can run in a thread of its own. The pipeline must not be used otherwise meanwhile.

    Args:
        surfaces (`Mapping[str, Any]`): name -> ratings of one texture in any form that the pipeline takes:
            `[r, b, s]`, `{"roughness": 1.2}`; `None` or NaN = not specified.
        pipe (`TactileTexturePipeline`): with `dale`, which a scene from a file (`load`) can do without.
        patches (`Mapping[str, Sequence[float]]`, *optional*): name -> (x, y, width, height), or (start, length) on a
            line, mm. Of patches that overlap the later surface lies above. Without one a surface is one segment.
        seed (`int`, *optional*, defaults to 0): another one gives other takes of the same surfaces.
        num_inference_steps (`int`, *optional*): as in the pipeline; `None` = its default.
        guidance_scale (`float` or `dict[str, float]`, *optional*, defaults to 1.0): as in the pipeline; 1.0 = off.
        cache_size (`int`, *optional*, defaults to 8): profiles kept, 1.4 MB for each segment, twice that with events.
        rating_scale (`str`, *optional*, defaults to `"z"`): of `surfaces`, as in the pipeline.

    Attributes:
        names (`tuple[str, ...]`): of the surfaces.
        ratings (`np.ndarray`): (surfaces, axes) float32, z-scores, NaN = not specified.
        patches (`dict[str, tuple[float, ...]]`): mm.
        dimensions (`int`): of a position, 1 or 2; 0 = no patches.
        reference_speed (`float`): mm/s.

    Raises:
        ValueError: for impossible surfaces, patches, settings or a pipeline without DALE, before any work starts.
    """

    def __init__(
        self, surfaces, pipe, patches=None, seed=0, num_inference_steps=None, guidance_scale=1.0, cache_size=8,
        rating_scale="z",
    ):  # fmt: skip
        _check_pipe(pipe)
        pipe.check_inputs(guidance_scale=guidance_scale)
        decoding_steps, self._latent_steps = pipe.resolve_steps(num_inference_steps)
        config = pipe.dale.config
        if config.reference_speed is None:
            raise ValueError("The `dale` of `pipe` has no `reference_speed` in its config, which a scene needs.")
        names, ratings = _parse_surfaces(surfaces, config, rating_scale)
        state = SceneState(
            names=names,
            ratings=ratings,
            rating_axes=tuple(config.rating_axes),
            patches=Patches({} if patches is None else patches, names),
            seed=check_seed(seed),
            num_inference_steps=int(decoding_steps),  # JSON knows no other
            guidance_scale=guidance_scale,
            reference_speed=float(config.reference_speed),
        )
        self._begin(state, pipe, cache_size)

    @classmethod
    def load(cls, path, pipe, cache_size=8):
        """A scene from a file that `save` wrote; DALE is not run, nor needed.

        `pipe` is of the checkpoint that the scene was made with, in any precision, with `dale` or without.

        Raises:
            FileNotFoundError: if there is no file.
            ValueError: if the file is damaged or no scene, or belongs to another checkpoint.
        """
        _check_pipe(pipe)
        scene = cls.__new__(cls)
        scene._begin(read_scene(path, pipe), pipe, cache_size)
        return scene

    def _begin(self, state, pipe, cache_size):
        check_whole_number("cache_size", cache_size)
        self._state, self._pipe, self.cache_size = state, pipe, cache_size
        self.names, self.ratings = state.names, state.ratings
        self.patches, self.dimensions = dict(state.patches.boxes), state.patches.dimensions
        self.reference_speed = state.reference_speed
        self._profiles = OrderedDict()
        # held while models run, and while the cache is looked at
        self._working, self._looking = threading.Lock(), threading.Lock()

    @property
    def decoded(self):
        """Names of the surfaces whose profiles are in the cache, the one asked for last at the end."""
        with self._looking:
            return tuple(self._profiles)

    def save(self, path):
        """Writes one `.safetensors` file, 3 kB for each surface of one segment; the folder must exist.

        DALE runs first if it has not run, so that a scene from a file never needs it.
        """
        self._ensure_latents()
        write_scene(path, self._state, self._pipe)

    def at(self, position):
        """Name of the surface under a position, (dimensions,) in mm, or `None` outside all patches.

        There a stream goes on with the last surface: read it with `normal_force=0` for no force. Errors as of `near`.
        """
        return self._state.patches.at(position)

    def near(self, position, velocity=None):
        """Surfaces within 10 mm, or 0.3 s straight ahead, of a finger, first to be reached first: a list of names.

        Args:
            position (`float` or `Sequence[float]`): (dimensions,), mm.
            velocity (`float` or `Sequence[float]`, *optional*): (dimensions,), mm/s; `None` = it rests.

        Raises:
            ValueError: if an argument is not finite or of other dimensions, or the scene has no patches.
        """
        return self._state.patches.near(position, velocity, MARGIN_MM, AHEAD_SECONDS)

    def prepare(self, position, velocity=None):
        """Decodes what a finger touches or is about to touch, at most `cache_size` surfaces, in the caller's thread.

        Arguments, result (less what exceeds the cache) and errors are those of `near`.
        """
        names = self.near(position, velocity)[: self.cache_size]
        for name in names:
            self.profile(name)
        return names

    def profile(self, name):
        """The [`TextureProfile`] of a surface, decoded if it is not in the cache.

        It is at least as long as the longest stroke within the surface's patch. A ValueError for an unknown name.
        """
        index, found = self._index(name), self._cached(name)
        if found is not None:
            return found
        self._ensure_latents()
        with self._working:
            found = self._cached(name)  # another thread may have decoded it meanwhile
            if found is None:
                found = self._decode(index)
                with self._looking:
                    self._profiles[name] = found
                    while len(self._profiles) > self.cache_size:
                        self._profiles.popitem(last=False)
        return found

    def friction_coefficient(self, name):
        """Friction coefficient (`float`) of a surface, for `TextureStream`; NaN if the checkpoint does not know it."""
        index = self._index(name)
        self._ensure_latents()
        return float(self._state.friction_coefficient[index])

    def _index(self, name):
        if name not in self.names:
            raise ValueError(f"`name` must be one of the scene's {list(self.names)[:20]}, got {name!r}.")
        return self.names.index(name)

    def _cached(self, name):
        with self._looking:
            if name in self._profiles:
                self._profiles.move_to_end(name)
            return self._profiles.get(name)

    def _ensure_latents(self):
        """Runs DALE for all surfaces, unless it has run: those of one length in one batch, each with its own noise."""
        state = self._state
        if state.friction_coefficient is not None:  # set last
            return
        with self._working:
            if state.friction_coefficient is not None:  # by another thread
                return
            durations = [self._duration(name) for name in state.names]
            latents, level, friction = [None] * len(durations), *np.empty((2, len(durations)), dtype=np.float32)
            for duration in dict.fromkeys(durations):
                rows = [row for row, other in enumerate(durations) if other == duration]
                out = self._pipe(
                    state.ratings[rows],
                    num_inference_steps=state.num_inference_steps,
                    num_latent_inference_steps=self._latent_steps,
                    guidance_scale=state.guidance_scale,
                    duration_s=duration,
                    generator=[self._generator(state.names[row], "dale") for row in rows],
                    output_type="latent",
                )
                # half precision, as in a file, so that a scene from there is the same: its rounding lies 70 dB below
                base = out.latents[:, : self._pipe.lctg.base_channels].half().cpu().numpy()
                level[rows], friction[rows] = out.level.cpu().numpy(), out.friction_coefficient.cpu().numpy()
                for row, values in zip(rows, base, strict=True):
                    latents[row] = values
            state.latents, state.level, state.friction_coefficient = latents, level, friction

    def _duration(self, name):
        """Seconds of texture that a patch needs at the reference speed; `None` = one segment is enough."""
        lctg, rate = self._pipe.lctg.config, self._pipe.feature_extractor.sampling_rate
        seconds = self._state.patches.extent(name) / (1 - LOOP_SHARE) / self._state.reference_speed
        return seconds if seconds > self._pipe.dale.config.latent_frames * lctg.latent_hop / rate else None

    def _decode(self, index):
        """Profile of one surface, decoded alone, so that no other surface changes its rounding."""
        state, name = self._state, self._state.names[index]
        out = self._pipe.decode(
            self._pipe.lctg.pad_detail(torch.from_numpy(state.latents[index][None]).float()),
            torch.from_numpy(state.level[index : index + 1]),
            num_inference_steps=state.num_inference_steps,
            generator=self._generator(name, "lctg"),
        )
        seed = _noise_seed(state.seed, name, "filling")
        return TextureProfile(out.textures[0], out.sampling_rate, state.reference_speed, seed=seed)

    def _generator(self, name, use):
        return torch.Generator("cpu").manual_seed(_noise_seed(self._state.seed, name, use))


def _check_pipe(pipe):
    if not isinstance(pipe, TactileTexturePipeline):
        raise ValueError(f"`pipe` must be a TactileTexturePipeline, got {type(pipe).__name__}.")


def _noise_seed(seed, name, use):
    """A seed of the 32 bits that PyTorch's generator reads, by name: other surfaces may come and go."""
    return int.from_bytes(hashlib.sha256(f"{seed}/{use}/{name}".encode()).digest()[:4], "big")


def _parse_surfaces(surfaces, config, rating_scale):
    """Names, and ratings (surfaces, axes) float32, z-scores."""
    if not isinstance(surfaces, Mapping) or not surfaces:
        raise ValueError(f'`surfaces` must map names to ratings, {{"denim": [0.9, 0.5, 0.3]}}, got {surfaces!r}.')
    rows = []
    for name, ratings in surfaces.items():
        if not isinstance(name, str) or not name:
            raise ValueError(f"`surfaces` must have names that are not empty, got {name!r}.")
        try:
            row = parse_ratings(ratings, config, rating_scale)
        except ValueError as error:
            raise ValueError(f"`surfaces[{name!r}]`: {error}") from error
        if len(row) != 1:
            raise ValueError(f"`surfaces[{name!r}]` must be the ratings of one texture, got {len(row)} rows.")
        rows.append(row[0].numpy())
    return tuple(surfaces), np.stack(rows)
