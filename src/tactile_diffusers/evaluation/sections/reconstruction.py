"""Section "reconstruction": LCTG on held-out segments beside the baselines, at every number of steps."""

import numpy as np

from ...signal import nine_band_error_db, rms
from ..baselines import SLUGS
from ..metrics.errors import (
    SIGNED_BANDS_HZ,
    goodness_of_fit,
    level_error_db,
    log_spectral_distance_db,
    out_of_band_ratio_db,
    power_difference,
    rmse,
    signed_band_error_db,
    signed_band_key,
    snr_db,
)
from ..metrics.statistics import excess, jackknife, leaf, number
from ..report_figures import plot_overlays, plot_steps
from ..sampling import reconstruct
from .speed import decoding_seconds

#: Names of the metrics of a pair, in the order of the report.
METRICS = (
    *("nine_band_db", "lsd_db", "gfc", "rmse_n", "snr_db", "power_difference_n2", "level_error_db"),
    *("power_bias_percent", "power_difference_percent"),
    *map(signed_band_key, SIGNED_BANDS_HZ),
    "out_of_band_db",
)
#: How near the best nine-band error of the sweep a number of steps must come to do.
NEAR_BEST = 1.05


def run(context):
    """The section: `{"reconstruction": ...}`; writes steps.png and overlays.png."""
    steps, counts = {}, context.settings.steps
    shown = context.steps if context.steps in counts else counts[-1]
    for count in counts:
        steps[str(count)], textures = step_leaves(context, context.pipe, count)
        if count == shown:
            plot_overlays(context.real, textures, context.rate, context.edges, context.output / "overlays.png")
    names = (*METRICS, "ftd", "ktd", "ktd_excess", "seconds_per_segment", "efficiency_score")
    baselines = {slug: {name: number() for name in names} for slug in SLUGS}
    for slug, textures in context.baseline_textures.items():  # without ratings there are fewer than slugs
        baselines[slug] |= pair_metrics(context, textures, context.baseline_points[slug])
    result = {
        "steps": steps,
        "steps_within_5_percent": number(fewest_steps(steps), len(context.real)),
        "kilobits_per_second": bit_rate(context, context.pipe),
        "baselines": baselines,
        "different_surface": pair_metrics(context, context.different),
        "real": {**context.real_distances, "rms_n": leaf(rms(context.real), context.surfaces)},
    }
    plot_steps(result, context.output / "steps.png")
    return {"reconstruction": result}


def step_leaves(context, pipe, count):
    """Leaves of the held-out segments reconstructed by a pipeline in `count` steps, and the textures."""
    textures = reconstruct(pipe, context.real, context.rate, count, context.seed, quiet=context.quiet)
    entry = pair_metrics(context, textures)
    if context.vibromaf:
        entry |= _vibromaf(context, textures)
    seconds = decoding_seconds(context, pipe, count)
    entry["seconds_per_segment"] = leaf(seconds)
    score = None if entry["rmse_n"]["mean"] is None else entry["rmse_n"]["mean"] * np.median(seconds)
    entry["efficiency_score"] = number(score, len(textures))
    return entry, textures


def fewest_steps(steps):
    """The fewest steps whose nine-band error is within 5 % of the best of a sweep; None without errors.

    Args:
        steps (`dict[str, dict]`): steps -> leaves.
    """
    errors = {int(count): entry["nine_band_db"]["mean"] for count, entry in steps.items()}
    errors = {count: error for count, error in errors.items() if error is not None}
    return min((n for n, error in errors.items() if error <= NEAR_BEST * min(errors.values())), default=None)


def bit_rate(context, pipe):
    """Leaf of the rate of a pipeline's latents, kbit/s; level and friction, a number a segment each, left out."""
    numbers_per_second, bits = context.rate_of(pipe)
    return number(numbers_per_second * bits / 1000)


def power_percent(textures, real, surfaces):
    """How far powers are off, in percent of the mean power of the real segments.

    Returns:
        `dict[str, dict]`: leaves "power_bias_percent", |mean(P_made) - mean(P_real)| / mean(P_real), and
        "power_difference_percent", mean |P_made - P_real| / mean(P_real), which the paper's figure of section 3.2 is
        about.
    """
    difference, power = power_difference(textures, real), rms(real) ** 2
    statistics = {
        "power_bias_percent": lambda mask: 100 * abs(difference[mask].mean()) / power[mask].mean(),
        "power_difference_percent": lambda mask: 100 * np.abs(difference[mask]).mean() / power[mask].mean(),
    }
    found = {name: jackknife(statistic, surfaces) for name, statistic in statistics.items()}
    # a percentage of this kind is not below zero, nor is its interval
    return {name: number(value, len(real), np.maximum(interval, 0)) for name, (value, interval) in found.items()}


def pair_metrics(context, textures, points=None):
    """Leaves of every metric of textures against the held-out segments that they stand for, and as a set.

    Waveform metrics are left out where the unit is not newtons: the sign of such recordings need not be measured.
    """
    real, rate, surfaces = context.real, context.rate, context.surfaces
    silent = not np.any(textures)
    values = dict.fromkeys(METRICS)
    if not silent:  # in dB silence is as far away as the floor of a logarithm
        values["nine_band_db"] = nine_band_error_db(textures, real, rate, context.edges)
        values["lsd_db"] = log_spectral_distance_db(textures, real, rate, context.held_out.band)
        values["gfc"] = goodness_of_fit(textures, real, rate, context.held_out.band)
        values["level_error_db"] = level_error_db(textures, real)
        values["out_of_band_db"] = out_of_band_ratio_db(textures, rate)
        low = context.edges[0]
        bands = {band: (max(band[0], low), band[1]) for band in SIGNED_BANDS_HZ if low < band[1] <= rate / 2}
        signed = signed_band_error_db(textures, real, rate, list(bands.values()))
        values |= {signed_band_key(band): column for band, column in zip(bands, signed.T, strict=True)}
    if context.held_out.unit == "N":
        values |= {"rmse_n": rmse(textures, real), "snr_db": snr_db(textures, real)}
        values["power_difference_n2"] = np.abs(power_difference(textures, real))
    leaves = {name: number() if column is None else leaf(column, surfaces) for name, column in values.items()}
    leaves |= power_percent(textures, real, surfaces)
    points = context.reference.embed(textures) if points is None else points
    distances = context.reference.distances(points, surfaces)
    return leaves | distances | {"ktd_excess": excess(distances["ktd"], context.real_distances["ktd"])}


def _vibromaf(context, textures):
    """Leaves of vibromaf's metrics: only reconstructions are aligned, which these metrics ask for."""
    from ..vibrotactile import vibromaf_metrics

    values = vibromaf_metrics(textures, context.real, context.rate)
    return {name: leaf(column, context.surfaces) for name, column in values.items()}
