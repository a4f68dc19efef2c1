"""What textures do over time, and how differently: a part of the section "generation"."""

import numpy as np

from tactile_diffusers.evaluation.metrics.embedding import FEATURE_NAMES, tactile_features
from tactile_diffusers.evaluation.metrics.statistics import estimate, number

from ..envelopes import surface_means

#: What is compared: label -> the features whose mean it is.
MEASURES = {
    "envelope_variation": [name for name in FEATURE_NAMES if name.startswith("envelope_variation")],
    **{name: [name] for name in ("kurtosis", "crest", "skew", "slope_skew", "event_rate")},
}


def measure_variation(context):
    """`{source: {measure: leaves}}` of what is generated from ratings, of another take and of the baselines.

    Leaves: "spread", the standard deviation over textures divided by that of real ones, 1 is right; "r", the
    correlation over surfaces of their means, generated and real: whether ratings move it as surfaces do.
    """
    data, surfaces = context.data, context.requests[1]
    sources = {"model": (context.generated[context.default_guidance].textures, surfaces)}
    for slug in ("other_take", "knn_blend", "ridge"):
        if slug in context.baseline_textures:
            sources[slug] = (context.baseline_textures[slug], data.surfaces)
    real = _measures(data.real, data.rate)
    return {
        source: {
            name: {
                "spread": estimate(
                    lambda a, b, made=values[name], known=real[name]: made[a].std() / max(known[b].std(), 1e-9),
                    *(groups, data.surfaces),
                ),
                "r": surface_correlation(values[name], groups, real[name], data.surfaces, limits=(-1, 1)),
            }
            for name in MEASURES
        }
        for source, groups, values in ((s, g, _measures(t, data.rate)) for s, (t, g) in sources.items())
    }


def _measures(textures, sampling_rate):
    """Measure -> (n,)."""
    features = tactile_features(textures, sampling_rate)
    return {name: features[:, [FEATURE_NAMES.index(one) for one in of]].mean(1) for name, of in MEASURES.items()}


def surface_correlation(values, groups, real, surfaces, limits=(-np.inf, np.inf)):
    """Leaf: Pearson correlation over surfaces of the means of generated and real values; empty for fewer than four.

    `groups` (n,) and `surfaces` (m,) are the surface of each value; the interval is cut to `limits`.
    """
    both = np.stack([surface_means(values, groups), surface_means(real, surfaces)])
    if not np.isfinite(both).all() or both.shape[1] < 4 or both.std(1).min() < 1e-9:
        return number()
    return estimate(lambda mask: np.corrcoef(both[:, mask])[0, 1], np.arange(both.shape[1]), limits=limits)
