"""Accelerate is told of the CPU: on demand, and where there is nothing else."""

import pytest
import torch

from tactile_diffusers.training.processes import on_cpu


@pytest.mark.parametrize(
    ("flag", "gpu", "answer"), [(None, True, False), (None, False, True), ("true", True, True), ("false", True, False)]
)
def test_the_cpu_is_taken_on_demand_and_for_want_of_a_gpu(flag, gpu, answer, monkeypatch):
    monkeypatch.delenv("ACCELERATE_USE_CPU", raising=False)
    if flag is not None:
        monkeypatch.setenv("ACCELERATE_USE_CPU", flag)
    monkeypatch.setattr(torch.accelerator, "is_available", lambda: gpu)
    assert on_cpu() is answer
