"""Section 3 of diffusers' rules in a process of its own, which has imported nothing but the package.

In the process of the tests everything is imported already, so what a loader does not find would never show. One child
does all of it (importing diffusers takes seconds) and prints what it found; each test looks at one thing.
"""

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from tactile_diffusers import DALEModel, LCTGModel, RatingEstimator, TactileTexturePipeline

CHILD = Path(__file__).with_name("fresh_process.py")
TINY = Path(__file__).parents[1] / "fixtures" / "tiny_pipeline"
CLASSES = {
    "lctg": "LCTGModel",
    "dale": "DALEModel",
    "rating_estimator": "RatingEstimator",
    "scheduler": "VDDIMScheduler",
    "dale_scheduler": "VDDIMScheduler",
    "feature_extractor": "TactileFeatureExtractor",
}


@pytest.fixture(scope="module")
def checkpoints(make_pipeline, tmp_path_factory):
    """Every component there is, saved plainly, as a variant and in shards."""
    root = tmp_path_factory.mktemp("fresh")
    whole = make_pipeline()
    torch.manual_seed(0)
    whole.register_modules(rating_estimator=RatingEstimator(channel_groups=[4, 0, 2]).eval())
    whole.save_pretrained(str(root / "plain"))
    (root / "components.pkl").write_bytes(pickle.dumps(whole.components))
    whole.save_pretrained(str(root / "variant"), variant="fp16")
    whole.save_pretrained(str(root / "shards"), max_shard_size="20KB")
    make_pipeline(dale=False).save_pretrained(str(root / "decoder"))
    return root


@pytest.fixture(scope="module")
def found(checkpoints):
    """What the child says: {name: result or {"error": text}, with the warnings of each}."""
    done = subprocess.run(
        [sys.executable, str(CHILD), str(checkpoints), str(TINY)],
        capture_output=True,
        text=True,
        env={**os.environ, "HF_HUB_OFFLINE": "1"},
        cwd=checkpoints,
        timeout=240,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def _silent(found, name):
    entry = found[name]
    assert "error" not in entry, entry["error"]
    assert entry["warnings"] == []
    return entry["result"]


@pytest.mark.parametrize("name", ["plain", "shards", "variant", "dtype of each"])
def test_checkpoints_load_in_silence(found, name):
    assert _silent(found, name)["classes"] == CLASSES


def test_a_decoder_alone_loads_in_silence(found):
    rest = {name: cls for name, cls in CLASSES.items() if name not in ("dale", "dale_scheduler", "rating_estimator")}
    assert _silent(found, "decoder")["classes"] == rest


def test_the_oldest_checkpoint_loads_in_silence_and_generates(found):
    made = _silent(found, "tiny")
    assert made["classes"] == {name: cls for name, cls in CLASSES.items() if name != "rating_estimator"}
    assert made["finite"]


def test_types_of_components_are_chosen_one_by_one(found):
    assert _silent(found, "dtype of each")["dtypes"] == {
        "dale": "torch.bfloat16",
        "lctg": "torch.float16",
        "rating_estimator": "torch.float16",
    }


def test_what_was_pickled_here_is_unpickled_there(found):
    assert _silent(found, "pickle") == CLASSES


def test_a_variant_must_be_asked_for(found):
    assert "Give `variant`: the folder has fp16." in found["variant without asking"]["error"]
    assert "variant=bf16" in found["another variant"]["error"]


def test_diffusion_pipeline_needs_custom_pipeline_and_trust(found):
    assert "has no attribute TactileTexturePipeline" in found["base class"]["error"]
    assert "trust_remote_code" in found["code without trust"]["error"]


def test_diffusion_pipeline_loads_a_folder_that_brings_its_code(checkpoints, tmp_path):
    """As the Hub's snippet does, in a process that has not imported the package."""
    code = """
import sys
from diffusers import DiffusionPipeline
pipe = DiffusionPipeline.from_pretrained(sys.argv[1], custom_pipeline="pipeline", trust_remote_code=True)
print(type(pipe).__module__, type(pipe).__name__)
"""
    environment = {**os.environ, "HF_HUB_OFFLINE": "1", "HF_MODULES_CACHE": str(tmp_path)}
    command = [sys.executable, "-c", code, str(checkpoints / "plain")]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=240)
    assert done.stdout.split() == ["tactile_diffusers", "TactileTexturePipeline"], done.stderr


def test_components_may_be_placed_by_a_device_map(found):
    assert found["device map"]["result"]["classes"] == CLASSES
    assert "balanced" in found["unknown device map"]["error"]


def test_importing_the_package_brings_all_classes_and_nothing_heavy(found):
    made = _silent(found, "import")
    assert made["public"] == sorted({cls.__name__ for cls in (DALEModel, LCTGModel, TactileTexturePipeline)})
    assert made["heavy"] == []
    assert made["bases"] == ["FeatureExtractionMixin", "ModelMixin", "SchedulerMixin"]


def test_importing_takes_hardly_longer_than_importing_diffusers(found):
    assert _silent(found, "import")["seconds"] < 1.0  # of processor time; measured 0.05
