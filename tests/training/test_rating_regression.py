"""The frozen regressor of the auxiliary conditioning loss."""

import math

import pytest
import torch

from tactile_diffusers.training.dale_data import describe_scores, fit_rating_estimator


def _separable(count, seed, noise=0.3):
    """Numbers whose first channel's mean, second channel's spread and last scalar carry the three ratings."""
    generator = torch.Generator().manual_seed(seed)

    def normal(*shape):
        return torch.randn(shape, generator=generator)

    ratings, states = normal(count, 3), normal(count, 6, 16)
    states[:, 0] = 0.5 * states[:, 0] + ratings[:, :1]
    states[:, 1] = states[:, 1] * torch.exp(0.7 * ratings[:, 1:2])
    states[:, 4:] = normal(count, 2, 1)
    states[:, 5] = ratings[:, 2:3] + noise * normal(count, 1)
    return states, ratings


def _fit(*arguments, **options):
    return fit_rating_estimator([3, 1, 2], *arguments, ("roughness", "bumpiness", "slipperiness"), **options)


@pytest.fixture(scope="module")
def trained():
    states, ratings = _separable(600, 0)
    ratings[::3, 1] = torch.nan  # unknown ratings are left out
    return _fit(states, ratings, *_separable(300, 1), steps=150, batch_size=64, seed=0)


def test_it_finds_what_is_there(trained):
    _, scores = trained
    assert len(scores) == 3 and min(scores) > 0.5
    states, ratings = _separable(300, 1)
    heard = trained[0](states)
    expected = 1 - (ratings - heard).square().sum(0) / (ratings - ratings.mean(0)).square().sum(0)
    assert scores == pytest.approx(expected.tolist(), abs=1e-4)  # the score is R², written again


def test_it_is_frozen_and_still_passes_gradients_to_what_it_judges(trained):
    head, _ = trained
    assert not head.training and not any(p.requires_grad for p in head.parameters())
    state = torch.randn((2, 6, 16), generator=torch.Generator().manual_seed(0)).requires_grad_()
    gradient, *_ = torch.autograd.grad(head(state).square().sum(), state)
    assert gradient.isfinite().all() and gradient.any()


def test_seeded_and_without_touching_the_global_random_state():
    states, ratings = _separable(50, 0)
    before = torch.get_rng_state()
    first, _ = _fit(states, ratings, states, ratings, steps=3, batch_size=8, seed=4)
    assert torch.equal(torch.get_rng_state(), before)
    torch.manual_seed(99)
    again, _ = _fit(states, ratings, states, ratings, steps=3, batch_size=8, seed=4)
    other, _ = _fit(states, ratings, states, ratings, steps=3, batch_size=8, seed=5)
    pairs = list(zip(first.parameters(), again.parameters(), strict=True))
    assert all(torch.equal(a, b) for a, b in pairs)
    assert not torch.equal(next(first.parameters()), next(other.parameters()))


def test_friction_may_be_unknown(trained):
    states, ratings = _separable(300, 2)
    moved = states.clone()
    moved[:, 5] += 3.0
    unknown = torch.zeros(300, dtype=torch.bool)
    assert torch.equal(trained[0](states, unknown), trained[0](moved, unknown))
    assert (trained[0](moved) - trained[0](states))[:, 2].mean() > 0.5  # known, it is heard
    errors = (trained[0](states, unknown) - ratings).square().mean(0)
    assert errors[0] < 0.5 and errors[2] < 1.3  # the others are heard as before; of this the mean is the best guess


def test_the_score_of_an_axis_that_nobody_rated_is_not_a_number():
    # R² = 1 would claim a perfect judge
    states, ratings = _separable(40, 0)
    held_out = ratings.clone()
    held_out[:, 1] = torch.nan
    _, scores = _fit(states, ratings, states, held_out, steps=2, batch_size=8)
    assert math.isnan(scores[1]) and not math.isnan(scores[0])


def test_a_score_on_hardly_any_surface_is_no_number():
    assert describe_scores([-2.6e15, math.nan, 0.5], 1) == "not reported: 1 held-out surfaces are too few"
    assert describe_scores([0.25, math.nan, 0.5], 3) == "0.250, unknown, 0.500"
