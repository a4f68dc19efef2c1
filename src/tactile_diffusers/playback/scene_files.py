"""Patches of a scene, and the file of a scene: ratings, seed and latents, a few kilobytes for each surface.

A safetensors file with, for n surfaces, `ratings` (n, axes) float32, z-scores, NaN = not specified; `latents`
(channels, frames of all surfaces) float16, LCTG's base layer, surface by surface; `frames` (n,) int32, of each;
`level` and `friction_coefficient` (n,) float32; and `weights`, the mean magnitude of each of LCTG's parameters.
The metadata are `format`, `version` and `scene`, a JSON object of the fields of `Header`.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import safetensors
import torch
from pydantic import BaseModel, ConfigDict, Field
from safetensors.numpy import save_file

from ..io.files import atomic_path
from ..io.reading import reading
from ..pipelines.inputs import check_steps

#: The longest patch, mm: a longer one is probably in another unit.
LONGEST_MM = 10_000.0
FORMAT, VERSION = "tactile-scene", "1"
#: Largest relative difference of the mean magnitude of a parameter: 5e-4 in bfloat16, more after further training.
SAME_WEIGHTS = 0.01


class Patches:
    """Patches in mm, each a corner and a size: (x, y, width, height), or (start, length) on a line.

    They may overlap: the later one of `names`, which lists all surfaces, lies above. A ValueError for a patch of
    another form, of an unknown surface, without extent, or longer than `LONGEST_MM`.

    Attributes:
        boxes (`dict[str, tuple[float, ...]]`): the patches, from below.
        dimensions (`int`): of a position, 1 or 2; 0 = there are no patches.
    """

    def __init__(self, patches, names):
        if not isinstance(patches, Mapping):
            raise ValueError(f"`patches` must map names to patches, got {type(patches).__name__}.")
        unknown = sorted(map(str, set(patches) - set(names)))
        if unknown:
            raise ValueError(f"`patches` names {unknown}, not among `surfaces`.")
        self.boxes = {name: _checked(name, patches[name]) for name in names if name in patches}
        sizes = {len(box) for box in self.boxes.values()}
        if len(sizes) > 1:
            raise ValueError("`patches` must all be (x, y, width, height), or all (start, length), in mm; got both.")
        self.dimensions = max(sizes, default=0) // 2
        boxes = np.array(list(self.boxes.values())).reshape(-1, 2, max(self.dimensions, 1))
        self._low, self._high = boxes[:, 0], boxes[:, 0] + boxes[:, 1]

    def extent(self, name):
        """The longest straight stroke within a patch, mm; 0 for a surface without one."""
        box = self.boxes.get(name, ())
        return float(np.linalg.norm(box[len(box) // 2 :]))

    def at(self, position):
        """Name of the patch under a position, the uppermost, or `None`."""
        place = self._vector("position", position)
        inside = np.flatnonzero(((self._low <= place) & (place < self._high)).all(1))
        return list(self.boxes)[inside[-1]] if len(inside) else None

    def near(self, position, velocity, margin, seconds):
        """Names of the patches that a finger on a straight way comes within `margin` mm of, in this order."""
        place = self._vector("position", position)
        velocity = self._vector("velocity", np.zeros(self.dimensions) if velocity is None else velocity)
        # the way through a box, axis by axis, as rays are cut with boxes; a resting axis is in it always or never
        slow = np.where(np.abs(velocity) < 1e-9, 1e-9, velocity)
        ends = (self._low - margin - place) / slow, (self._high + margin - place) / slow
        enter, leave = np.minimum(*ends).max(1), np.maximum(*ends).min(1)
        met = np.flatnonzero((enter <= leave) & (enter <= seconds) & (leave >= 0))
        away = np.linalg.norm(np.maximum(0, np.maximum(self._low - place, place - self._high)), axis=1)
        order = np.lexsort((away[met], np.maximum(enter[met], 0)))
        names = list(self.boxes)
        return [names[index] for index in met[order]]

    def _vector(self, name, value):
        if not self.dimensions:
            raise ValueError("This scene has no `patches`: give them to TextureScene, or ask for surfaces by name.")
        vector = np.atleast_1d(np.asarray(value, dtype=np.float64))
        if vector.shape != (self.dimensions,) or not np.isfinite(vector).all():
            form = "on a plane: (x, y)" if self.dimensions == 2 else "on a line"
            raise ValueError(f"`{name}` must be {self.dimensions} finite number(s), got {value!r}: patches lie {form}.")
        return vector


def _checked(name, patch):
    try:
        box = tuple(float(value) for value in patch)
    except (TypeError, ValueError):
        box = ()
    half = len(box) // 2
    if len(box) not in (2, 4) or not np.isfinite(box).all() or min(box[half:]) <= 0:
        raise ValueError(
            f"`patches[{name!r}]` must be (x, y, width, height), or (start, length) on a line, in mm and of positive "
            f"size, got {patch!r}."
        )
    if np.linalg.norm(box[half:]) > LONGEST_MM:
        raise ValueError(f"`patches[{name!r}]` must be at most {LONGEST_MM:g} mm long, got {patch!r}: give mm.")
    return box


class Header(BaseModel):
    """What a scene is made from, apart from ratings; `patches` in mm."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

    names: Annotated[list[Annotated[str, Field(min_length=1)]], Field(min_length=1)]
    rating_axes: list[str]
    seed: Annotated[int, Field(ge=0, lt=2**64)]
    num_inference_steps: int
    guidance_scale: float | dict[str, float]
    reference_speed: Annotated[float, Field(gt=0)]
    patches: dict[str, list[float]]


@dataclass
class SceneState:
    """The contents of a scene; the last three are `None` until DALE has run."""

    names: tuple[str, ...]
    ratings: np.ndarray  # (n, axes) float32
    rating_axes: tuple[str, ...]
    patches: Patches
    seed: int
    num_inference_steps: int
    guidance_scale: float | dict[str, float]
    reference_speed: float
    latents: list[np.ndarray] | None = None  # of each surface, (base channels, frames) float16
    level: np.ndarray | None = None  # (n,) float32
    friction_coefficient: np.ndarray | None = None  # (n,) float32


def write_scene(path, state, pipe):
    """Writes a scene whose latents are there; a FileNotFoundError if the folder does not exist."""
    header = {name: getattr(state, name) for name in Header.model_fields} | {"patches": state.patches.boxes}
    tensors = {
        "ratings": state.ratings,
        "latents": np.concatenate(state.latents, axis=1),
        "frames": np.array([part.shape[1] for part in state.latents], dtype=np.int32),
        "level": state.level,
        "friction_coefficient": state.friction_coefficient,
        "weights": _weights(pipe),
    }
    metadata = {"format": FORMAT, "version": VERSION, "scene": json.dumps(header, allow_nan=False, default=float)}
    with atomic_path(path) as temporary:
        save_file(tensors, temporary, metadata)


def read_scene(path, pipe):
    """The `SceneState` of a file that a pipeline can decode, with the errors of `TextureScene.load`."""
    with reading(path, "a scene", "Copy it again, or write it again with `TextureScene.save`."):
        with safetensors.safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            found = metadata.get("format"), metadata.get("version")
            if found != (FORMAT, VERSION):
                raise ValueError(f"its format is {found[0]} {found[1]}, not {FORMAT} {VERSION}")
            tensors = {name: file.get_tensor(name) for name in file.keys()}
        header = Header.model_validate_json(metadata["scene"])
        check_steps("num_inference_steps", header.num_inference_steps)
        patches = Patches(header.patches, header.names)
        _check_tensors(tensors, header, pipe)
    latents, frames, weights = (tensors.pop(name) for name in ("latents", "frames", "weights"))
    difference = _difference(weights, len(latents), pipe)
    if difference:
        raise ValueError(
            f"{path} was made with another checkpoint: {difference}. Load that checkpoint, or create the scene again "
            "with this one: `TextureScene(surfaces, pipe, ...)`."
        )
    latents = np.split(latents, np.cumsum(frames)[:-1], axis=1)
    names, axes = tuple(header.names), tuple(header.rating_axes)
    content = header.model_dump() | {"names": names, "rating_axes": axes, "patches": patches}
    return SceneState(**content, **tensors, latents=latents)


def _check_tensors(tensors, header, pipe):
    """Refuses tensors that do not fit each other, the names, or what is possible."""
    count = len(header.names)
    if len(set(header.names)) < count:
        raise ValueError(f"names are {header.names!r}")
    forms = {
        "ratings": ("float32", (count, len(header.rating_axes))),
        "frames": ("int32", (count,)),
        "level": ("float32", (count,)),
        "friction_coefficient": ("float32", (count,)),
        "latents": ("float16", (*tensors["latents"].shape[:1], int(tensors["frames"].sum()))),
        "weights": ("float32", tensors["weights"].shape[:1]),
    }
    for name, (dtype, shape) in forms.items():
        if tensors[name].dtype != dtype or tensors[name].shape != shape:
            raise ValueError(f"{name} is {tensors[name].dtype} {tensors[name].shape}, not {dtype} {shape}")
    frames, friction = tensors["frames"], tensors["friction_coefficient"]
    seconds = int(frames.max()) * pipe.lctg.config.latent_hop / pipe.feature_extractor.sampling_rate
    if frames.min() < 1 or seconds * header.reference_speed > 2 * LONGEST_MM:
        raise ValueError(f"textures have {frames.min()} to {frames.max()} frames: none, or more than any patch needs")
    finite = np.isfinite(tensors["latents"]).all() and np.isfinite(tensors["level"]).all()
    if not finite or np.isinf(tensors["ratings"]).any() or np.isinf(friction).any() or (friction < 0).any():
        raise ValueError("numbers are not finite, or a friction coefficient is negative")


def _difference(weights, channels, pipe):
    """How a pipeline differs from the one that a scene was generated with, in words; empty = not at all."""
    if channels != pipe.lctg.base_channels:
        return f"its latents have {channels} channels, here they have {pipe.lctg.base_channels}"
    here = _weights(pipe)
    if weights.shape != here.shape or not np.allclose(weights, here, rtol=SAME_WEIGHTS, atol=1e-6):
        return "the weights of its `lctg` are others"
    return ""


@torch.no_grad()
def _weights(pipe):
    """Mean magnitude of each of LCTG's parameters, (parameters,) float32: alike in every precision and on any device.

    A digest would refuse the same checkpoint in half precision.
    """
    return torch.stack([parameter.float().abs().mean() for parameter in pipe.lctg.parameters()]).cpu().numpy()
