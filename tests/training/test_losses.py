"""Losses with known answers."""

import math

import pytest
import torch

from tactile_diffusers.training.steps import (
    frequency_aware_loss,
    octave_weights,
    rating_loss,
    velocity_loss,
)


def _noise(*shape, seed=0):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


# --- velocity


def test_velocity_loss_is_the_mean_square_per_row():
    predicted = torch.tensor([[[1.0, 2.0], [3.0, 4.0]], [[0.0, 0.0], [0.0, 0.0]]])
    target = torch.tensor([[[1.0, 0.0], [3.0, 0.0]], [[1.0, 1.0], [1.0, 3.0]]])
    assert velocity_loss(predicted, target).tolist() == [5.0, 3.0]


def test_weighted_velocity_loss_of_a_tone_is_its_weight_times_its_power():
    samples, rate = 4096, 2500
    weights = octave_weights(samples, rate, (20.0, 1000.0), 1.0)
    for index in (66, 400, 1500):  # whole periods: one frequency each
        tone = 0.3 * torch.sin(2 * math.pi * index * torch.arange(samples, dtype=torch.float64) / samples).float()
        loss = velocity_loss(tone[None, None], torch.zeros(1, 1, samples), weights)
        # half the power is in each of the two-sided lines, over samples / 2 + 1 bins
        expected = weights[index] * 0.3**2 / 4 * samples / (samples // 2 + 1)
        torch.testing.assert_close(loss, expected[None], rtol=1e-4, atol=0)  # float32 transform


def test_octave_weights():
    weights = octave_weights(4096, 2500, (20.0, 1000.0), 1.0)
    frequencies = torch.arange(2049) * 2500 / 4096
    assert weights.shape == (2049,) and weights.mean().item() == pytest.approx(1.0, abs=1e-5)
    inside = (frequencies >= 20) & (frequencies <= 1000)
    products = weights[inside] * frequencies[inside]
    torch.testing.assert_close(products, products[:1].expand_as(products), rtol=1e-5, atol=0)
    assert weights[0] == weights[10] and weights[-1] == weights[-100]  # constant outside
    # every octave counts the same
    octaves = [weights[(frequencies >= low) & (frequencies < 2 * low)].sum() for low in (40, 80, 160, 320)]
    assert max(octaves) / min(octaves) < 1.05
    assert torch.equal(octave_weights(64, 2500, (20.0, 1000.0), 0.0), torch.ones(33))


# --- spectra


def test_spectral_loss_of_identical_signals_is_zero_and_grows():
    clean, noise = _noise(2, 4096), _noise(2, 4096, seed=1)
    assert frequency_aware_loss(clean, clean).tolist() == [0.0, 0.0]
    losses = torch.stack([frequency_aware_loss(clean + s * noise, clean) for s in (0.1, 0.3, 1.0, 3.0)])
    assert (losses[0] > 0).all() and (losses.diff(dim=0) > 0).all()


def test_spectral_loss_of_a_gain_is_its_logarithm():
    clean = 100 * _noise(3, 4096)  # far above the floor that keeps silence out of the logarithm
    loss = frequency_aware_loss(clean * 2, clean)
    # a bin here and there comes near the floor: below 0.1 %
    torch.testing.assert_close(loss, torch.full((3,), math.log(2)), rtol=2e-3, atol=0)


def test_spectral_loss_of_silence_is_finite():
    silent = torch.zeros(1, 2048, requires_grad=True)
    loss = frequency_aware_loss(silent, _noise(1, 2048))
    loss.sum().backward()
    assert loss.isfinite().all() and silent.grad.isfinite().all()


# --- ratings


def test_rating_loss_leaves_out_what_is_not_specified():
    recovered = torch.tensor([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]])
    requested = torch.tensor([[0.0, 0.0, 0.0], [0.0, torch.nan, 1.0], [torch.nan] * 3])
    expected = torch.tensor([14 / 3, 2.5, 0.0])
    torch.testing.assert_close(rating_loss(recovered, requested), expected)
