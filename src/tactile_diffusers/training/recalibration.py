"""Recalibration in closed form: what a pretrained DALE gets wrong of a lab's surfaces, as entries of its config.

The numbers of a whole texture (`DALEModel.split_scalars`) are compared, surface by surface, with what DALE generates
from the surface's ratings. What differs is explained by an offset, slopes over the ratings and over their products. All
have a Gaussian prior around 0, the pretrained mapping; how wide it is, the evidence of all numbers of a group says
(empirical Bayes). With few surfaces, or no difference, nothing moves; with many it is a regression of the surfaces
themselves.

Slopes on top of a mapping cannot take away what it gets wrong of its own curves and mixtures. So the same is tried with
networks that see only a share of the ratings: the largest one that surfaces left out do not clearly speak against.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
import torch
from scipy import stats
from scipy.special import softmax

from ..models.calibration import calibration_inputs, expected_ratings, own_calibration, products
from ..models.dale_state import cosines
from ..models.rating_statistics import RatingStatistics
from ..models.unet_1d import from_patches

#: Textures that are generated for each surface.
TAKES = 32
#: Shares of the ratings that the networks see, of which one is taken.
TRUSTS = (1.0, 0.75, 0.5, 0.25)
#: Standard deviations of the priors of offsets and slopes, and of what is left between surfaces, in those of generated
#: textures of the same ratings; of the slopes over products, as a share of those over ratings. The largest offset is
#: for sensors with another unit.
OFFSETS, SLOPES = (0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 12.8), (0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2)
RESIDUALS = np.array([0.4, 0.6, 0.8, 1.0, 1.3, 1.7, 2.2])
CURVES = (0.0, 0.3)
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


def generate_trusting(dale, *args, **options):
    """For each of `TRUSTS` what DALE generates if its networks see that share of the ratings: dict of `Surfaces`."""
    given, found = dale.config.calibration, {}
    own = own_calibration(dale.config, dale.num_scalars)
    for trust in TRUSTS:
        dale.register_to_config(calibration=given if trust == 1 else own | {"trust": trust * own["trust"]})
        found[trust] = generate_surfaces(dale, *args, **options)
    dale.register_to_config(calibration=given)
    return found


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
    """Columns of the scalars that are explained together: spectrum and level, variation over time, friction."""
    levels, sizes = dale.config.level_channels, dale.num_sizes
    groups = [*range(levels), levels + sizes], list(range(levels, levels + sizes)), [levels + sizes + 1]
    return [np.array(columns) for columns in groups if columns]


def explain(differences, inputs, pairs, scale):
    """What explains differences (n, k) of surfaces with inputs (n, axes) and products of them (n, pairs).

    Means of the posteriors under all priors, weighed by their evidence; `scale` (k,) brings the numbers to one unit.

    Returns:
        `tuple`: offset (k,), slopes (axes, k), curves (pairs, k), and what each surface differs from what the others
        let expect (n, k).
    """
    targets, evidence, parts = differences / scale, [], []
    for offset, slope, curve in itertools.product(OFFSETS, SLOPES, CURVES if pairs.any() else CURVES[:1]):
        own, vectors = np.linalg.eigh(offset**2 + slope**2 * (inputs @ inputs.T + curve**2 * pairs @ pairs.T))
        rotated = vectors.T @ targets
        for residual in RESIDUALS:
            variances = own.clip(0)[:, None] + residual**2
            solved = vectors @ (rotated / variances)
            evidence.append(-0.5 * (np.log(variances).sum() * targets.shape[1] + (rotated**2 / variances).sum()))
            unexpected = solved / (vectors**2 @ (1 / variances))  # of a surface, given all others, in closed form
            parts.append(
                (
                    offset**2 * solved.sum(0),
                    slope**2 * inputs.T @ solved,
                    (slope * curve) ** 2 * pairs.T @ solved,
                    unexpected,
                )
            )
    weights = softmax(evidence)
    return tuple(scale * np.tensordot(weights, np.array(part), 1) for part in zip(*parts, strict=True))


@dataclass(frozen=True, eq=False)
class Recalibration:
    """What changes in DALE, in standard deviations of its numbers; `recalibrate` finds it, `apply` sets it.

    Attributes:
        trust (`float`): of `TRUSTS`, the share of the ratings from which the numbers are generated.
        offset, slopes, curves, factor (`np.ndarray`): (num_scalars,), (axes, num_scalars), (pairs, num_scalars) and
            (num_scalars,): a number becomes offset + ratings @ slopes + products @ curves + factor * number.
        centre, covariance (`np.ndarray`): of the ratings, (axes,) and (axes, axes).
        count (`int`): of the axes, the first ones, that DALE's networks know; the slopes of further ones are of what
            those leave open (`calibration_inputs`).
        shapes (`tuple`): shift and factor of the learned latents (channels,), factor of departures (bands,).
    """

    trust: float
    offset: np.ndarray
    slopes: np.ndarray
    curves: np.ndarray
    factor: np.ndarray
    centre: np.ndarray
    covariance: np.ndarray
    count: int
    shapes: tuple

    def moved(self, scalars, ratings):
        """Scalars (n, num_scalars), generated at this trust from ratings (n, axes), after the recalibration."""
        inputs = _inputs(ratings, self.centre, self.covariance, self.count)
        pairs = _products(inputs[:, : self.count])
        return self.offset + inputs @ self.slopes + pairs @ self.curves + self.factor * scalars

    def words(self):
        """How far the networks are trusted, a sentence, or nothing."""
        return "" if self.trust == 1 else f" The networks see {self.trust:.0%} of the ratings, the regression all."

    def apply(self, dale):
        """Sets the entries of DALE's config; one that is calibrated already is calibrated further."""
        config, levels = dale.config, dale.config.level_channels
        shift, size, departures = self.shapes
        count = dale.latent_channels - config.envelope_channels
        mean = np.array(config.latent_mean or [0.0] * count)
        std = np.array(config.latent_std or [1.0] * count)
        mean[levels:] += std[levels:] * shift
        std = std * np.concatenate([self.factor[:levels], size])
        earlier = own_calibration(config, dale.num_scalars)
        added = {"offset": self.offset, "slopes": self.slopes, "curves": self.curves}
        calibration = {name: np.array(earlier[name]) + value / self.factor for name, value in added.items()}
        calibration |= {"trust": np.array(earlier["trust"] * self.trust), "centre": self.centre}
        calibration["covariance"] = self.covariance
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
        trained = config.estimator_statistics or {name: config[name] for name in changes if name != "calibration"}
        dale.register_to_config(**changes, estimator_statistics=trained)


@dataclass(frozen=True, eq=False)
class _Fit:
    """What explains surfaces whose networks see a share of the ratings; errors (n,) of those left out, dB."""

    made: np.ndarray
    scale: np.ndarray
    offset: np.ndarray
    slopes: np.ndarray
    curves: np.ndarray
    errors: np.ndarray

    @classmethod
    def find(cls, dale, means, generated, inputs, pairs):
        """Of mean scalars (n, num_scalars), `Surfaces` of the same ratings, inputs (n, axes), products (n, pairs)."""
        made, size = scalars_of(dale, generated), means.shape[1]
        made_means = generated.mean(made)
        apart = np.square(made - made_means[generated.owners]).sum(0)
        scale = np.sqrt(apart / (len(made) - len(means))).clip(1e-3)
        differences = means - made_means
        found = np.zeros(size), np.zeros((inputs.shape[1], size)), np.zeros((pairs.shape[1], size)), 0 * differences
        for columns in groups_of(dale):
            rows = np.isfinite(differences[:, columns]).all(1)  # friction may be unknown
            if rows.any():
                parts = explain(differences[rows][:, columns], inputs[rows], pairs[rows], scale[columns])
                for whole, part in zip(found[:3], parts, strict=False):
                    whole[..., columns] = part
                found[3][np.ix_(rows, columns)] = parts[3]
        return cls(made_means, scale, *found[:3], _errors(dale, found[3]))


def _errors(dale, differences):
    """What differences of scalars (n, num_scalars) make in mean spectra, dB: (n,)."""
    return np.abs(spectra_db(dale, differences) - spectra_db(dale, 0 * differences)).mean(1)


def _most_trusted(fits):
    """The first trust of fits whose surfaces left out are not clearly (80 %, paired) worse than those of the best."""
    best = min((fit.errors for fit in fits.values()), key=np.mean)
    if len(best) < 2:  # one surface cannot tell
        return next(iter(fits))
    apart = {trust: fit.errors - best for trust, fit in fits.items()}
    reach = stats.t.ppf(0.8, len(best) - 1) / len(best) ** 0.5
    return next(trust for trust, error in apart.items() if error.mean() <= reach * error.std(ddof=1))


def recalibrate(dale, real, generated):
    """Finds what of DALE's numbers differs from a lab's: `Recalibration`.

    Args:
        dale (`DALEModel`): pretrained.
        real (`Surfaces`): the lab's, packed by `dale`.
        generated (`dict[float, Surfaces]`): `generate_trusting` from the ratings of the same surfaces.
    """
    values, count, axes = scalars_of(dale, real), len(real), real.ratings.shape[1]
    known_axes = dale.config.network_axes or axes
    centre, covariance = _rating_distribution(dale, real.ratings)
    inputs, rated = _inputs(real.ratings, centre, covariance, known_axes), ~np.isnan(real.ratings).all(0)
    inputs[:, ~rated] = 0.0  # sliders that nobody rated stay as they are
    inputs, further, rated = inputs[:, :known_axes], inputs[:, known_axes:], rated[:known_axes]
    pairs = _products(inputs) * np.outer(rated, rated)[np.triu_indices(known_axes)]
    means = real.mean(values)
    fits = {trust: _Fit.find(dale, means, made, inputs, pairs) for trust, made in generated.items()}
    trust = _most_trusted(fits)
    fit, takes = fits[trust], len(generated[trust].owners) / count
    expected = fit.made + fit.offset + inputs @ fit.slopes + pairs @ fit.curves
    left = values - expected[real.owners]
    variance = np.nanmean(real.mean(np.square(np.nan_to_num(left))), axis=0)
    ratio = np.sqrt((variance / fit.scale**2 - 1 / takes).clip(1e-6))  # without what the takes' own mean scatters
    factor = _limited(np.where(np.isfinite(values).all(0), ratio, 1.0), count / (count + SPREAD_SURFACES))
    # a wider spread must not make the pretrained mapping steeper: what it adds along the ratings is taken away
    apart = inputs - inputs.mean(0)
    steep = np.linalg.solve(apart.T @ apart + np.eye(known_axes), apart.T @ fit.made)
    offset = fit.offset + (1 - factor) * (fit.made.mean(0) - inputs.mean(0) @ steep)
    slopes = np.zeros((axes, len(offset)))
    slopes[:known_axes] = fit.slopes + (1 - factor) * steep
    slopes[known_axes:] = _further_slopes(means - expected, further, fit.scale)
    shifts = offset, slopes, fit.curves, factor
    shapes = _shapes(dale, real, generated[trust])
    return Recalibration(trust, *shifts, centre, covariance, known_axes, shapes)


def _further_slopes(left, inputs, scale):
    """Slopes (axes, num_scalars) of axes that the networks do not know: of what the others leave (n, num_scalars)."""
    slopes = np.zeros((inputs.shape[1], left.shape[1]))
    for column in range(left.shape[1] if inputs.shape[1] else 0):
        rows = np.isfinite(left[:, column])
        if rows.any():
            nothing = np.zeros((rows.sum(), 0))
            slopes[:, [column]] = explain(left[rows][:, [column]], inputs[rows], nothing, scale[[column]])[1]
    return slopes


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
    centre, covariance = RatingStatistics.from_config(dale.config).distribution(ratings.shape[1])
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


def _products(inputs):
    return products(torch.from_numpy(inputs)).numpy()
