"""Shape of a waveform beyond its spectrum: how impulsive it is, and which way it leans."""

import numpy as np
from scipy import signal

#: Least RMS that is divided by: a silent texture has a shape of zeros.
LEAST_RMS = 1e-12


def waveform_shape(textures):
    """Statistics of textures that noise of the same spectrum does not share.

    Kurtosis is the fourth moment over the squared variance (3 for Gaussian noise), the crest factor the largest
    magnitude over the RMS, and skew the third moment over the RMS cubed. The skew of the derivative is negative where a
    force rises slowly and falls fast, as in stick-slip. Envelope variation is the standard deviation of the analytic
    signal's magnitude over its mean (McDermott and Simoncelli 2011), 0.52 for Gaussian noise.

    Args:
        textures (`np.ndarray`): (..., samples), of any unit.

    Returns:
        `dict[str, np.ndarray]`: "kurtosis", "crest_factor", "skew", "slope_skew" and "envelope_variation", each (...)
        float64.
    """
    textures = np.asarray(textures, dtype=np.float64)
    textures = textures - textures.mean(-1, keepdims=True)
    envelope = np.abs(signal.hilbert(textures, axis=-1))
    return {
        "kurtosis": _moment(textures, 4),
        "crest_factor": np.abs(_normalised(textures)).max(-1),
        "skew": _moment(textures, 3),
        "slope_skew": _moment(np.diff(textures, axis=-1), 3),
        "envelope_variation": envelope.std(-1) / np.maximum(envelope.mean(-1), LEAST_RMS),
    }


def _moment(values, order):
    """Third or fourth standardised moment along the last axis."""
    values = _normalised(values)
    # products of squares: a power of floats takes twenty times as long
    squares = np.square(values)
    return np.mean(squares * (values if order == 3 else squares), axis=-1)


def _normalised(values):
    values = values - values.mean(-1, keepdims=True)
    return values / np.maximum(values.std(-1, keepdims=True), LEAST_RMS)
