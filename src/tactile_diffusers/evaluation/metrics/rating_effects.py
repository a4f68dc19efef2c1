"""What ratings do to textures: measures of one condition, and how conditions differ."""

import numpy as np

from ...signal import band_levels_db, rms
from .errors import DB_PER_NEPER


def texture_measures(textures, levels, friction_coefficients, sampling_rate, edges):
    """What a rating is expected to move, of textures (n, samples), N, with levels (n,), natural log of the RMS in N.

    Friction coefficients (n,) may be NaN; `edges` are of the nine bands, Hz. Returns "level_db" (n,) dB re 1 N;
    "shape_db" (n, 9) band levels at unit RMS; "log_friction" (n,).
    """
    textures = np.asarray(textures, dtype=np.float64)
    unit = textures / np.maximum(rms(textures), 1e-12)[:, None]
    return {
        "level_db": DB_PER_NEPER * np.asarray(levels, dtype=np.float64),
        "shape_db": band_levels_db(unit, sampling_rate, edges),
        "log_friction": np.log(np.asarray(friction_coefficients, dtype=np.float64)),
    }


def shape_change_db(mean, baseline):
    """Mean absolute change over bands of two mean shapes (..., 9), dB: what remains when gain is taken out."""
    return np.abs(np.asarray(mean) - np.asarray(baseline)).mean(-1)


def latent_shift_percent(latents, baseline):
    """The paper's latent shift (section 3.3): distance to the baseline of the same noise over its norm, %: (n,)."""
    difference = np.sqrt(np.square(latents - baseline).sum((1, 2)))
    return 100 * difference / np.maximum(np.sqrt(np.square(baseline).sum((1, 2))), 1e-12)


def reversal(values, responses, edge=2.0):
    """How far a response turns back outside of training, as a share of its change within: 0 if it goes on or is held.

    `responses` (n,) are means of a measure at `values` (n,), ascending, with -`edge` and `edge` among them, within
    which nearly all surfaces of training lie. The largest fall outwards on either side, against the direction in which
    the measure goes within ±edge.
    """
    values, responses = np.asarray(values), np.asarray(responses, dtype=np.float64)
    high, low = responses[values >= edge], responses[values <= -edge][::-1]
    change = high[0] - low[0]
    falls = [np.max(np.maximum.accumulate(side) - side) for side in (high * np.sign(change), -low * np.sign(change))]
    return float(max(falls) / max(abs(change), np.finfo(np.float64).tiny))
