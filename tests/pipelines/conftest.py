"""What the tests of the pipeline share."""

from pathlib import Path

import pytest
import torch


@pytest.fixture
def seeded():
    """`seeded(3)` is a generator, `seeded([3, 4])` a list of them."""

    def make(seed):
        if isinstance(seed, list):
            return [make(one) for one in seed]
        return torch.Generator("cpu").manual_seed(seed)

    return make


@pytest.fixture
def calls_of():
    """`calls_of(module)` returns a list that fills with the positional arguments of every forward call."""
    handles = []

    def watch(module):
        calls = []
        handles.append(module.register_forward_pre_hook(lambda module, args: calls.append(args)))
        return calls

    yield watch
    for handle in handles:
        handle.remove()


@pytest.fixture
def tiny_checkpoint():
    """The committed checkpoint that every later version must load."""
    return Path(__file__).parents[1] / "fixtures" / "tiny_pipeline"
