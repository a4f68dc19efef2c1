"""What precedes the training of DALE: latents of a data set, statistics for its config, and the rating estimator."""

import numpy as np
import torch
from tqdm.auto import tqdm

from ..data.ratings import rating_coverage, rating_quantiles
from ..models.dale import NUM_SCALARS, DALEModel
from ..models.dale_state import latent_statistics
from ..models.rating_estimator import RatingEstimator
from .steps import rating_loss

#: Segments that the encoder reads at once, and that DALE packs at once.
ENCODED_AT_ONCE, PACKED_AT_ONCE = 64, 512
#: Share of the textures that hide their friction coefficient from the estimator: a texture's file often lacks it.
FRICTION_DROPOUT = 0.2
#: R² on fewer surfaces is chance.
ENOUGH_SURFACES = 3


def encode_dataset(pipe, dataset, quiet=False):
    """Base layers of all segments, (n, base_channels, frames) float32. The encoder is frozen, so once is enough."""
    latents = []
    for start in tqdm(range(0, len(dataset), ENCODED_AT_ONCE), disable=quiet, desc="latents"):
        rows = dataset.textures(np.arange(start, min(start + ENCODED_AT_ONCE, len(dataset))))
        encoded = pipe.encode(rows, dataset.sampling_rate).latents[:, : pipe.lctg.base_channels]
        latents.append(encoded.float().cpu())
    return torch.cat(latents)


def mean_and_std(values):
    """Mean and standard deviation of what is known, as floats; (`None`, `None`) where nothing is."""
    values = np.asarray(values, dtype=np.float64)
    values = values[np.isfinite(values)]
    return (float(values.mean()), float(max(values.std(), 1e-3))) if len(values) else (None, None)


def rating_statistics(dataset):
    """Statistics of the training surfaces' ratings for DALE's config; empty if an axis has none."""
    ratings = dataset.ratings.mean[np.unique(dataset.surface_ids)]
    quantiles = rating_quantiles(ratings)
    if np.isnan(quantiles).any():
        return {}
    coverage = rating_coverage(ratings)
    found = {}
    if coverage is not None:
        centre, covariance, reach = coverage
        found = {"centre": centre.tolist(), "covariance": covariance.tolist(), "reach": reach}
    return found | {
        "mean": dataset.ratings.raw_mean.tolist(),
        "std": dataset.ratings.raw_scale.tolist(),
        "range": quantiles[:, [0, -1]].tolist(),
        "quantiles": quantiles.tolist(),
    }


def build_dale(lctg, dataset, latents, **config):
    """A new `DALEModel` whose config holds the statistics of the training set.

    Args:
        lctg (`LCTGModel`): whose base layer it generates.
        dataset (`PreparedDataset`): the training view.
        latents (`torch.Tensor`): (n, base_channels, frames), of `encode_dataset`.
        config: arguments of `DALEModel` that replace the ones found here.
    """
    level_mean, level_std = mean_and_std(dataset.levels)
    friction_mean, friction_std = mean_and_std(np.log(np.maximum(dataset.friction_coefficients, 1e-3)))
    layout = {"level_channels": lctg.level_channels, "envelope_channels": lctg.config.envelope_channels}
    layout["patch_size"] = config.get("patch_size", 2 if lctg.passed_channels else 1)
    statistics = latent_statistics(latents, **layout)
    settings = {
        "in_channels": lctg.base_channels + lctg.level_channels + len(statistics["size_mean"]) + NUM_SCALARS,
        "latent_frames": latents.shape[-1],
        **layout,
        **statistics,
        "level_mean": level_mean,
        "level_std": level_std,
        "log_friction_mean": friction_mean,
        "log_friction_std": friction_std,
        "rating_axes": dataset.ratings.axes,
        "rating_statistics": rating_statistics(dataset),
        "reference_speed": mean_and_std(dataset.speeds)[0],
    }
    return DALEModel(**settings | config)


def training_states(dale, dataset, latents, single_raters=False):
    """What `DALETrainingStep` reads of each segment, as tensors of n rows.

    Surfaces count alike, however many segments they have: within limits of force and speed that depends on how they are
    explored, which depends on how they feel. Weights end at four times the mean.

    Args:
        dale (`DALEModel`): packs the states.
        dataset (`PreparedDataset`): with n segments.
        latents (`torch.Tensor`): (n, base_channels, frames), of `encode_dataset`.
        single_raters (`bool`): ratings of single raters, (n, raters, axes), in place of the pooled ones.

    Returns:
        `dict[str, torch.Tensor]`: "state" (n, in_channels, frames), "ratings" (n, axes) in z-scores, "ratings_error"
            (n, axes), the standard error of the pooled ones, "knows_friction" (n,) bool, "weight" (n,).
    """
    friction = torch.from_numpy(np.asarray(dataset.friction_coefficients, dtype=np.float32))
    level = torch.from_numpy(np.asarray(dataset.levels, dtype=np.float32))
    surfaces = dataset.surface_ids
    ratings = np.moveaxis(dataset.ratings.single, 0, 1) if single_raters else dataset.ratings.mean
    counts = np.bincount(surfaces)
    weight = np.minimum(1 / counts[surfaces], 4 * np.mean(1 / counts[surfaces]))
    error = dataset.ratings.std / np.sqrt(np.maximum(dataset.ratings.count, 1))
    parts = zip(*(values.split(PACKED_AT_ONCE) for values in (latents, level, friction)), strict=True)
    return {
        "state": torch.cat([dale.pack(*part) for part in parts]),
        "ratings": torch.from_numpy(ratings[surfaces].astype(np.float32)),
        "ratings_error": torch.nan_to_num(torch.from_numpy(error[surfaces].astype(np.float32))),
        "knows_friction": torch.isfinite(friction),
        "weight": torch.from_numpy((weight / weight.mean()).astype(np.float32)),
    }


def fit_rating_estimator(
    channel_groups, pooled, ratings, held_out_pooled, held_out_ratings, axes, steps=600, batch_size=128, seed=0
):
    """Fits a `RatingEstimator` on clean states and freezes it.

    Args:
        channel_groups (`list[int]`): of the DALE.
        pooled (`torch.Tensor`): (n, channels, positions), `DALEModel.pool_state` of packed states.
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
    return estimator, [_r_squared(*pair) for pair in zip(held_out_ratings.T, estimated.T, strict=True)]


def _r_squared(ratings, estimated):
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
