"""Energy scores: smallest where results are distributed as real ones, on anything a model may have."""

import pytest
import torch

from tactile_diffusers import DALEModel
from tactile_diffusers.training.energy import energy_score, waveform_views
from tactile_diffusers.training.state_views import StateViews


def _normal(*shape, seed):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def test_the_score_is_least_for_the_spread_of_the_real_ones():
    first, second, real = (_normal(4000, 1, 8, seed=seed) for seed in range(3))
    scores = [energy_score([first * spread], [second * spread], [real]).item() for spread in (0.0, 0.6, 1.0, 1.5)]
    assert min(scores) == scores[2]
    # an average, the best of a regression, is far from it: the mean distance from it counts twice
    assert scores[0] > 1.2 * scores[2]


def test_the_score_weighs_rows():
    views = [[_normal(6, 3, 4, seed=seed)] for seed in range(3)]
    kept = [[view[:3] for view in each] for each in views]
    weighted = energy_score(*views, torch.tensor([2.0, 2.0, 2.0, 0.0, 0.0, 0.0]))
    torch.testing.assert_close(weighted, energy_score(*kept))


class TestWaveforms:
    def _score(self, change):
        """Score of changed noise with catches that load slowly and let go fast."""
        ramps = torch.linspace(-1, 1, 64).repeat(32)
        waves = [ramps + 0.1 * _normal(12, 2048, seed=seed) for seed in range(3)]
        views = [waveform_views(wave, 2500, (20, 1000)) for wave in (change(waves[0]), change(waves[1]), waves[2])]
        assert all(view.ndim == 3 and torch.isfinite(view).all() for part in views for view in part)
        return energy_score(*views).item()

    @pytest.mark.parametrize(
        "change",
        [torch.neg, lambda wave: 0.8 * wave, lambda wave: _normal(12, 2048, seed=9) * wave.std()],
        ids=["upside down", "quieter", "noise"],
    )
    def test_a_change_is_seen(self, change):
        assert self._score(change) > 1.05 * self._score(lambda wave: wave)

    def test_silence_has_gradients(self):
        wave = torch.zeros(2, 2048, requires_grad=True)
        views = waveform_views(wave, 2500, (20, 1000))
        energy_score(views, views, waveform_views(_normal(2, 2048, seed=0), 2500, (20, 1000))).backward()
        assert torch.isfinite(wave.grad).all()


class TestStates:
    @pytest.fixture(params=["all", "envelope", "levels", "neither"])
    def dale(self, request):
        levels, envelope = {"all": (5, 4), "envelope": (0, 4), "levels": (5, 0), "neither": (0, 0)}[request.param]
        shape = {"level_channels": levels, "envelope_channels": envelope, "widths": [8, 8], "embedding_dim": 8}
        scalars = 2 + levels + (levels > 0) + 16 * (envelope > 0)
        return DALEModel(in_channels=scalars + levels + envelope + 3, rating_dim=8, latent_frames=32, **shape)

    def test_views_have_gradients_for_any_model(self, dale):
        states = _normal(24, dale.config.in_channels, 32, seed=0)
        views, made = StateViews(dale, states), _normal(6, dale.config.in_channels, 32, seed=1).requires_grad_()
        found, known = views(made), views(states[:6])
        energy_score(found, found, known).backward()
        assert torch.isfinite(made.grad).all() and made.grad.abs().sum() > 0
