"""PCM blocks in [-1, 1] at any device's rate, with the scale beside them: from a texture, or from a stream.

OpenXR's `XrHapticPcmVibrationFB` takes such blocks of float32 (a Quest controller at 2 kHz), and so does an audio
device, or what the W3C's haptics groups discuss for the web. Newtons = sample x `newtons_per_full_scale`.
"""

import math
import warnings
from dataclasses import dataclass

import numpy as np
from scipy import signal

from ..signal import BAND_HZ, REFERENCE_FORCE, resample
from ..signal.checks import check_number, check_whole_number
from ..signal.resampling import low_pass_for
from .metadata import check_texture, full_scale_of

#: Share of the device's Nyquist frequency that the low-pass of a stream keeps: an elliptic filter of this order, ripple
#: and attenuation, dB. Its delay is a few samples of the device.
KEPT_SHARE = 0.8
_ORDER, _RIPPLE, _STOP = 6, 0.1, 60
#: Samples of the stream that the cubic between them needs on either side.
_MARGIN = 2


@dataclass(frozen=True)
class PCM:
    """A texture as a device takes it.

    Args:
        samples (`np.ndarray`): (n,) float32 in [-1, 1].
        sampling_rate (`float`): of the device, Hz.
        newtons_per_full_scale (`float`): N of a sample of 1.
    """

    samples: np.ndarray
    sampling_rate: float
    newtons_per_full_scale: float

    @classmethod
    def of_texture(cls, texture, sampling_rate, device_rate, full_scale=None):
        """A whole texture at the device's rate; what lies above 0.9 of its Nyquist frequency fades out.

        Args:
            texture (`np.ndarray`): (samples,), N.
            sampling_rate (`int`): of it, Hz.
            device_rate (`float`): Hz.
            full_scale (`float`, *optional*): N of a sample of 1; by default the largest force.

        Raises:
            ValueError: on a bad argument, or a texture that peaks above `full_scale`.
        """
        texture = check_texture(texture, sampling_rate)
        device_rate = check_number("device_rate", device_rate, "Hz", above=2 * BAND_HZ[0])
        if device_rate < sampling_rate:
            texture = low_pass_for(texture, sampling_rate, device_rate)
        samples = resample(texture, sampling_rate, device_rate, method="fourier")
        scale = full_scale_of(np.abs(samples).max(), full_scale)
        return cls(np.clip(samples / scale, -1, 1).astype(np.float32), device_rate, scale)

    def blocks(self, samples):
        """Blocks of (samples,) float32, one after the other; the last one ends in zeros."""
        count = check_whole_number("samples", samples)
        for begin in range(0, len(self.samples), count):
            block = self.samples[begin : begin + count]
            yield np.pad(block, (0, count - len(block)))


class PCMStream:
    """Blocks of what a stream plays, friction about its mean, in [-1, 1] at a device's rate.

    The stream runs at its own rate. What the device's rate cannot hold is filtered out before; between the samples of
    the stream lies a cubic.

    Args:
        stream ([`TextureStream`] or [`EndlessStream`]): its reports are given to it as ever.
        device_rate (`float`): Hz.
        full_scale (`float`): N of a sample of 1.

    Attributes:
        newtons_per_full_scale (`float`): N of a sample of 1.
        clipped (`int`): samples so far that were beyond full scale; the first ones are warned of.

    Raises:
        ValueError: on an impossible rate or scale.
    """

    def __init__(self, stream, device_rate, full_scale):
        if not callable(getattr(stream, "read_friction", None)):
            raise ValueError(f"`stream` must be a TextureStream or an EndlessStream, got {type(stream).__name__}.")
        self.stream = stream
        self.sampling_rate = check_number("device_rate", device_rate, "Hz", above=2 * BAND_HZ[0])
        self.newtons_per_full_scale = check_number("full_scale", full_scale, "N", above=0)
        self.clipped, self._read = 0, 0
        # samples of the stream from number `_first` on; before the first one there was no force
        self._held, self._first = np.zeros(_MARGIN + 1), -_MARGIN - 1
        self._filter = self._state = None
        if (corner := KEPT_SHARE * self.sampling_rate / 2) < min(BAND_HZ[1], stream.sampling_rate / 2):
            self._filter = signal.ellip(_ORDER, _RIPPLE, _STOP, corner, fs=stream.sampling_rate, output="sos")
            self._state = np.zeros((len(self._filter), 2))

    def read(self, samples, normal_force=REFERENCE_FORCE):
        """The next block, (samples,) float32 in [-1, 1]; `normal_force`, N, is one number, as of `stream.read`."""
        count = check_whole_number("samples", samples)
        normal_force = check_number("normal_force", normal_force, "N")
        places = (self._read + np.arange(count)) * (self.stream.sampling_rate / self.sampling_rate) - _MARGIN
        needed = math.floor(places[-1]) + _MARGIN + 1 - (self._first + len(self._held))
        if needed > 0:
            self._held = np.concatenate([self._held, self._next(needed, normal_force)])
        self._read += count
        below = np.floor(places).astype(int)
        values = _cubic(self._held, below - self._first, places - below) / self.newtons_per_full_scale
        kept = math.floor(self._read * self.stream.sampling_rate / self.sampling_rate) - 2 * _MARGIN
        drop = min(max(0, kept - self._first), len(self._held))  # what lies between must still be read
        self._held, self._first = self._held[drop:], self._first + drop
        beyond = int(np.count_nonzero(np.abs(values) > 1))
        if beyond and not self.clipped:
            warnings.warn(
                f"The stream is beyond the full scale of {self.newtons_per_full_scale:g} N, by a factor of "
                f"{np.abs(values).max():.3g}, and is clipped. Give a larger `full_scale`.",
                UserWarning,
                stacklevel=2,
            )
        self.clipped += beyond
        return np.clip(values, -1, 1).astype(np.float32)

    def _next(self, samples, normal_force):
        force = self.stream.read_friction(samples, normal_force)[0].astype(np.float64)
        if self._filter is not None:
            force, self._state = signal.sosfilt(self._filter, force, zi=self._state)
        return force


def _cubic(values, below, share):
    """Through the four samples about each place (Lagrange): 50 dB exact at a tenth of the sampling rate."""
    before, left, right, after = (values[below + shift] for shift in (-1, 0, 1, 2))
    return (
        before * (-share * (share - 1) * (share - 2) / 6)
        + left * ((share + 1) * (share - 1) * (share - 2) / 2)
        + right * (-(share + 1) * share * (share - 2) / 2)
        + after * ((share + 1) * share * (share - 1) / 6)
    )
