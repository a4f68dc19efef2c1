"""Fitting the frozen `RatingEstimator` behind the paper's auxiliary conditioning loss (section 2.2)."""

import torch

from ..models.rating_estimator import RatingEstimator
from .steps import rating_loss

#: Share of the textures that hide their friction coefficient: a texture's file often lacks it.
FRICTION_DROPOUT = 0.2
#: R² on fewer surfaces is chance.
ENOUGH_SURFACES = 3


def fit_rating_estimator(
    channel_groups, pooled, ratings, held_out_pooled, held_out_ratings, axes, steps=600, batch_size=128, seed=0
):
    """Fits a `RatingEstimator` on clean states and freezes it.

    Args:
        channel_groups (`list[int]`): of the DALE.
        pooled (`torch.Tensor`): (n, sum of channel_groups, positions), `DALEModel.pool_state` of packed states.
        ratings (`torch.Tensor`): (n, axes), z-scores; NaN = unknown.
        held_out_pooled, held_out_ratings (`torch.Tensor`): of surfaces that it does not see.
        axes (`Sequence[str]`): their names.
        steps (`int`): optimiser updates.
        batch_size (`int`): states per update.
        seed (`int`): of weights and batches; the global random state is left alone.

    Returns:
        `tuple[RatingEstimator, list[float]]`: frozen, in eval mode, and R² per axis on the held-out
            surfaces, NaN for an axis without different ratings.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        estimator = RatingEstimator(list(channel_groups), list(axes))
    generator = torch.Generator().manual_seed(seed)
    optimizer = torch.optim.AdamW(estimator.parameters(), lr=2e-3, weight_decay=0.05)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 2e-3, total_steps=steps)
    for _ in range(steps):
        rows = torch.randint(len(pooled), (batch_size,), generator=generator)
        # a little noise, because it will judge predicted states, which are not quite clean
        noise = 0.1 * torch.randn(pooled[rows].shape, generator=generator)
        knows_friction = torch.rand(batch_size, generator=generator) > FRICTION_DROPOUT
        loss = rating_loss(estimator(pooled[rows] + noise, knows_friction), ratings[rows]).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
    estimator.eval().requires_grad_(False)
    estimated = torch.cat([estimator(piece) for piece in held_out_pooled.split(256)])
    return estimator, [r_squared(*pair) for pair in zip(held_out_ratings.T, estimated.T, strict=True)]


def r_squared(ratings, estimated):
    """R² of estimates where ratings (n,) are known; NaN where they do not differ."""
    known = ~torch.isnan(ratings)
    ratings, estimated = ratings[known], estimated[known]
    deviation = (ratings - ratings.mean()).square().sum()
    return float(1 - (ratings - estimated).square().sum() / deviation) if deviation > 0 else float("nan")


def describe_scores(scores, surfaces):
    """R² per axis as text, or why there is none: `scores` of `fit_rating_estimator`, on so many rated surfaces."""
    if surfaces < ENOUGH_SURFACES:
        return f"not reported: {surfaces} held-out surfaces are too few"
    return ", ".join("unknown" if score != score else f"{score:.3f}" for score in scores)
