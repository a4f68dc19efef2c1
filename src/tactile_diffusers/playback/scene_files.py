"""The file of a scene: ratings, seed and latents, a few kilobytes for each surface.

A safetensors file with, for n surfaces, `ratings` (n, axes) float32, z-scores, NaN = not specified; `latents`
(channels, frames of all surfaces) float16, LCTG's base layer, surface by surface; `frames` (n,) int32, of each;
`level` and `friction_coefficient` (n,) float32; and `weights`, the mean magnitude of each of LCTG's parameters.
The metadata are `format`, `version` and `scene`, a JSON object of `_KEYS` and `patches`.
"""

import json
from dataclasses import dataclass

import numpy as np
import safetensors
import torch
from safetensors.numpy import save_file

from ..io.files import atomic_path
from ..io.reading import reading
from ..pipelines.inputs import check_steps
from ..signal.checks import check_number, check_seed
from .patches import LONGEST_MM, Patches

FORMAT, VERSION = "tactile-scene", "1"
#: Largest relative difference of the mean magnitude of a parameter: 5e-4 in bfloat16, more after further training.
SAME_WEIGHTS = 0.01
_KEYS = ("names", "rating_axes", "seed", "num_inference_steps", "guidance_scale", "reference_speed")


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
    """Writes a scene whose latents are there, in one step.

    Raises:
        FileNotFoundError: if the folder does not exist.
    """
    content = {name: getattr(state, name) for name in _KEYS} | {"patches": state.patches.boxes}
    tensors = {
        "ratings": state.ratings,
        "latents": np.concatenate(state.latents, axis=1),
        "frames": np.array([part.shape[1] for part in state.latents], dtype=np.int32),
        "level": state.level,
        "friction_coefficient": state.friction_coefficient,
        "weights": _weights(pipe),
    }
    metadata = {"format": FORMAT, "version": VERSION, "scene": json.dumps(content, allow_nan=False, default=float)}
    with atomic_path(path) as temporary:
        save_file(tensors, temporary, metadata)


def read_scene(path, pipe):
    """Reads a scene that a pipeline can decode.

    Returns:
        `SceneState`

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: if the file is damaged or no scene, or belongs to another checkpoint.
    """
    with reading(path, "a scene", "Copy it again, or write it again with `TextureScene.save`."):
        content, tensors = _contents(path)
        state = _state(content, tensors, pipe)
    difference = _difference(tensors["weights"], state, pipe)
    if difference:
        raise ValueError(
            f"{path} was made with another checkpoint: {difference}. Load that checkpoint, or create the scene again "
            "with this one: `TextureScene(surfaces, pipe, ...)`."
        )
    return state


def _contents(path):
    """JSON object and tensors, once they have the form of a scene's."""
    with safetensors.safe_open(path, framework="numpy") as file:
        metadata = file.metadata() or {}
        found = metadata.get("format"), metadata.get("version")
        if found != (FORMAT, VERSION):
            raise ValueError(f"its format is {found[0]} {found[1]}, not {FORMAT} {VERSION}")
        tensors = {name: file.get_tensor(name) for name in file.keys()}
    content = json.loads(metadata["scene"])
    count, axes = len(content["names"]), len(content["rating_axes"])
    forms = {
        "ratings": ("float32", (count, axes)),
        "frames": ("int32", (count,)),
        "level": ("float32", (count,)),
        "friction_coefficient": ("float32", (count,)),
        "latents": ("float16", (*tensors["latents"].shape[:1], int(tensors["frames"].sum()))),
        "weights": ("float32", tensors["weights"].shape[:1]),
    }
    for name, (dtype, shape) in forms.items():
        if tensors[name].dtype != dtype or tensors[name].shape != shape:
            raise ValueError(f"{name} is {tensors[name].dtype} {tensors[name].shape}, not {dtype} {shape}")
    return content, tensors


def _state(content, tensors, pipe):
    names, frames = content["names"], tensors["frames"]
    if not names or len(set(names)) < len(names) or not all(isinstance(name, str) and name for name in names):
        raise ValueError(f"names are {names!r}")
    check_seed(content["seed"])
    check_steps("num_inference_steps", content["num_inference_steps"])
    speed = check_number("reference_speed", content["reference_speed"], "mm/s", above=0)
    if frames.min() < 1:
        raise ValueError(f"the smallest number of frames is {frames.min()}")
    samples = int(frames.max()) * pipe.lctg.config.latent_hop
    if samples / pipe.feature_extractor.sampling_rate * speed > 2 * LONGEST_MM:
        raise ValueError(f"a texture of {frames.max()} frames is longer than any patch")
    friction = tensors["friction_coefficient"]
    finite = np.isfinite(tensors["latents"]).all() and np.isfinite(tensors["level"]).all()
    if not finite or np.isinf(tensors["ratings"]).any() or np.isinf(friction).any() or (friction < 0).any():
        raise ValueError("numbers are not finite, or a friction coefficient is negative")
    return SceneState(
        names=tuple(names),
        rating_axes=tuple(content["rating_axes"]),
        patches=Patches(content["patches"], names),
        **{name: content[name] for name in ("seed", "num_inference_steps", "guidance_scale", "reference_speed")},
        ratings=tensors["ratings"],
        latents=np.split(tensors["latents"], np.cumsum(frames)[:-1], axis=1),
        level=tensors["level"],
        friction_coefficient=friction,
    )


def _difference(weights, state, pipe):
    """How a pipeline differs from the one that a scene was generated with, in words; empty = not at all."""
    if state.latents[0].shape[0] != pipe.lctg.base_channels:
        return f"its latents have {state.latents[0].shape[0]} channels, here they have {pipe.lctg.base_channels}"
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
