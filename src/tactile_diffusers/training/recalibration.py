"""Recalibration in closed form: what a pretrained DALE gets wrong of a lab's surfaces, as entries of its config.

The numbers of a whole texture (`DALEModel.split_scalars`) are compared, surface by surface, with what DALE generates
from the surface's ratings. What differs is explained by an offset and slopes over the ratings. Both have a Gaussian
prior around 0, the pretrained mapping; how wide it is, the evidence of all numbers of a group says (empirical Bayes).
With few surfaces, or no difference, nothing moves; with many it is a regression of the surfaces themselves.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
import torch

from ..models.calibration import calibration_inputs, expected_ratings
from ..models.dale_state import cosines
from ..models.rating_statistics import RatingStatistics
from ..models.unet_1d import from_patches

#: Textures that are generated for each surface.
TAKES = 32
#: Standard deviations of the priors of offsets and slopes, and of what is left between surfaces, in those of generated
#: textures of the same ratings. The largest is for sensors with another unit.
OFFSETS, SLOPES = (0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 12.8), (0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2)
RESIDUALS = (0.4, 0.6, 0.8, 1.0, 1.3, 1.7, 2.2)
#: As how many surfaces the pretrained model counts: its spreads over textures, its shapes within textures, its ratings.
SPREAD_SURFACES, SHAPE_SURFACES, RATING_SURFACES = 10, 3, 4
#: Spreads and shapes change by this factor at most.
LARGEST_FACTOR = 2.0


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Textures as states of a DALE, each of one of n rated surfaces.

    Attributes:
        states (`torch.Tensor`): (m, in_channels, frames).
        owners (`np.ndarray`): (m,), the surface of each, 0 to n - 1.
        ratings (`np.ndarray`): (n, axes), z-scores, NaN = unknown.
        knows_friction (`np.ndarray`): (m,) bool.
    """

    states: torch.Tensor
    owners: np.ndarray
    ratings: np.ndarray
    knows_friction: np.ndarray

    def __len__(self):
        return len(self.ratings)

    def keep(self, chosen):
        """Those surfaces (indices), numbered anew in this order."""
        rows = [np.flatnonzero(self.owners == one) for one in chosen]
        owners, rows = np.repeat(np.arange(len(rows)), [len(own) for own in rows]), np.concatenate(rows)
        return Surfaces(self.states[rows], owners, self.ratings[chosen], self.knows_friction[rows])

    def mean(self, values):
        """Mean of values (m, ...) over the textures of each surface: (n, ...)."""
        return np.stack([values[self.owners == one].mean(0) for one in range(len(self))])


@torch.no_grad()
def generate_surfaces(dale, scheduler, ratings, takes, steps, seed=0, batch=64):
    """What DALE generates from ratings (n, axes), z-scores: `Surfaces` of so many takes each.

    Their states are those of the latents that the decoder gets: what a generated state holds besides, as a mean of what
    varies about its mean, does not reach it.
    """
    generator, device = torch.Generator().manual_seed(seed), next(dale.parameters()).device
    rows, made = torch.from_numpy(np.repeat(ratings, takes, axis=0)).float(), []
    for part in rows.split(batch):
        shape = (len(part), dale.config.in_channels, dale.config.latent_frames)
        state, part = torch.randn(shape, generator=generator).to(device), part.to(device)
        scheduler.set_timesteps(steps)
        for t in scheduler.timesteps:
            state = scheduler.step(dale(state, t, part, return_dict=False)[0], t, state, return_dict=False)[0]
        made.append(dale.pack(*dale.unpack(state)).cpu())
    return Surfaces(torch.cat(made), np.repeat(np.arange(len(ratings)), takes), ratings, np.ones(len(rows), bool))


def scalars_of(dale, surfaces):
    """The numbers of whole textures, (m, num_scalars) float64; an unknown log friction coefficient is NaN."""
    values = dale.split_scalars(surfaces.states)[1].double().numpy()
    values[~surfaces.knows_friction, -1] = np.nan
    return values


def spectra_db(dale, scalars):
    """Mean levels of the bands in scalars (n, num_scalars), dB but for a constant: (n, bands); or the level alone."""
    config, count = dale.config, dale.config.level_channels
    log_power = 2 * (scalars[:, -2:-1] * config.level_std + config.level_mean)
    if count:
        means = scalars[:, :count] * np.array(config.latent_std[:count]) + np.array(config.latent_mean[:count])
        bands = means @ cosines(count, torch.zeros(1, dtype=torch.float64)).numpy()
        log_power = log_power + bands[:, :-1]  # the last one lies above the band of textures
    return 10 / math.log(10) * log_power


def groups_of(dale):
    """Columns of the scalars that share a prior: spectrum and level, variation over time, friction."""
    levels, sizes = dale.config.level_channels, dale.num_sizes
    groups = [*range(levels), levels + sizes], list(range(levels, levels + sizes)), [levels + sizes + 1]
    return [np.array(columns) for columns in groups if columns]


def explain(differences, inputs, scale):
    """Offset (k,) and slopes (axes, k) that explain differences (n, k) of surfaces with inputs (n, axes).

    Means of the posteriors under all priors, weighed by their evidence; `scale` (k,) brings the numbers to one unit.
    """
    targets, alike, rest = differences / scale, inputs @ inputs.T, np.eye(len(inputs))
    evidence, offsets, slopes = [], [], []
    for offset, slope, residual in itertools.product(OFFSETS, SLOPES, RESIDUALS):
        covariance = offset**2 + slope**2 * alike + residual**2 * rest
        solved = np.linalg.solve(covariance, targets)
        determinant = np.linalg.slogdet(covariance)[1]
        evidence.append(-0.5 * (targets.shape[1] * determinant + (targets * solved).sum()))
        offsets.append(offset**2 * solved.sum(0))
        slopes.append(slope**2 * inputs.T @ solved)
    weights = np.exp(np.array(evidence) - max(evidence))
    weights /= weights.sum()
    return np.tensordot(weights, offsets, 1) * scale, np.tensordot(weights, slopes, 1) * scale


@dataclass(frozen=True, eq=False)
class Recalibration:
    """What changes in DALE, in standard deviations of its numbers; `recalibrate` finds it, `apply` sets it.

    Attributes:
        offset, slopes, factor (`np.ndarray`): (num_scalars,), (axes, num_scalars), (num_scalars,): a number becomes
            offset + ratings @ slopes + factor * number.
        centre, covariance (`np.ndarray`): of the ratings, (axes,) and (axes, axes).
        count (`int`): of the axes, the first ones, that DALE's networks know; the slopes of further ones are of what
            those leave open (`calibration_inputs`).
        shapes (`tuple`): shift and factor of the learned latents (channels,), factor of departures (bands,).
    """

    offset: np.ndarray
    slopes: np.ndarray
    factor: np.ndarray
    centre: np.ndarray
    covariance: np.ndarray
    count: int
    shapes: tuple

    def moved(self, scalars, ratings):
        """Scalars (n, num_scalars) at ratings (n, axes) after the recalibration."""
        return (
            self.offset
            + _inputs(ratings, self.centre, self.covariance, self.count) @ self.slopes
            + self.factor * scalars
        )

    def apply(self, dale):
        """Sets the entries of DALE's config; one that is calibrated already is calibrated further."""
        config, levels = dale.config, dale.config.level_channels
        shift, size, departures = self.shapes
        count = dale.latent_channels - config.envelope_channels
        mean = np.array(config.latent_mean or [0.0] * count)
        std = np.array(config.latent_std or [1.0] * count)
        mean[levels:] += std[levels:] * shift
        std = std * np.concatenate([self.factor[:levels], size])
        earlier = config.calibration or {"offset": 0.0, "slopes": 0.0}
        calibration = {
            "offset": self.offset / self.factor + np.array(earlier["offset"]),
            "slopes": self.slopes / self.factor + np.array(earlier["slopes"]),
            "centre": self.centre,
            "covariance": self.covariance,
        }
        sizes = self.factor[levels : levels + dale.num_sizes]
        changes = {
            "latent_mean": mean.tolist(),
            "latent_std": std.tolist(),
            "departure_std": (np.array(config.departure_std or [1.0] * levels) * departures).tolist(),
            "size_std": (np.array(config.size_std or [1.0] * dale.num_sizes) * sizes).tolist(),
            "level_std": float(config.level_std * self.factor[-2]),
            "calibration": {name: value.tolist() for name, value in calibration.items()},
        }
        if config.log_friction_std is not None:
            changes["log_friction_std"] = float(config.log_friction_std * self.factor[-1])
        dale.register_to_config(**changes)


def recalibrate(dale, real, generated):
    """Finds what of DALE's numbers differs from a lab's: `Recalibration`.

    Args:
        dale (`DALEModel`): pretrained.
        real (`Surfaces`): the lab's, packed by `dale`.
        generated (`Surfaces`): `generate_surfaces` from the ratings of the same surfaces.
    """
    values, made = scalars_of(dale, real), scalars_of(dale, generated)
    made_means, count = generated.mean(made), len(real)
    axes, known_axes = real.ratings.shape[1], dale.config.network_axes or real.ratings.shape[1]
    takes = len(made) / count
    scale = np.sqrt(np.square(made - made_means[generated.owners]).sum(0) / (len(made) - count)).clip(1e-3)
    centre, covariance = _rating_distribution(dale, real.ratings)
    inputs = _inputs(real.ratings, centre, covariance, known_axes)
    inputs[:, np.isnan(real.ratings).all(0)] = 0.0  # sliders that nobody rated stay as they are
    inputs, further = inputs[:, :known_axes], inputs[:, known_axes:]
    differences = real.mean(values) - made_means
    offset, slopes = np.zeros(values.shape[1]), np.zeros((axes, values.shape[1]))
    for columns in groups_of(dale):
        known = np.isfinite(differences[:, columns]).all(1)  # friction may be unknown
        if known.any():
            own = differences[known][:, columns]
            offset[columns], slopes[:known_axes, columns] = explain(own, inputs[known], scale[columns])
            left = own - offset[columns] - inputs[known] @ slopes[:known_axes, columns]
            # further axes explain what those before leave, whose slopes stay as they are; each number by itself, since
            # most of them do not follow a new axis at all
            for place, column in enumerate(columns if axes > known_axes else ()):
                slopes[known_axes:, [column]] = explain(left[:, [place]], further[known], scale[[column]])[1]
    left = values - (made_means + offset + inputs @ slopes[:known_axes])[real.owners]
    variance = np.nanmean(real.mean(np.square(np.nan_to_num(left))), axis=0)
    ratio = np.sqrt((variance / scale**2 - 1 / takes).clip(1e-6))  # without what the takes' own mean scatters
    factor = _limited(np.where(np.isfinite(values).all(0), ratio, 1.0), count / (count + SPREAD_SURFACES))
    # a wider spread must not make the pretrained mapping steeper: what it adds along the ratings is taken away
    apart = inputs - inputs.mean(0)
    steep = np.linalg.solve(apart.T @ apart + np.eye(known_axes), apart.T @ made_means)
    offset = offset + (1 - factor) * (made_means.mean(0) - inputs.mean(0) @ steep)
    slopes[:known_axes] += (1 - factor) * steep
    return Recalibration(offset, slopes, factor, centre, covariance, known_axes, _shapes(dale, real, generated))


def _limited(ratio, weight):
    """Factors of a weight between 0, none, and 1, all of the ratio, within the limits."""
    return np.exp(weight * np.log(np.clip(ratio, 1 / LARGEST_FACTOR, LARGEST_FACTOR)))


def _shapes(dale, real, generated):
    """Shift and factor of the learned latents, and factor of the departures, after all surfaces alike."""

    def moments(surfaces):
        field, departures, _ = dale.pool_state(surfaces.states).split(dale.channel_groups, dim=1)
        learned = from_patches(field, dale.config.patch_size)[:, dale.config.envelope_channels :]
        parts = learned.mean(-1), learned.square().mean(-1), departures.square().mean(-1)
        mean, square, departure = (surfaces.mean(part.double().numpy()).mean(0) for part in parts)
        return mean, np.sqrt((square - mean**2).clip(1e-6)), np.sqrt(departure.clip(1e-6))

    ours, theirs = moments(real), moments(generated)
    weight = len(real) / (len(real) + SHAPE_SURFACES)
    factors = [_limited(ours[part] / theirs[part], weight) for part in (1, 2)]
    return weight * (ours[0] - factors[0] * theirs[0]), *factors


def _rating_distribution(dale, ratings):
    """Centre and covariance of a lab's ratings (n, axes), NaN = unknown; the pretrained ones count as few surfaces."""
    statistics, axes = RatingStatistics.from_config(dale.config), ratings.shape[1]
    centre = np.zeros(axes) if statistics.centre is None else np.array(statistics.centre)
    covariance = np.eye(axes) if statistics.covariance is None else np.array(statistics.covariance)
    filled = _filled(ratings, centre, covariance)
    weight = len(ratings) / (len(ratings) + RATING_SURFACES)
    own = np.atleast_2d(np.cov(filled, rowvar=False, bias=True))
    return centre + weight * (filled.mean(0) - centre), covariance + weight * (own - covariance)


def _inputs(ratings, centre, covariance, count):
    parts = (torch.from_numpy(np.array(values, float)) for values in (ratings, centre, covariance))
    return calibration_inputs(*parts, count).numpy()


def _filled(ratings, centre, covariance):
    parts = (torch.from_numpy(np.array(values, float)) for values in (ratings, centre, covariance))
    return expected_ratings(*parts).numpy()
