"""Stick-slip in a texture: events that come and go in time, taken apart from what is fixed in space.

A contact that sticks and slips charges at its stiffness times the finger's speed, and lets go when it carries the
excess of static friction: a relaxation oscillation (Wiertlewski 2011). It is tied to no place. So its trains are
played over what the finger has travelled, always forwards, by the laws of rate and level of `force_laws`.

The train is found by what relief has not together: it comes and goes within tenths of a second while the rest stays, it
has a rate, so that little lies an octave below it, and a polarity, because it charges slowly and lets go fast.
"""

import numpy as np
from scipy import signal

from ..signal import BAND_HZ, band_edges
from ..signal.waveform_shape import waveform_shape
from .force_laws import event_gain, event_rate

#: Window of the spectrogram, s: shorter than trains last, longer than their periods.
WINDOW_SECONDS = 0.1
#: Shorter textures than this, s, are too short for events to come and go.
LEAST_SECONDS = 1.0
#: Skew of the derivative (`waveform_shape`) of textures that may hold events, and of events.
TEXTURE_SKEW, EVENT_SKEW = -0.1, -0.75
#: At its rate a train has at least so many times the power of the rest, and of its own an octave lower and below. These
#: find 30 of 48 virtual surfaces with a tenth of their power or more in stick-slip, and 1 of 341 others; lower ones
#: find the catches of relief.
LEAST_CONTRAST, LEAST_HUMP = 1.3, 3.0
_ITERATIONS = 100


def separate_events(texture, sampling_rate):
    """Parts of a texture: its events and what is left of it; `None` if it has no events.

    The power of a short-time spectrum is taken for the sum of a part that stays, s(f), and one that comes and goes,
    e(f) g(t) (non-negative matrix factorisation, Lee & Seung 2001). Each part keeps its share of the power, so that
    their powers add up to the texture's when they are played independently.

    Args:
        texture (`np.ndarray`): (samples,), N.
        sampling_rate (`float`): Hz.

    Returns:
        `tuple[np.ndarray, np.ndarray]` or `None`: (samples,) each, N.
    """
    if len(texture) < LEAST_SECONDS * sampling_rate or waveform_shape(texture)["slope_skew"] > TEXTURE_SKEW:
        return None
    window = round(WINDOW_SECONDS * sampling_rate / 8) * 8
    settings = {"fs": sampling_rate, "nperseg": window, "noverlap": window * 7 // 8}
    frequencies, _, spectrum = signal.stft(texture, boundary="even", **settings)
    felt = (frequencies >= BAND_HZ[0]) & (frequencies <= BAND_HZ[1])
    power = np.abs(spectrum[felt]) ** 2
    mean = np.maximum(power.mean(1, keepdims=True), np.finfo(np.float64).tiny)
    stays, comes, gain = _factors(power / mean)
    share = np.zeros(spectrum.shape)
    share[felt] = comes[:, None] * gain / (stays[:, None] + comes[:, None] * gain)
    events, rest = (
        signal.istft(spectrum * np.sqrt(part), **settings)[1][: len(texture)] for part in (share, 1 - share)
    )
    bands = np.digitize(frequencies[felt], band_edges()[1:-1])
    of_events, of_rest = (np.bincount(bands, part * mean[:, 0], len(band_edges()) - 1) for part in (comes, stays))
    rate = np.argmax(of_events)
    if rate < 2 or of_events[rate] < max(LEAST_CONTRAST * of_rest[rate], LEAST_HUMP * of_events[: rate - 1].max()):
        return None
    return (events, rest) if waveform_shape(events)["slope_skew"] < EVENT_SKEW else None


def _factors(power):
    """s (bins,), e (bins,) and g (frames,) of unit mean, so that s + e g is near the power (bins, frames) of unit mean.

    Multiplicative updates of the Kullback-Leibler divergence; g falls to zero where events rest.
    """
    stays, comes, gain = np.full(len(power), 0.5), np.full(len(power), 0.5), power.mean(0)
    for _ in range(_ITERATIONS):
        stays *= (power / _model(stays, comes, gain)).mean(1)
        comes *= (power / _model(stays, comes, gain)) @ gain / gain.sum()
        gain *= comes @ (power / _model(stays, comes, gain)) / comes.sum()
    calm = np.quantile(gain, 0.05)
    gain = np.maximum(gain - calm, 0)
    return stays + calm * comes, comes * gain.mean(), gain / max(gain.mean(), np.finfo(np.float64).tiny)


def _model(stays, comes, gain):
    return np.maximum(stays[:, None] + comes[:, None] * gain, np.finfo(np.float64).tiny)


class EventPlayer:
    """Plays the events of one profile, block by block.

    Args:
        events (`TextureProfile`): of the events, over mm of travel at the reference speed and load.
        sampling_rate (`float`): of the blocks, Hz.
    """

    def __init__(self, events, sampling_rate):
        self._events, self._sampling_rate = events, sampling_rate
        # not where the rest of the texture begins: both came from the same places
        self._travel = events.length / 2

    def advance(self, speed, normal_force):
        """The next block of events, N: (samples,), for speeds (samples,), mm/s, and normal force, N, one or (samples,).

        However the finger turns, events go forwards: the slow side comes first.
        """
        reference = self._events.reference_speed
        rate = speed * event_rate(speed, normal_force, reference)
        travel = self._travel + np.cumsum(rate) / self._sampling_rate
        self._travel = travel[-1] % self._events.length
        return self._events.read(travel, rate) * event_gain(speed, normal_force, reference)
