"""What the pipeline of an ablation row does on held-out surfaces: reconstruction, rate and distortion, generation."""

import sys
from pathlib import Path

import numpy as np
import torch

from tactile_diffusers.data.dataset import check_fit
from tactile_diffusers.evaluation.metrics.errors import SIGNED_BANDS_HZ, signed_band_key, snr_db
from tactile_diffusers.signal import nine_band_error_db, resample

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.baselines import BaselineRequest, Decimated, latent_rate
from report.envelopes import Grid
from report.held_out import open_held_out
from report.sampling import noise_seeds, reconstruct
from report.sections import Context, Settings
from report.sections.context import HALF_PRECISION
from report.sections.generation import matching_rows, unseen_metrics
from report.sections.reconstruction import pair_metrics
from report.sections.speed import decoding_seconds

#: Steps at which reconstructions are measured; the last also decodes the noisy latents.
STEPS = (5, 10)
#: How much is measured of a row: minutes, not half an hour.
SETTINGS = Settings(steps=STEPS, per_surface=4, takes=4, repeats=3)
#: Standard deviations of the noise on the latents, in their unit: the points of the rate-distortion curve.
SIGMAS = (0.05, 0.1, 0.2, 0.4, 0.8)
#: Segments that the rate-distortion curve is measured on.
RATE_SEGMENTS = 60
_BATCH = 32


class Bench:
    """The held-out surfaces of a data set, on which every row is measured alike.

    Args:
        data (`Path`): a prepared data set.
        split (`str`): held-out surfaces.
        quiet (`bool`): no progress bars.
    """

    def __init__(self, data, split, quiet=True):
        self.data, self.split, self.quiet = data, split, quiet
        self._data = None

    def context(self, pipe):
        """A `Context` of a pipeline; the data are shared by all rows.

        Raises:
            ValueError: if pipeline and data do not fit together, or the split has nothing to measure.
        """
        if self._data is None:
            self._data = open_held_out(self.data, self.split, SETTINGS.per_surface)
        check_fit(pipe, self._data.dataset)
        return Context(pipe, self._data, SETTINGS, 0, None, [1.0], self.quiet)

    def measure(self, folder, generates):
        """Everything about one pipeline, as JSON.

        Args:
            folder (`Path`): the pipeline.
            generates (`bool`): whether textures from ratings are measured too.

        Returns:
            `dict`: see `reconstruction`, `rate_distortion` and `generation`.
        """
        from tactile_diffusers import TactileTexturePipeline

        pipe = TactileTexturePipeline.from_pretrained(str(folder))
        pipe.set_progress_bar_config(disable=True)
        context = self.context(pipe)
        result = reconstruction(context) | rate_distortion(context)
        return result | (generation(context) if generates else {})


def reconstruction(context):
    """Reconstructions of the held-out segments.

    Returns:
        `dict`: "parameters"; "steps", for each number of steps "nine_band_db", "snr_db", "ktd_excess", "ftd_excess"
        (over real), "power_difference_percent" (of the mean power, without its sign), "signed_db" by band and
        "seconds" (of decoding one segment). What cannot be measured is None.
    """
    steps = {}
    for count in STEPS:
        textures = reconstruct(
            context.pipe, context.data.real, context.data.rate, count, context.seed, quiet=context.quiet
        )
        leaves = pair_metrics(context.data, textures)
        shown = ("nine_band_db", "snr_db", "power_difference_percent")
        steps[str(count)] = {
            **{name: leaves[name]["mean"] for name in shown},
            **{name: leaves[name]["mean"] for name in ("ktd_excess", "ftd_excess")},
            "signed_db": {signed_band_key(band): leaves[signed_band_key(band)]["mean"] for band in SIGNED_BANDS_HZ},
            "seconds": float(np.median(decoding_seconds(context.pipe, count, context.settings.repeats))),
        }
    return {"parameters": context.pipe.lctg.num_parameters(), "steps": steps}


def rate_distortion(context):
    """Reconstructions from latents that carry noise, beside the low-passed texture at equal bits.

    A channel that carries Gaussian noise transmits 1/2 log2(1 + var / sigma^2) bits a number at most; the level of a
    texture counts as known on both sides.

    Returns:
        `dict`: "rate_kbit_s" of the latents at the noise they were trained with, and "rate_distortion", a list of
        points: "sigma", "base_only" (whether the detail layer was set to zero), "rate_kbit_s", "nine_band_db",
        "snr_db", "ktd_excess" and, at equal bits, the same of "decimated".
    """
    config = context.pipe.lctg.config
    rows = np.unique(np.linspace(0, len(context.data.real) - 1, min(RATE_SEGMENTS, len(context.data.real))).astype(int))
    curve = _Curve(context, rows)
    sigma = config.latent_noise or HALF_PRECISION
    points = [curve.point(sigma) for sigma in SIGMAS]
    if config.detail_channels:
        points.append(curve.point(config.latent_noise or SIGMAS[0], context.pipe.lctg.base_channels))
    return {"rate_kbit_s": curve.bits(curve.latents, sigma)[1] / 1000, "rate_distortion": points}


class _Curve:
    """The segments and latents of one rate-distortion curve."""

    def __init__(self, context, rows):
        self.context, self.surfaces = context, context.data.surfaces[rows]
        self.real = context.data.real[rows]
        made = context.pipe.encode(self.real, context.data.rate)
        self.latents, self.level = made.latents, made.level
        self.real_points = context.data.reference.embed(self.real)

    def point(self, sigma, channels=None):
        """Rate and quality at a noise of standard deviation `sigma`; channels from `channels` on are set to zero."""
        latents = self.latents.clone()
        latents[:, channels if channels is not None else latents.shape[1] :] = 0
        numbers, bits = self.bits(latents, sigma)
        rng = self.context.rng(f"latent noise {sigma}")
        noise = torch.from_numpy(rng.standard_normal(latents.shape).astype(np.float32))
        carried = latents.std((0, 2), keepdim=True) > 0  # zero means "not given": it stays zero
        textures = self._decode(torch.where(carried, latents + sigma * noise.to(latents), latents))
        band = Grid(self.real.shape[-1], self.context.data.rate, tuple(self.context.data.dataset.band))
        numbers = min(numbers, 2 * (band.end - band.band[0]))  # a texture has no more
        decimated = Decimated(numbers, bits / numbers).fit(self.context.data.training)
        request = BaselineRequest(np.zeros((len(self.real), 3)), self.real)
        return {
            "sigma": sigma,
            "base_only": channels is not None,
            "rate_kbit_s": bits / 1000,
            **self._quality(textures),
            "decimated": self._quality(decimated.sample(request, self.context.rng("decimated"))),
        }

    def bits(self, latents, sigma):
        """Numbers and bits per second; channels that are constant count as neither."""
        latents = latents.float().cpu().numpy()
        latents = latents[:, latents.std((0, 2)) > 0]
        extractor, hop = self.context.pipe.feature_extractor, self.context.pipe.lctg.config.latent_hop
        numbers = latents.shape[1] * extractor.sampling_rate / hop
        return numbers, numbers * latent_rate(latents, sigma)

    def _decode(self, latents):
        seeds, made = noise_seeds(self.context.seed, len(latents)), []
        for start in range(0, len(latents), _BATCH):
            rows = slice(start, start + _BATCH)
            generators = [torch.Generator("cpu").manual_seed(int(seed)) for seed in seeds[rows]]
            out = self.context.pipe.decode(latents[rows], self.level[rows], None, STEPS[-1], generators)
            made.append(resample(out.textures, out.sampling_rate, self.context.data.rate)[:, : self.real.shape[-1]])
        return np.concatenate(made)

    def _quality(self, textures):
        data = self.context.data
        return {
            "nine_band_db": float(nine_band_error_db(textures, self.real, data.rate, data.edges).mean()),
            "snr_db": float(snr_db(textures, self.real).mean()) if data.dataset.unit == "N" else None,
            "ktd_excess": self._ktd_excess(textures),
        }

    def _ktd_excess(self, textures):
        reference, real = self.context.data.reference, (self.real_points, self.surfaces)
        return reference.distances(reference.embed(textures), self.surfaces, real)["ktd_excess"]["mean"]


def generation(context):
    """Textures from the ratings of the held-out surfaces, without guidance, at the pipeline's own number of steps.

    Returns:
        `dict`: "generation" with "ktd_excess" and "ftd_excess" over real of as many textures as there are real ones,
        "nine_band_db", the error of a surface's mean band levels, in the mean over surfaces, and "level_r", the
        correlation of a surface's mean level with that of its recordings.
    """
    made, rows, surfaces = context.generated[1.0], matching_rows(context), context.requests[1]
    reference, real = context.data.reference, (context.data.points, context.data.surfaces)
    distances = reference.distances(reference.embed(made.textures[rows]), surfaces[rows], real)
    unseen = unseen_metrics(context.data, made.textures, surfaces, made.levels)
    found = {name: unseen[name]["mean"] for name in ("nine_band_db", "level_r")}
    over_real = {name: distances[name]["mean"] for name in ("ktd_excess", "ftd_excess")}
    return {"generation": {**over_real, **found}}
