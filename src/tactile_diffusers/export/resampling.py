"""Samples at any other interval, in time or over position: what is written coarsely is low-passed first."""

import numpy as np
from scipy import fft, signal
from scipy.interpolate import CubicSpline

#: Share of the new Nyquist frequency up to which all is kept; from there it fades out (half a cosine).
KEPT_SHARE = 0.9
#: Times as many samples, by Fourier's series, before the cubic: up to the Nyquist frequency it is then 90 dB exact
#: (relative error about 2 (f h)^4 at f h = 1/16).
_FINER = 8


def resample_freely(texture, rate_in, rate_out, samples=None):
    """Changes the sampling rate by any ratio; `signal.resample` takes whole numbers of Hz alone.

    What lies above 0.9 of the new Nyquist frequency fades out. The straight line from the first sample to the last is
    set aside, and the rest is continued by its image turned about its ends: value and slope go on without a step.

    Args:
        texture (`np.ndarray`): (samples,), any unit.
        rate_in, rate_out (`float`): samples per s, or per mm.
        samples (`int`, *optional*): of the result; by default as many as lie before the end.

    Returns:
        `np.ndarray`: (samples,) float64, the place of the first sample unchanged.
    """

    def kept(cycles):
        return _kept(cycles, rate_in, rate_out)

    texture = np.asarray(texture, dtype=np.float64)
    if samples is None:
        samples = num_samples(len(texture), rate_in, rate_out)
    line = np.linspace(texture[0], texture[-1], len(texture))
    turned = np.concatenate([texture - line, (line - texture)[-2:0:-1]])
    finer = signal.resample(turned, _FINER * len(turned), window=kept if rate_out < rate_in else None)
    places = np.arange(samples) * (rate_in / rate_out)
    used = min(len(finer), int(_FINER * places[-1]) + _FINER)
    slope = (texture[-1] - texture[0]) / max(1, len(texture) - 1)
    return CubicSpline(np.arange(used), finer[:used])(_FINER * places) + texture[0] + slope * places


def low_pass_for(texture, rate_in, rate_out):
    """Takes away beforehand what `resample_freely` would, where that is much: it keeps the two outermost samples as
    they are, with all that they hold. The texture is continued by its mirror image.

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
