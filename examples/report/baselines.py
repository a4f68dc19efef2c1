"""Baselines that every model is compared with: silence, noise, a neighbour, or a few numbers.

Each is fitted on textures of the training surfaces and makes one texture for each row of a request. `knows` says what
it uses: "nothing", the "ratings", or the "recording" itself (so it competes with a decoder). Results depend only on the
generator.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import fft
from sklearn.utils import check_consistent_length

from tactile_diffusers.evaluation.metrics.distances import covariance_root
from tactile_diffusers.evaluation.metrics.texture_checks import check_textures
from tactile_diffusers.signal import BAND_HZ, rms
from tactile_diffusers.signal.checks import check_number

from . import envelopes

#: Ratings closer than this count as equally close: the mean over raters is not more precise.
_LEAST_DISTANCE = 0.1


@dataclass(frozen=True)
class TrainingTextures:
    """What baselines are fitted on: segments of the training surfaces."""

    textures: np.ndarray  # (m, samples) N
    ratings: np.ndarray  # (m, axes) z-scores of each segment's surface, NaN = not rated
    friction_coefficients: np.ndarray  # (m,), NaN = unknown
    surface_ids: np.ndarray  # (m,)
    sampling_rate: float  # Hz, a whole number
    band: tuple[float, float] = BAND_HZ  # Hz, to which the textures were filtered

    def keep(self, rows):
        """The segments of a mask or of indices."""
        names = ("textures", "ratings", "friction_coefficients", "surface_ids")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


@dataclass(frozen=True)
class BaselineRequest:
    """What is requested: one texture a row."""

    ratings: np.ndarray  # (n, axes) z-scores, NaN = not specified
    textures: np.ndarray | None = None  # (n, samples) N: the recording to describe
    other_takes: np.ndarray | None = None  # (n, samples) N: another segment of the same surface


class Baseline:
    """Base class, which checks the input. Subclasses write `_sample`, and `_fit` where there is something to fit."""

    slug = ""
    knows = "nothing"
    grid = None

    def fit(self, training):
        """Learns from `training` (`TrainingTextures`) and returns itself.

        A ValueError if an array has the wrong shape or bad numbers, the textures are too short for the band, or no
        surface is rated on every axis where the baseline works from ratings.
        """
        training = _checked_training(training)
        self.grid = envelopes.Grid(training.textures.shape[-1], training.sampling_rate, tuple(training.band))
        envelopes.nine_band_levels_db(training.textures[:1], self.grid)  # raises if they are too short
        self._fit(training)
        return self

    def sample(self, request, rng):
        """One texture for each row of `request`: (n, samples) float64, N, of the training textures' rate and length.

        A ValueError if the baseline is not fitted, or the request lacks recordings that it needs or has bad numbers.
        """
        return self._sample(self._checked_request(request), rng)

    def _fit(self, training):
        pass

    def _sample(self, request, rng):
        raise NotImplementedError

    def _checked_request(self, request):
        if self.grid is None:
            raise ValueError(f"The baseline {self.slug!r} is not fitted. Call `fit(training)` first.")
        return replace(request, ratings=_checked_ratings("request.ratings", request.ratings))

    def _recordings(self, request, name="textures"):
        recordings = getattr(request, name)
        if recordings is None:
            raise ValueError(f"The baseline {self.slug!r} needs `request.{name}`, got None. Pass the recordings.")
        recordings = check_textures(f"request.{name}", recordings, rank=2).astype(np.float64)
        shape = (len(request.ratings), self.grid.samples)
        if recordings.shape != shape:
            raise ValueError(
                f"`request.{name}` must have the shape {shape}, one row for each of `request.ratings` and as long as "
                f"the training textures, got {recordings.shape}."
            )
        return recordings


class Silence(Baseline):
    """Silence: 0 dB SNR, better than any texture that feels right but is another waveform."""

    slug = "silence"

    def _sample(self, request, rng):
        return np.zeros((len(request.ratings), self.grid.samples))


class OtherTake(Baseline):
    """A real recording of the same surface from another moment: feels the same, differs sample by sample."""

    slug, knows = "other_take", "recording"

    def _sample(self, request, rng):
        return self._recordings(request, "other_takes")


class PhaseRandomised(Baseline):
    """The recording's own amplitude spectrum with random phases, up to 1.05 times the band."""

    slug, knows = "phase_randomised", "recording"

    def _sample(self, request, rng):
        spectra = fft.rfft(self._recordings(request), axis=-1)
        frequencies = fft.rfftfreq(self.grid.samples, 1 / self.grid.sampling_rate)
        spectra[:, frequencies > self.grid.end] = 0
        turned = spectra * np.exp(2j * np.pi * rng.random(spectra.shape))
        turned[:, 0] = spectra[:, 0]  # the mean is real and has no phase
        return fft.irfft(turned, n=self.grid.samples, axis=-1)


class MeanSpectrum(Baseline):
    """Gaussian noise with the mean spectrum of the training textures, averaged in dB."""

    slug = "mean_spectrum"

    def _fit(self, training):
        points, decibels = envelopes.spectrum_db(training.textures, self.grid)
        self._density = self.grid.interpolate_db(points, decibels.mean(0, keepdims=True))

    def _sample(self, request, rng):
        return self.grid.noise(np.repeat(self._density, len(request.ratings), 0), rng)


class EnvelopeNoise(Baseline):
    """Gaussian noise under a density fitted to the recording: (textures (n, samples), grid) -> power spectra (n, bins).

    `scaled`: whether the noise has the recording's RMS, or that of the density.
    """

    knows = "recording"

    def __init__(self, slug, density, scaled=True):
        self.slug, self._density, self._scaled = slug, density, scaled

    def _sample(self, request, rng):
        textures = self._recordings(request)
        return self.grid.noise(self._density(textures, self.grid), rng, rms(textures) if self._scaled else None)


class Decimated(Baseline):
    """The recording low-passed and quantised to as many bits a second as a latent carries.

    It keeps the lowest `numbers_per_second` coefficients of the cosine transform from the band's lower edge up,
    whitened by the mean spectrum of training, with Gaussian noise through which each carries `bits_per_number`, `1/2
    log2(1 + s)` at a signal-to-noise ratio s (infinity = no noise). The texture's level counts as known.
    """

    slug, knows = "decimated", "recording"

    def __init__(self, numbers_per_second, bits_per_number):
        self.numbers_per_second = check_number("numbers_per_second", numbers_per_second, above=0)
        if not bits_per_number > 0:
            raise ValueError(f"`bits_per_number` must be above 0, got {bits_per_number}.")
        self.bits_per_number = bits_per_number

    def _fit(self, training):
        samples, rate = self.grid.samples, self.grid.sampling_rate
        frequencies = np.arange(samples) * rate / (2 * samples)
        first, end = np.searchsorted(frequencies, (self.grid.band[0], self.grid.end))
        self._kept = slice(first, first + max(1, round(min(end - first, self.numbers_per_second * samples / rate))))
        points, decibels = envelopes.spectrum_db(training.textures, self.grid)
        self._colour = 10 ** (envelopes.interpolate_db(points, decibels.mean(0), frequencies[self._kept]) / 20)

    def _sample(self, request, rng):
        coefficients = fft.dct(self._recordings(request), norm="ortho", axis=-1)
        white = coefficients[:, self._kept] / self._colour
        ratio = 4.0**self.bits_per_number - 1
        white = white + rng.standard_normal(white.shape) * (rms(white) / np.sqrt(ratio))[:, None]
        kept = np.zeros_like(coefficients)
        kept[:, self._kept] = white * self._colour
        return fft.idct(kept, norm="ortho", axis=-1)


def latent_rate(latents, sigma):
    """Bits that each number of latents (n, channels, frames) carries through Gaussian noise of standard deviation
    `sigma`.

    The mean over channels of 1/2 log2(1 + var/sigma²): an upper bound where numbers are correlated.
    """
    latents = check_textures("latents", latents, rank=3).astype(np.float64)
    sigma = check_number("sigma", sigma, above=0)
    return float(np.mean(0.5 * np.log2(1 + latents.var(axis=(0, 2)) / sigma**2)))


class KnnBlend(Baseline):
    """Blend of the training surfaces whose ratings are nearest, after Hassan, Abdulali and Jeon (2019,
    10.1109/TIE.2019.2914572).

    Their spectra, level included, are averaged in dB with weights of one over the distance in the specified axes. Where
    no axis is specified, `neighbours` surfaces are drawn at random for each texture and weigh the same.
    """

    slug, knows = "knn_blend", "ratings"

    def __init__(self, neighbours=5):
        self.neighbours = int(check_number("neighbours", neighbours, above=0))

    def _fit(self, training):
        training = _rated(training)
        self._points, decibels = envelopes.spectrum_db(training.textures, self.grid)
        columns = (training.ratings, decibels, np.log(training.friction_coefficients))
        means = (envelopes.surface_means(column, training.surface_ids) for column in columns)
        self._ratings, self._decibels, self._log_friction = means

    def _sample(self, request, rng):
        decibels = self._weights(request.ratings, rng) @ self._decibels
        return self.grid.noise(self.grid.interpolate_db(self._points, decibels), rng)

    def friction_coefficients(self, request, rng):
        """Friction coefficients of the same surfaces, blended in log: (n,); NaN where none is known."""
        weights = self._weights(self._checked_request(request).ratings, rng)
        known = np.isfinite(self._log_friction)
        total = weights @ known
        return np.exp(weights @ np.where(known, self._log_friction, 0) / np.where(total > 0, total, np.nan))

    def _weights(self, ratings, rng):
        """Weight of each training surface in each row: (n, surfaces), rows add up to 1."""
        difference = np.nan_to_num(ratings[:, None] - self._ratings)  # an axis that is not specified adds nothing
        distance = np.maximum(np.sqrt((difference**2).sum(-1)), _LEAST_DISTANCE)
        # ties in random order, which is the draw where nothing is specified
        order = np.lexsort((rng.random(distance.shape), distance), axis=-1)[:, : self.neighbours]
        weights = np.zeros_like(distance)
        np.put_along_axis(weights, order, 1 / np.take_along_axis(distance, order, -1), -1)
        return weights / weights.sum(-1, keepdims=True)


class Ridge(Baseline):
    """Ridge regression from ratings to the nine band levels and the log friction coefficient, then noise.

    Fitted over surfaces, with a `penalty` in surfaces whose ratings lie one z-score from the mean. The scatter of
    segments is added as one draw from the Gaussian with its covariance; ratings that are not specified are drawn from
    the training surfaces' Gaussian given the others.
    """

    slug, knows = "ridge", "ratings"

    def __init__(self, penalty=1.0):
        self.penalty = check_number("penalty", penalty, above=0)

    def _fit(self, training):
        training = _rated(training)
        ids, levels = training.surface_ids, envelopes.nine_band_levels_db(training.textures, self.grid)
        targets = np.column_stack([levels, np.log(training.friction_coefficients)])
        means, ratings = (envelopes.surface_means(column, ids) for column in (targets, training.ratings))
        self._gaussian = ratings.mean(0), np.cov(ratings, rowvar=False, bias=True)
        self._fits = [envelopes.ridge_fit(ratings, target, self.penalty) for target in means.T]
        scatter = np.nan_to_num(targets - means[np.unique(ids, return_inverse=True)[1]])
        freedom = max(1, len(targets) - len(means))
        self._scatter_root = covariance_root(scatter.T @ scatter / freedom)

    def _sample(self, request, rng):
        levels = self._targets(request.ratings, rng)[:, :9]
        return self.grid.noise(envelopes.nine_band_density(levels, self.grid), rng)

    def friction_coefficients(self, request, rng):
        """Friction coefficients: (n,); NaN if no training surface's is known."""
        return np.exp(self._targets(self._checked_request(request).ratings, rng)[:, 9])

    def _targets(self, ratings, rng):
        """Band levels in dB re 1 N^2 and log friction, one draw a row: (n, 10)."""
        ratings = envelopes.draw_missing(ratings, *self._gaussian, rng.standard_normal(ratings.shape))
        targets = np.stack([predict(ratings) for predict in self._fits], -1)
        return targets + rng.standard_normal(targets.shape) @ self._scatter_root


def default_baselines(numbers_per_second, bits_per_number):
    """One of each, not fitted, in the order of every table: slug -> baseline. The numbers are those of `Decimated`."""
    baselines = (
        *(Silence(), OtherTake(), PhaseRandomised(), MeanSpectrum()),
        EnvelopeNoise("lpc20", envelopes.lpc_density),
        EnvelopeNoise(
            "nine_band_noise",
            lambda rows, grid: envelopes.nine_band_density(envelopes.nine_band_levels_db(rows, grid), grid),
            scaled=False,
        ),
        *(Decimated(numbers_per_second, bits_per_number), KnnBlend(), Ridge()),
    )
    return {baseline.slug: baseline for baseline in baselines}


#: Names of all baselines by slug, in the order of every table.
NAMES = {
    "silence": "silence",
    "other_take": "another take of the surface",
    "phase_randomised": "phase-randomised copy",
    "mean_spectrum": "noise of the mean spectrum",
    "lpc20": "autoregressive model (LPC 20)",
    "nine_band_noise": "nine-band noise",
    "decimated": "low-passed to the latent's bits",
    "knn_blend": "blend of 5 nearest surfaces (from ratings)",
    "ridge": "ridge regression and noise (from ratings)",
}
SLUGS = tuple(NAMES)


def _rated(training):
    """The segments of surfaces that are rated on every axis."""
    rated = np.isfinite(training.ratings).all(-1)
    if not rated.any():
        raise ValueError(
            "`training.ratings` must hold a surface that is rated on every axis, got none: leave out the baselines "
            "that know ratings (knn_blend, ridge), or give ratings."
        )
    return training.keep(rated)


def _checked_training(training):
    textures = check_textures("training.textures", training.textures, rank=2)
    ratings = _checked_ratings("training.ratings", training.ratings)
    friction, ids = np.asarray(training.friction_coefficients, dtype=np.float64), np.asarray(training.surface_ids)
    check_consistent_length(textures, ratings, friction, ids)
    if not (np.isnan(friction) | ((friction > 0) & np.isfinite(friction))).all():
        raise ValueError("`training.friction_coefficients` must be above 0, or NaN where they are unknown.")
    return replace(training, textures=textures, ratings=ratings, friction_coefficients=friction, surface_ids=ids)


def _checked_ratings(name, ratings):
    ratings = np.asarray(ratings, dtype=np.float64)
    if ratings.ndim != 2 or ratings.shape[-1] < 1 or not len(ratings) or np.isinf(ratings).any():
        raise ValueError(f"`{name}` must have the shape (n, axes), z-scores or NaN (unknown), got {ratings.shape}.")
    return ratings
