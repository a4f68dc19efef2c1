"""The one resampler: polyphase between whole rates, or by Fourier's series to any rate, in time or over position."""

from functools import lru_cache
from math import gcd

import numpy as np
from scipy import fft, signal
from scipy.interpolate import CubicSpline

#: Share of the new Nyquist frequency up to which `method="fourier"` keeps all; from there it fades out (half a cosine).
KEPT_SHARE = 0.9
#: Times as many samples, by Fourier's series, before the cubic: up to the Nyquist frequency it is then 90 dB exact
#: (relative error about 2 (f h)^4 at f h = 1/16).
_FINER = 8


def resample(texture, rate_in, rate_out, samples=None, method="polyphase", dtype=np.float64):
    """Changes the sampling rate along the last axis; the time of the first sample stays.

    Args:
        texture (`np.ndarray`): (..., samples), any unit.
        rate_in, rate_out (`float`): samples per s, or per mm; whole numbers for `"polyphase"`.
        samples (`int`, *optional*): of the result; `None` = all before the end.
        method (`str`): `"polyphase"`, a low-pass that is flat up to 0.96 of the lower Nyquist frequency, zeros beyond
            the ends; or `"fourier"` for any ratio of rates, which keeps 0.9 of the new Nyquist frequency and continues
            the ends without a step (values and slopes), for one row (samples,).
        dtype (`type`): `np.float32` computes a whole multiple of the rate in single precision, several times as fast.

    Returns:
        `np.ndarray`: (..., ceil(samples * rate_out / rate_in)) of `dtype`.

    Raises:
        ValueError: if a rate is not positive, or for `"polyphase"` not a whole number.
    """
    for name, rate in (("rate_in", rate_in), ("rate_out", rate_out)):
        if not 0 < rate < np.inf or (method == "polyphase" and rate % 1):
            whole = " whole" if method == "polyphase" else ""
            raise ValueError(f"`{name}` must be a positive{whole} number of Hz, got {rate}.")
    texture = np.asarray(texture, dtype=np.float64)
    if method == "fourier":
        return resample_by_fourier(texture, rate_in, rate_out, samples).astype(dtype, copy=False)
    divisor = gcd(int(rate_in), int(rate_out))
    up, down = int(rate_out) // divisor, int(rate_in) // divisor
    if up == down:
        resampled = texture
    elif down == 1 and dtype == np.float32:
        resampled = _upsample_float32(texture, up)
    else:
        resampled = signal.resample_poly(texture, up, down, axis=-1, window=anti_alias_filter(up, down))
    return resampled[..., :samples].astype(dtype, copy=False)


@lru_cache(maxsize=16)
def anti_alias_filter(up, down):
    """Kaiser low-pass for `"polyphase"`, flat up to 0.48 and stopped from 0.52 of the lower rate.

    Between 10 and 2.5 kHz that is 1200 and 1300 Hz: what would fold below 1.2 kHz is 80 dB down.
    """
    fastest = max(up, down)
    nyquist = fastest / 2  # of the upsampled signal, in units of the lower rate
    taps, beta = signal.kaiserord(80.0, 0.04 / nyquist)
    return signal.firwin(taps | 1, 0.5 / nyquist, window=("kaiser", beta))


@lru_cache(maxsize=8)
def _phases(up):
    """`anti_alias_filter` as one filter for each of the `up` new samples of an old one: (up, 1, taps) float32."""
    import torch

    taps = up * anti_alias_filter(up, 1)
    half = len(taps) // 2
    reach = -(-half // up)
    padded = np.pad(taps, (reach * up - half, (reach + 1) * up - half - 1))  # the middle tap lies at reach * up
    return torch.from_numpy(padded.reshape(-1, up)[::-1].T.astype(np.float32))[:, None]


def _upsample_float32(texture, up):
    """The polyphase filter as one convolution in single precision, for waveforms that a model has just made."""
    import torch  # here, since playing and exporting need none of its seconds

    phases = _phases(up)
    rows = torch.from_numpy(texture.astype(np.float32)).reshape(-1, 1, texture.shape[-1])
    with torch.autocast("cpu", enabled=False):  # of a caller, which would compute in half precision
        filtered = torch.nn.functional.conv1d(rows, phases, padding=phases.shape[-1] // 2)
    return filtered.transpose(1, 2).flatten(1).numpy().reshape(*texture.shape[:-1], -1)


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
