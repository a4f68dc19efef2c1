"""From the working rate to the delivery rate, the last and, for many textures, the slowest filter."""

from functools import lru_cache

import numpy as np
import torch

from ..signal import resample
from ..signal.filters import anti_alias_filter


@lru_cache(maxsize=8)
def _phases(up):
    """The filter of `resample`, split into one for each new sample of an old one: (up, 1, taps) float32."""
    taps = up * anti_alias_filter(up, 1)
    half = len(taps) // 2
    reach = -(-half // up)
    padded = np.pad(taps, (reach * up - half, (reach + 1) * up - half - 1))  # the middle tap lies at reach * up
    return torch.from_numpy(padded.reshape(-1, up)[::-1].T.astype(np.float32))[:, None]


def resample_quickly(waveform, rate_in, rate_out):
    """`resample` where `rate_out` is a multiple of `rate_in`: one convolution in float32, several times as fast.

    Args:
        waveform (`np.ndarray`): (batch, samples).
        rate_in, rate_out (`int`): Hz; whole numbers.

    Returns:
        `np.ndarray`: (batch, samples * rate_out / rate_in) float64, exact to rounding of float32.
    """
    if rate_out % rate_in or rate_out == rate_in:
        return resample(waveform, rate_in, rate_out)
    phases = _phases(rate_out // rate_in)
    waveform = torch.from_numpy(waveform.astype(np.float32))[:, None]
    made = torch.nn.functional.conv1d(waveform, phases, padding=phases.shape[-1] // 2)
    return made.transpose(1, 2).flatten(1).double().numpy()
