"""The frozen regressor behind the paper's auxiliary conditioning loss (section 2.2)."""

import torch
from torch import nn

from ..models.dale import NUM_SCALARS
from .losses import rating_loss


class RatingHead(nn.Module):
    """Ratings from DALE's clean state: (batch, in_channels, frames) -> (batch, axes) z-scores.

    It learns from real latents only and is frozen before DALE trains: a head that learned along with DALE would
    collude with it and hide the rating in a latent direction that nobody feels.
    """

    def __init__(self, in_channels, axes, width=96):
        super().__init__()
        self.latent_channels = in_channels - NUM_SCALARS
        self.net = nn.Sequential(
            nn.Conv1d(self.latent_channels, width, 5, padding=2),
            nn.SiLU(),
            nn.Conv1d(width, width, 5, stride=2, padding=2),
            nn.SiLU(),
            nn.Conv1d(width, width, 5, padding=2),
        )
        self.out = nn.Sequential(nn.Linear(2 * width + NUM_SCALARS, width), nn.SiLU(), nn.Linear(width, axes))

    def forward(self, state):
        latents, scalars = state.split([self.latent_channels, NUM_SCALARS], dim=1)
        hidden_states = self.net(latents)
        scalars = scalars.sum(-1) / state.shape[-1] ** 0.5
        pooled = [hidden_states.mean(-1), hidden_states.std(-1), scalars]
        return self.out(torch.cat(pooled, dim=1))


def train_rating_head(states, ratings, held_out_states, held_out_ratings, steps=600, batch_size=128, seed=0):
    """Fits a `RatingHead` on clean states and freezes it.

    Args:
        states (`torch.Tensor`): (n, in_channels, frames), from `DALEModel.pack`.
        ratings (`torch.Tensor`): (n, axes), z-scores; NaN = unknown.
        held_out_states, held_out_ratings (`torch.Tensor`): of surfaces that it does not see.
        steps (`int`): optimiser updates.
        batch_size (`int`): states per update.
        seed (`int`): of weights and batches; the global random state is left alone.

    Returns:
        `tuple[RatingHead, list[float]]`: the frozen head in eval mode, and R² per axis on the held-out
            surfaces, NaN for an axis without different ratings.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        head = RatingHead(states.shape[1], ratings.shape[1])
    generator = torch.Generator().manual_seed(seed)
    optimizer = torch.optim.AdamW(head.parameters(), lr=2e-3, weight_decay=0.05)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 2e-3, total_steps=steps)
    for _ in range(steps):
        rows = torch.randint(len(states), (batch_size,), generator=generator)
        # a little noise, because it will judge predicted states, which are not quite clean
        noise = 0.1 * torch.randn(states[rows].shape, generator=generator)
        loss = rating_loss(head(states[rows] + noise), ratings[rows]).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
    head.eval().requires_grad_(False)
    heard = torch.cat([head(piece) for piece in held_out_states.split(256)])
    scores = []
    for axis in range(ratings.shape[1]):
        known = ~torch.isnan(held_out_ratings[:, axis])
        truth, guess = held_out_ratings[known, axis], heard[known, axis]
        spread = (truth - truth.mean()).square().sum()
        scores.append(float(1 - (truth - guess).square().sum() / spread) if spread > 0 else float("nan"))
    return head, scores
