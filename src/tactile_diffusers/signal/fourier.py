"""Resampling of one row to any rate by Fourier's series: `resample(..., method="fourier")`."""

import numpy as np
from scipy import fft, signal
from scipy.interpolate import CubicSpline

#: Share of the new Nyquist frequency up to which `method="fourier"` keeps all; from there it fades out (half a cosine).
KEPT_SHARE = 0.9
#: Times as many samples, by Fourier's series, before the cubic: up to the Nyquist frequency it is then 90 dB exact
#: (relative error about 2 (f h)^4 at f h = 1/16).
_FINER = 8


def resample_by_fourier(texture, rate_in, rate_out, samples):
    """One row at any rate.

    The straight line from the first sample to the last is set aside, and the rest is continued by its image turned
    about its ends: value and slope go on without a step.
    """
    if samples is None:
        samples = num_samples(len(texture), rate_in, rate_out)
    line = np.linspace(texture[0], texture[-1], len(texture))
    turned = np.concatenate([texture - line, (line - texture)[-2:0:-1]])
    window = (lambda cycles: _kept(cycles, rate_in, rate_out)) if rate_out < rate_in else None
    finer = signal.resample(turned, _FINER * len(turned), window=window)
    places = np.arange(samples) * (rate_in / rate_out)
    used = min(len(finer), int(_FINER * places[-1]) + _FINER)
    slope = (texture[-1] - texture[0]) / max(1, len(texture) - 1)
    return CubicSpline(np.arange(used), finer[:used])(_FINER * places) + texture[0] + slope * places


def low_pass_for(texture, rate_in, rate_out):
    """Removes beforehand what `resample(..., method="fourier")` would, continuing the texture by its mirror image.

    `resample` keeps the two outermost samples as they are, with all frequencies that they hold: too much for coarse
    rates.

    Args:
        texture (`np.ndarray`): (samples,), any unit.
        rate_in, rate_out (`float`): as there.

    Returns:
        `np.ndarray`: (samples,) float64.
    """
    cycles = np.arange(len(texture)) / (2 * len(texture))  # of the cosines, per sample
    return fft.idct(fft.dct(np.asarray(texture, dtype=np.float64)) * _kept(cycles, rate_in, rate_out))


def _kept(cycles, rate_in, rate_out):
    """What is kept of a frequency in cycles per sample: 1 ... 0."""
    share = np.abs(cycles) * rate_in / (rate_out / 2)
    return 0.5 + 0.5 * np.cos(np.pi * np.clip((share - KEPT_SHARE) / (1 - KEPT_SHARE), 0, 1))


def num_samples(samples, rate_in, rate_out):
    """Samples at `rate_out` that lie before the end of `samples` at `rate_in`: at least 1."""
    return max(1, int(np.ceil(samples * rate_out / rate_in - 1e-6)))  # 1e-6: ratios are rounded
