"""Section "paper": what the paper reports of its conditioning, by its protocol (sections 3.3 and 3.4)."""

import numpy as np

from ...signal import RATING_AXES, band_levels_db, power_spectral_density
from ..metrics.rating_effects import latent_shift_percent
from ..metrics.statistics import leaf
from ..report_figures import plot_latent_shift, plot_spectra

#: Ratings run from -2 to 2 (paper section 3.3 and 3.4).
FARTHEST = 2.0


def run(context):
    """The section: `{"paper": ...}`; writes latent_shift.png and spectra.png."""
    shift = _latent_shift(context)
    spectra, densities, frequencies = _spectra(context)
    plot_latent_shift(shift, context.output / "latent_shift.png")
    plot_spectra(densities, frequencies, context.output / "spectra.png")
    return {"paper": {"latent_shift_percent": shift, "spectra_db": spectra}}


def sweep(step):
    """Values from -2 to 2."""
    count = round(2 * FARTHEST / step) + 1
    return [round(float(value), 6) for value in np.linspace(-FARTHEST, FARTHEST, count)]


def _latent_shift(context):
    """Shift of the latent from that of the ratings 0, 0, 0, the noise fixed: axis -> value -> leaf, % (section 3.3)."""
    takes, guidance = context.settings.shift_takes, context.default_guidance
    seeds = context.seeds(4, takes)

    def latents(ratings):
        return context.generate(np.tile(ratings, (takes, 1)), seeds, guidance, decode=False).latents

    baseline = latents(np.zeros(3))
    return {
        axis: {
            str(value): leaf(latent_shift_percent(latents(value * np.eye(3)[column]), baseline))
            for value in sweep(context.settings.shift_step)
        }
        for column, axis in enumerate(RATING_AXES)
    }


def _spectra(context):
    """Nine-band levels, mean densities and frequencies while one rating runs, the others normal (section 3.4)."""
    takes, guidance = context.settings.spectra_takes, context.default_guidance
    seeds, edges = context.seeds(5, takes), context.data.edges
    names = [f"{low:.0f}-{high:.0f} Hz" for low, high in zip(edges[:-1], edges[1:], strict=True)]
    others = context.rng("spectra").standard_normal((takes, 3))
    levels, densities = {}, {}
    for column, axis in enumerate(RATING_AXES):
        levels[axis], densities[axis] = {}, {}
        for value in sweep(context.settings.spectra_step):
            ratings = others.copy()
            ratings[:, column] = value
            textures = context.generate(ratings, seeds, guidance).textures
            bands = band_levels_db(textures, context.data.rate, edges)
            levels[axis][str(value)] = {name: leaf(band) for name, band in zip(names, bands.T, strict=True)}
            frequencies, density = power_spectral_density(textures, context.data.rate)
            densities[axis][value] = (10 * np.log10(density + 1e-20)).mean(0)
    return levels, densities, frequencies
