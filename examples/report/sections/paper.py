"""Section "paper": what the paper reports of its conditioning, by its protocol (sections 3.3 and 3.4)."""

from itertools import pairwise

import numpy as np

from tactile_diffusers.evaluation.metrics.rating_effects import latent_shift_percent
from tactile_diffusers.evaluation.metrics.statistics import leaf
from tactile_diffusers.signal import band_levels_db

from ..figures import plot_axis_spectra, plot_latent_shift

#: Ratings run from -2 to 2 (paper section 3.3 and 3.4).
FARTHEST = 2.0
#: Step of ratings and takes of each in the latent shift (section 3.3); those of the spectra are settings.
SHIFT_STEP, SHIFT_TAKES = 0.2, 30


def run(context):
    """The section: `{"paper": ...}`; writes latent_shift.png and spectra.png."""
    shift, spectra = _latent_shift(context), _spectra(context)
    plot_latent_shift(shift, context.output / "latent_shift.png")
    plot_axis_spectra({"generated": spectra}, context.output / "spectra.png")
    return {"paper": {"latent_shift_percent": shift, "spectra_db": spectra}}


def _sweep(step):
    """Ratings from -2 to 2."""
    return np.linspace(-FARTHEST, FARTHEST, round(2 * FARTHEST / step) + 1).round(2).tolist()


def _latent_shift(context):
    """Shift of the latent from that of the ratings 0, 0, 0, the noise fixed: axis -> value -> leaf, % (section 3.3)."""
    values, takes = _sweep(SHIFT_STEP), SHIFT_TAKES
    seeds = context.seeds(4, takes)

    def latents(ratings):
        return context.generate(np.tile(ratings, (takes, 1)), seeds, context.default_guidance, decode=False).latents

    steps = np.eye(len(context.axes))
    baseline = latents(0 * steps[0])
    return {
        axis: {str(x): leaf(latent_shift_percent(latents(x * steps[column]), baseline)) for x in values}
        for column, axis in enumerate(context.axes)
    }


def _spectra(context):
    """Mean nine-band levels while one rating runs, the others normal: axis -> value -> band -> leaf (section 3.4)."""
    values, takes = _sweep(context.settings.paper_step), context.settings.paper_takes
    seeds, edges = context.seeds(5, takes), context.data.edges
    names = [f"{low:.0f}-{high:.0f} Hz" for low, high in pairwise(edges)]
    others = context.rng("spectra").standard_normal((takes, len(context.axes)))
    levels = {axis: {} for axis in context.axes}
    for column, axis in enumerate(context.axes):
        for value in values:
            ratings = others.copy()
            ratings[:, column] = value
            textures = context.generate(ratings, seeds, context.default_guidance).textures
            bands = band_levels_db(textures, context.data.rate, edges)
            levels[axis][str(value)] = {name: leaf(band) for name, band in zip(names, bands.T, strict=True)}
    return levels
