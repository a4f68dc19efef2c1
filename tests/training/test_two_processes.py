"""Both training scripts in two processes on the CPU, against one process with the same global batch."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from safetensors.torch import load_file

EXAMPLES = Path(__file__).parents[2] / "examples"
# `accelerate launch --cpu --num_processes 2` starts one process (accelerate 1.15); torchrun is what it uses for GPUs
LAUNCH = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc_per_node=2"]
#: Gradients of two halves are added in another order than those of one batch: float32 rounding, which training carries
#: on. Measured after 100 steps: 1.4e-7 of the loss, 5e-6 of the largest weight. With noise of its own in each process,
#: losses differed by 1e-2 to 5e-2.
LOSS_RTOL, WEIGHT_TOLERANCE = 1e-5, 1e-3
CHANGES = {"max_train_steps": 60, "validation_samples": 2, "validation_steps": 1000, "checkpointing_steps": 1000}


def _launch(script, words):
    # no GPU is seen, and accelerate is not told
    environment = {"HF_HUB_OFFLINE": "1", "OMP_NUM_THREADS": "1", "CUDA_VISIBLE_DEVICES": ""}
    done = subprocess.run(
        [*LAUNCH, str(EXAMPLES / script), *words],
        capture_output=True,
        text=True,
        env={**os.environ, **environment},
        timeout=1200,
    )
    assert done.returncode == 0, done.stderr
    assert "cpu:0" in done.stderr  # accelerate's name of the device of the first process of several


def _curve(folder):
    entries = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    return {entry["step"]: entry["train/loss"] for entry in entries if "train/loss" in entry}


def _assert_learned_alike(one, two, name):
    assert list(_curve(one)) == [50, 60]
    assert _curve(two) == pytest.approx(_curve(one), rel=LOSS_RTOL)
    weights, others = (load_file(folder / name / "diffusion_pytorch_model.safetensors") for folder in (one, two))
    assert weights.keys() == others.keys()
    largest = max(value.abs().max() for value in weights.values())
    assert max((weights[key] - others[key]).abs().max() for key in weights) < WEIGHT_TOLERANCE * largest


@pytest.fixture(scope="module")
def lctg(script, run_script, tmp_path_factory):
    """Output folder of train_lctg.py in one process with batches of 4."""
    output = tmp_path_factory.mktemp("one") / "lctg"
    return run_script(script("train_lctg"), "lctg", output, train_batch_size=4, **CHANGES)


@pytest.mark.slow
def test_lctg_learns_in_two_processes_as_in_one(lctg, options_of_a_tiny_training, tmp_path):
    _launch("train_lctg.py", options_of_a_tiny_training("lctg", tmp_path / "two", train_batch_size=2, **CHANGES))
    _assert_learned_alike(lctg, tmp_path / "two", "lctg")


@pytest.mark.slow
def test_dale_learns_in_two_processes_as_in_one(lctg, script, run_script, options_of_a_tiny_training, tmp_path):
    changes = {**CHANGES, "pretrained_model_name_or_path": lctg, "rating_head_steps": 20}
    one = run_script(script("train_dale"), "dale", tmp_path / "one", train_batch_size=4, **changes)
    _launch("train_dale.py", options_of_a_tiny_training("dale", tmp_path / "two", train_batch_size=2, **changes))
    _assert_learned_alike(one, tmp_path / "two", "dale")
