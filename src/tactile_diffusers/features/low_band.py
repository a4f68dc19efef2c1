"""The low end of the waveform as fewer samples: the latents' detail layer.

Low-passed and sampled with a root-raised-cosine pulse, as a modem shapes its symbols: pulses a sample apart are
orthogonal, so sampling and synthesis with the same pulse project the waveform on what so many samples can hold.
"""

import math

import numpy as np
import torch
import torch.nn.functional as F

#: Share of the sampled band over which the pulse's spectrum falls off. With a quarter its formula has no 0 / 0.
ROLL_OFF = 0.25
#: Samples of the low band on either side that a pulse reaches.
REACH = 16


def pulse(stride, device=None):
    """Root-raised-cosine pulse of unit energy between two samples: (2 * REACH * stride,) float32.

    Args:
        stride (`int`): samples of the waveform per sample of its low band.
    """
    times = (torch.arange(2 * REACH * stride, dtype=torch.float32, device=device) + 0.5) / stride - REACH
    slope = 4 * ROLL_OFF * times
    wave = torch.sin(math.pi * (1 - ROLL_OFF) * times) + slope * torch.cos(math.pi * (1 + ROLL_OFF) * times)
    wave = wave / (math.pi * times * (1 - slope.square()))
    return wave / wave.square().sum().sqrt()


def sample_low_band(waveform, stride):
    """Samples of the low band, up to 1 / (2 * stride) of the sampling rate; the ends are continued by mirroring.

    Args:
        waveform (`np.ndarray`): (batch, samples), a multiple of `stride`.
        stride (`int`): samples of the waveform per sample of its low band; even, so that a pulse lies on its mirror.

    Returns:
        `np.ndarray`: (batch, samples / stride) float64; of unit variance for white noise of unit variance.
    """
    margin = REACH * stride - stride // 2
    padded = np.pad(np.asarray(waveform, dtype=np.float64), ((0, 0), (margin, margin + stride % 2)), mode="symmetric")
    pieces = np.lib.stride_tricks.sliding_window_view(padded, 2 * REACH * stride, axis=-1)[:, ::stride]
    return pieces @ pulse(stride).double().numpy()


def synthesize(low_band, stride):
    """The waveform that samples of the low band hold: (batch, samples) -> (batch, 1, samples * stride)."""
    count = low_band.shape[-1]
    places = torch.arange(-REACH, count + REACH, device=low_band.device) % (2 * count)
    mirrored = low_band[:, torch.minimum(places, 2 * count - 1 - places)]
    kernel = pulse(stride, low_band.device).to(low_band.dtype)
    margin = 2 * REACH * stride - stride // 2
    return F.conv_transpose1d(mirrored[:, None], kernel[None, None], stride=stride)[
        ..., margin : margin + count * stride
    ]
