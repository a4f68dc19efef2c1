"""Section "reconstruction": LCTG on held-out segments beside the baselines, at every number of steps."""

import numpy as np

from ...signal import nine_band_error_db, rms
from ..baselines import SLUGS
from ..figures import plot_overlays, plot_steps
from ..generate import reconstruct
from ..reconstruction import (
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
from ..statistics import leaf, number
from .speed import decoding_seconds

#: Names of the metrics of a pair, in the order of the report.
METRICS = (
    *("nine_band_db", "lsd_db", "gfc", "rmse_n", "snr_db", "power_difference_n2", "level_error_db"),
    *map(signed_band_key, SIGNED_BANDS_HZ),
    "out_of_band_db",
)


def run(context):
    """The section: `{"reconstruction": ...}`; writes steps.png and overlays.png."""
    steps, counts = {}, context.settings.steps
    shown = context.steps if context.steps in counts else counts[-1]
    for count in counts:
        textures = reconstruct(context.pipe, context.real, context.rate, count, context.seed, quiet=context.quiet)
        entry = pair_metrics(context, textures)
        if context.vibromaf:
            entry |= _vibromaf(context, textures)
        seconds = decoding_seconds(context, count)
        entry["seconds_per_segment"] = leaf(seconds)
        score = None if entry["rmse_n"]["mean"] is None else entry["rmse_n"]["mean"] * np.median(seconds)
        entry["efficiency_score"] = number(score, len(textures))
        steps[str(count)] = entry
        if count == shown:
            plot_overlays(context.real, textures, context.rate, context.edges, context.output / "overlays.png")
    names = (*METRICS, "ftd", "ktd", "seconds_per_segment", "efficiency_score")
    baselines = {slug: {name: number() for name in names} for slug in SLUGS}
    for slug, textures in context.baseline_textures.items():  # without ratings there are fewer than slugs
        baselines[slug] |= pair_metrics(context, textures, context.baseline_points[slug])
    result = {
        "steps": steps,
        "baselines": baselines,
        "different_surface": pair_metrics(context, context.different),
        "real": {**context.real_distances, "rms_n": leaf(rms(context.real), context.surfaces)},
    }
    plot_steps(result, context.output / "steps.png")
    return {"reconstruction": result}


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
    points = context.reference.embed(textures) if points is None else points
    return leaves | context.reference.distances(points, surfaces)


def _vibromaf(context, textures):
    """Leaves of vibromaf's metrics: only reconstructions are aligned, which these metrics ask for."""
    from ..vibrotactile import vibromaf_metrics

    values = vibromaf_metrics(textures, context.real, context.rate)
    return {name: leaf(column, context.surfaces) for name, column in values.items()}
