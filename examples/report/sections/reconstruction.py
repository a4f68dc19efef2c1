"""Section "reconstruction": LCTG on held-out segments beside the baselines, at every number of steps."""

import numpy as np

from tactile_diffusers.evaluation.metrics import errors
from tactile_diffusers.evaluation.metrics.errors import (
    SIGNED_BANDS_HZ,
    power_difference,
    signed_band_error_db,
    signed_band_key,
)
from tactile_diffusers.evaluation.metrics.statistics import estimate, leaf, number
from tactile_diffusers.signal import nine_band_error_db, rms

from ..baselines import SLUGS
from ..figures import plot_overlays
from ..sampling import reconstruct
from .decoders import measure_decoders
from .speed import decoding_seconds

#: Names of the metrics of a pair, in the order of the report.
METRICS = (
    *("nine_band_db", "lsd_db", "gfc", "rmse_n", "snr_db", "power_difference_n2", "level_error_db"),
    *("power_bias_percent", "power_difference_percent"),
    *map(signed_band_key, SIGNED_BANDS_HZ),
    "out_of_band_db",
)
#: A number of steps suffices if its nine-band error is at most this many times the best of the sweep.
NEAR_BEST = 1.05


def run(context):
    """The section: `{"reconstruction": ...}`; writes overlays.png."""
    steps, counts, data, known = {}, context.settings.steps, context.data, None
    shown = context.steps if context.steps in counts else counts[-1]
    for count in counts:
        steps[str(count)], textures = step_leaves(context, context.pipe, count)
        if count == context.steps:
            known = textures
        if count == shown:
            plot_overlays(
                data.real, textures, data.rate, data.edges, context.output / "overlays.png", data.dataset.unit
            )
    other = _different_surface(context)
    names = (*METRICS, "ftd", "ktd", "ktd_excess", "seconds_per_segment", "efficiency_score")
    baselines = {slug: {name: number() for name in names} for slug in SLUGS}
    for slug, textures in context.baseline_textures.items():  # without ratings there are fewer than slugs
        baselines[slug] |= pair_metrics(data, textures, context.baseline_points[slug])
    result = {
        "steps": steps,
        "steps_within_5_percent": number(fewest_steps(steps), len(data.real)),
        "kilobits_per_second": number(np.prod(context.latent_rate) / 1000),
        "baselines": baselines,
        **measure_decoders(context, lambda *made: pair_metrics(data, *made), known),
        "different_surface": pair_metrics(data, data.real[other], data.points[other], data.surfaces[other]),
        "real": {**data.distances, "rms_n": leaf(rms(data.real), data.surfaces)},
    }
    return {"reconstruction": result}


def step_leaves(context, pipe, count):
    """Leaves of the held-out segments reconstructed by a pipeline in `count` steps, and the textures."""
    data = context.data
    textures = reconstruct(pipe, data.real, data.rate, count, context.seed, quiet=context.quiet)
    entry = pair_metrics(data, textures)
    seconds = decoding_seconds(pipe, count, context.settings.repeats, channels=pipe.lctg.config.latent_channels)
    entry["seconds_per_segment"] = leaf(seconds)
    score = None if entry["rmse_n"]["mean"] is None else entry["rmse_n"]["mean"] * np.median(seconds)
    entry["efficiency_score"] = number(score, len(textures))
    return entry, textures


def fewest_steps(steps):
    """The fewest steps whose nine-band error is within 5 % of the best of a sweep (steps -> leaves); None without."""
    errors = {int(count): entry["nine_band_db"]["mean"] for count, entry in steps.items()}
    errors = {count: error for count, error in errors.items() if error is not None}
    return min((n for n, error in errors.items() if error <= NEAR_BEST * min(errors.values())), default=None)


def _different_surface(context):
    """(n,) for each held-out segment one of another surface, as a row of them."""
    data, rng, rows = context.data, context.rng("different"), np.arange(len(context.data.surfaces))
    return np.array([rng.choice(rows[data.surfaces != surface]) for surface in data.surfaces])


def power_percent(textures, real, surfaces):
    """Leaves "power_bias_percent", |mean(P - P_real)|, and "power_difference_percent", mean |P - P_real| (section 3.2).

    Both are in percent of the mean power of the real segments.
    """
    difference, power = power_difference(textures, real), rms(real) ** 2
    statistics = {
        "power_bias_percent": lambda mask: 100 * abs(difference[mask].mean()) / power[mask].mean(),
        "power_difference_percent": lambda mask: 100 * np.abs(difference[mask]).mean() / power[mask].mean(),
    }
    return {name: estimate(statistic, surfaces, limits=(0, np.inf)) for name, statistic in statistics.items()}


def pair_metrics(data, textures, points=None, owners=None):
    """Leaves of every metric of textures (n, samples), one for each held-out segment; `points` are their embeddings.

    `owners` (n,) are the surfaces that the textures are of, where these are not the segments': for distances of sets.
    Waveform metrics are left out where the unit is not newtons: the sign of such recordings need not be measured.
    """
    real, rate, surfaces, band = data.real, data.rate, data.surfaces, data.dataset.band
    values = dict.fromkeys(METRICS)
    if np.any(textures):  # in dB silence is as far away as the floor of a logarithm
        values["nine_band_db"] = nine_band_error_db(textures, real, rate, data.edges)
        values["lsd_db"] = errors.log_spectral_distance_db(textures, real, rate, band)
        values["gfc"] = errors.goodness_of_fit(textures, real, rate, band)
        values["level_error_db"] = errors.level_error_db(textures, real)
        values["out_of_band_db"] = errors.out_of_band_ratio_db(textures, rate)
        low = data.edges[0]
        bands = {edges: (max(edges[0], low), edges[1]) for edges in SIGNED_BANDS_HZ if low < edges[1] <= rate / 2}
        signed = signed_band_error_db(textures, real, rate, list(bands.values()))
        values |= {signed_band_key(edges): column for edges, column in zip(bands, signed.T, strict=True)}
    if data.dataset.unit == "N":
        values |= {"rmse_n": errors.rmse(textures, real), "snr_db": errors.snr_db(textures, real)}
        values["power_difference_n2"] = np.abs(power_difference(textures, real))
    leaves = {name: number() if column is None else leaf(column, surfaces) for name, column in values.items()}
    leaves |= power_percent(textures, real, surfaces)
    points = data.reference.embed(textures) if points is None else points
    owners = surfaces if owners is None else owners
    return leaves | data.reference.distances(points, owners, (data.points, surfaces))
