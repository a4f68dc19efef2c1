"""What ratings do to textures: measures of one condition, and how conditions differ."""

import numpy as np

from ...signal import band_levels_db, rms
from .errors import DB_PER_NEPER


def texture_measures(textures, levels, friction_coefficients, sampling_rate, edges, latents=None):
    """What a rating is expected to move, one row a texture.

    Args:
        textures (`np.ndarray`): (n, samples), N.
        levels (`np.ndarray`): (n,) natural log of the RMS in N.
        friction_coefficients (`np.ndarray`): (n,), NaN = unknown.
        sampling_rate (`float`): Hz.
        edges (`np.ndarray`): of the nine bands, Hz.
        latents (`np.ndarray`, *optional*): (n, features), `latent_summary` of the encoded textures.

    Returns:
        `dict[str, np.ndarray]`: "level_db" (n,) dB re 1 N; "shape_db" (n, 9) band levels at unit RMS; "log_friction"
        (n,); with latents also "latent" (n, features + 1 or 2): all that DALE generates.
    """
    textures = np.asarray(textures, dtype=np.float64)
    unit = textures / np.maximum(rms(textures), 1e-12)[:, None]
    levels, log_friction = (np.asarray(values, dtype=np.float64) for values in (levels, np.log(friction_coefficients)))
    measures = {
        "level_db": DB_PER_NEPER * levels,
        "shape_db": band_levels_db(unit, sampling_rate, edges),
        "log_friction": log_friction,
    }
    if latents is not None:
        scalars = [values[:, None] for values in (levels, log_friction) if np.isfinite(values).all()]
        measures["latent"] = np.concatenate([latents, *scalars], axis=-1)
    return measures


def shape_change_db(mean, baseline):
    """Mean absolute change over bands of two mean shapes (..., 9), dB: what remains when gain is taken out."""
    return np.abs(np.asarray(mean) - np.asarray(baseline)).mean(-1)


def latent_shift_percent(latents, baseline):
    """The paper's latent shift (section 3.3): distance to the baseline of the same noise over its norm, %: (n,)."""
    difference = np.sqrt(np.square(latents - baseline).sum((1, 2)))
    return 100 * difference / np.maximum(np.sqrt(np.square(baseline).sum((1, 2))), 1e-12)


def d_prime(mean, spread, size, baseline_mean, baseline_spread, baseline_size):
    """Shift of a condition in units of the spread within conditions: the norm over features.

    What chance alone adds to its square, `1/size + 1/baseline_size` for each feature, is taken out.

    Args:
        mean, spread (`np.ndarray`): (features,) of the condition.
        size (`float`): (effective) number of independent textures.
        baseline_mean, baseline_spread, baseline_size: of the baseline.

    Returns:
        `float`: 0 where the conditions do not differ by more than chance.
    """
    variance = (np.square(spread) + np.square(baseline_spread)) / 2
    squares = np.square(mean - baseline_mean) / np.maximum(variance, 1e-12)
    return float(np.sqrt(max(0.0, squares.sum() - len(squares) * (1 / size + 1 / baseline_size))))


def reversal(values, responses, edge=2.0):
    """How far a response turns back outside of training, as a share of its change within: 0 if it goes on or is held.

    Args:
        values (`Sequence[float]`): (n,) ratings, ascending, with -`edge` and `edge` among them.
        responses (`np.ndarray`): (n,) mean of a measure at each.
        edge (`float`): z-scores; nearly all surfaces of training lie within.

    Returns:
        `float`: the largest fall outwards on either side, against the direction in which the measure goes within ±edge.
    """
    values, responses = np.asarray(values), np.asarray(responses, dtype=np.float64)
    high, low = responses[values >= edge], responses[values <= -edge][::-1]
    change = high[0] - low[0]
    falls = [np.max(np.maximum.accumulate(side) - side) for side in (high * np.sign(change), -low * np.sign(change))]
    return float(max(falls) / max(abs(change), np.finfo(np.float64).tiny))
