"""What a scene refuses: impossible requests before any work, and files that are none."""

import json

import numpy as np
import pytest
import safetensors
from safetensors.numpy import save_file

from tactile_diffusers.playback import TextureScene

GOOD = {"table": [0.5, -0.5, 0.0], "denim": None}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"surfaces": {}}, "`surfaces` must map names to ratings"),
        ({"surfaces": {"": [1, 0, 0]}}, "`surfaces` must have names"),
        ({"surfaces": {"denim": [1, 0]}}, "denim.*must have 3 values"),
        ({"surfaces": {"denim": [[1, 0, 0], [1, 0, 0]]}}, "denim.*one texture, got 2 rows"),
        ({"rating_scale": "stars"}, "`rating_scale` must be one of"),
        ({"rating_scale": "percentile"}, "needs .'quantiles'. in the `rating_statistics`"),
        ({"patches": [(0, 0, 1, 1)]}, "`patches` must map names"),
        ({"patches": {"silk": (0, 0, 1, 1)}}, r"`patches` names \['silk'\]"),
        ({"patches": {"denim": (0, 0, 1)}}, r"`patches\['denim'\]`"),
        ({"patches": {"denim": (0, 0, 0, 5)}}, "positive size"),
        ({"patches": {"denim": (0, 0, 9e6, 5)}}, "give mm"),
        ({"patches": {"denim": (0, 5), "table": (0, 0, 5, 5)}}, "got both"),
        ({"seed": 0.5}, "`seed`"),
        ({"guidance_scale": {"rough": 2.0}}, "`guidance_scale`"),
        ({"cache_size": 0}, "`cache_size`"),
        ({"pipe": "a checkpoint"}, "`pipe` must be a TactileTexturePipeline, got str"),
    ],
)
def test_impossible_scenes_are_refused(pipe, given, message):
    with pytest.raises(ValueError, match=message):
        TextureScene(**({"surfaces": GOOD, "pipe": pipe} | given))


def test_a_pipeline_must_know_its_ratings_and_its_speed(make_pipeline):
    with pytest.raises(ValueError, match="no `dale`"):
        TextureScene(GOOD, make_pipeline(dale=False))
    with pytest.raises(ValueError, match="reference_speed"):
        TextureScene(GOOD, make_pipeline(dale_config={"reference_speed": None}))


def test_impossible_questions_are_refused(pipe):
    scene, bare = TextureScene(GOOD, pipe, {"denim": (0, 0, 5, 5)}), TextureScene(GOOD, pipe)
    for ask in (scene.profile, scene.friction_coefficient):
        with pytest.raises(ValueError, match=r"`name` must be one of .*denim.*got 'silk'"):
            ask("silk")
    for position in (3.0, (1, 2, 3), (np.nan, 0)):
        with pytest.raises(ValueError, match="`position` must be 2 finite"):
            scene.at(position)
    with pytest.raises(ValueError, match="`velocity` must be 2 finite"):
        scene.near((0, 0), velocity=3.0)
    with pytest.raises(ValueError, match="has no `patches`"):
        bare.at((0, 0))


@pytest.fixture
def path(pipe, tmp_path):
    TextureScene(GOOD, pipe, {"denim": (0, 0, 5, 5)}).save(tmp_path / "s.safetensors")
    return tmp_path / "s.safetensors"


def _rewrite(path, change):
    """The file again, after `change(tensors, content, metadata)`."""
    with safetensors.safe_open(path, framework="numpy") as file:
        metadata, tensors = file.metadata(), {name: file.get_tensor(name) for name in file.keys()}
    content = json.loads(metadata["scene"])
    change(tensors, content, metadata)
    if "scene" in metadata:
        metadata["scene"] = json.dumps(content)
    save_file({name: np.ascontiguousarray(value) for name, value in tensors.items()}, path, metadata)


def _set(part, name, value):
    return lambda *parts: parts[("tensors", "content", "metadata").index(part)].__setitem__(name, value)


def _drop(part, name):
    return lambda *parts: parts[("tensors", "content", "metadata").index(part)].pop(name)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_set("metadata", "version", "2"), "tactile-scene 2, not tactile-scene 1"),
        (_drop("content", "patches"), "patches.*required"),
        *((_drop("tensors", name), f"'{name}' is missing") for name in ("latents", "frames", "weights")),
        (_set("content", "names", ["denim", "denim"]), "names are"),
        (_set("content", "names", ["denim"]), "ratings is float32"),
        (_set("content", "num_inference_steps", 10**9), "at most 100000"),
        (_set("content", "reference_speed", None), "reference_speed"),
        (_set("content", "reference_speed", 1e9), "more than any patch needs"),
        (_set("tensors", "frames", np.array([0, 64], np.int32)), "have 0 to 64 frames"),
        (_set("tensors", "frames", np.array([2**30, 2**30], np.int32)), "latents is float16"),
        (_set("tensors", "latents", np.zeros((4, 64), np.float32)), "latents is float32"),
        (_set("tensors", "latents", np.full((4, 64), np.inf, np.float16)), "not finite"),
        (_set("tensors", "friction_coefficient", np.full(2, -1.0, np.float32)), "negative"),
    ],
)
def test_files_that_do_not_fit_themselves_are_refused(path, pipe, change, message):
    _rewrite(path, change)
    with pytest.raises(ValueError, match=rf"(?s)s\.safetensors cannot be read as a scene.*{message}.*Scene.save"):
        TextureScene.load(path, pipe)


def test_the_other_number_of_channels_is_another_checkpoint(path, pipe):
    _rewrite(path, _set("tensors", "latents", np.zeros((5, 64), np.float16)))
    with pytest.raises(ValueError, match="another checkpoint: its latents have 5 channels, here they have 4"):
        TextureScene.load(path, pipe)


def test_a_missing_file_and_another_pipe_are_named(path, pipe):
    with pytest.raises(FileNotFoundError, match="nowhere"):
        TextureScene.load(path.with_name("nowhere"), pipe)
    with pytest.raises(ValueError, match="`pipe` must be"):
        TextureScene.load(path, None)
    with pytest.raises(ValueError, match="`cache_size`"):
        TextureScene.load(path, pipe, cache_size=0)
