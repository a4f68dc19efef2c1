"""Further training of DALE's fields: what it changes, what it leaves, and that it is undone where it does not help."""

import copy

import numpy as np
import pytest
import torch

from tactile_diffusers import VDDIMScheduler
from tactile_diffusers.training import further_training
from tactile_diffusers.training.further_training import train_fields

LEFT_OUT = np.arange(40) >= 32


@pytest.fixture
def dale(make_dale):
    return make_dale(scalar_width=16, distilled_steps=1).eval()


@pytest.fixture
def states(dale):
    shape = (len(LEFT_OUT), dale.config.in_channels, dale.config.latent_frames)
    ratings, error = torch.zeros(len(LEFT_OUT), 3), torch.zeros(len(LEFT_OUT), 3)
    state = torch.randn(shape, generator=torch.Generator().manual_seed(0))
    return {"state": state, "ratings": ratings, "ratings_error": error, "weight": torch.ones(len(LEFT_OUT))}


def _changed(before, dale):
    return {name for name, value in dale.state_dict().items() if not torch.equal(value, before[name])}


def test_it_trains_the_fields_alone_and_the_same_seed_gives_the_same_weights(dale, states):
    before, twin = copy.deepcopy(dale.state_dict()), copy.deepcopy(dale)
    told = train_fields(dale, VDDIMScheduler(), states, LEFT_OUT, updates=30, seed=0)
    assert told.endswith(".") and "stays as it is" not in told and not dale.training
    changed = _changed(before, dale)
    assert changed and not any(name.startswith("scalar_network") for name in changed)
    train_fields(twin, VDDIMScheduler(), states, LEFT_OUT, updates=30, seed=0)
    assert not _changed(dale.state_dict(), twin)


def test_what_does_not_help_surfaces_left_out_is_undone(dale, states, monkeypatch):
    monkeypatch.setattr(further_training, "LEARNING_RATE", 3.0)
    before = copy.deepcopy(dale.state_dict())
    assert "stays as it is" in train_fields(dale, VDDIMScheduler(), states, LEFT_OUT, updates=5, seed=0)
    assert not _changed(before, dale)
