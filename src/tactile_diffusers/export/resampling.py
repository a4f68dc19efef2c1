"""Samples at any other interval, in time or over position: what is written coarsely is low-passed first."""

import numpy as np
from scipy import signal
from scipy.interpolate import CubicSpline

#: Share of the new Nyquist frequency up to which all is kept; from there it fades out (half a cosine).
KEPT_SHARE = 0.9
#: Times as many samples, by Fourier's series, before the cubic: up to the Nyquist frequency it is then 90 dB exact
#: (relative error about 2 (f h)^4 at f h = 1/16).
_FINER = 8


def resample_freely(texture, rate_in, rate_out, samples=None):
    """Changes the sampling rate by any ratio; `signal.resample` takes whole numbers of Hz alone.

    What lies above 0.9 of the new Nyquist frequency fades out. The texture is continued by its mirror image, so that
    there is no step at its ends.

    Args:
        texture (`np.ndarray`): (samples,), any unit.
        rate_in, rate_out (`float`): samples per s, or per mm.
        samples (`int`, *optional*): of the result; by default as many as lie before the end.

    Returns:
        `np.ndarray`: (samples,) float64, the place of the first sample unchanged.
    """

    def kept(cycles):
        share = np.abs(cycles) * rate_in / (rate_out / 2)
        return 0.5 + 0.5 * np.cos(np.pi * np.clip((share - KEPT_SHARE) / (1 - KEPT_SHARE), 0, 1))

    texture = np.asarray(texture, dtype=np.float64)
    if samples is None:
        samples = num_samples(len(texture), rate_in, rate_out)
    mirrored = np.concatenate([texture, texture[::-1]])
    finer = signal.resample(mirrored, _FINER * len(mirrored), window=kept if rate_out < rate_in else None)
    places = np.arange(samples) * (_FINER * rate_in / rate_out)
    used = min(len(finer), max(int(places[-1]) + _FINER, 4))
    return CubicSpline(np.arange(used), finer[:used])(places)


def num_samples(samples, rate_in, rate_out):
    """Samples at `rate_out` that lie before the end of `samples` at `rate_in`: at least 1."""
    return max(1, int(np.ceil(samples * rate_out / rate_in - 1e-6)))  # 1e-6: ratios are rounded
