"""Amplitude and frequency over time: all that formats of phones and controllers keep of a texture.

Their motors play one sine at a time. A texture is noise over 20-1000 Hz, so this is a preview: how strong and how
high-pitched it is from moment to moment; its spectrum and its waveform are gone.
"""

import numpy as np

#: s between points, and of the Hann windows around them: bins of 25 Hz, enough for a mean frequency.
STEP_SECONDS, WINDOW_SECONDS = 0.02, 0.04
#: In the description of every preview.
LOSSY = "Lossy preview of a friction texture: amplitude and mean frequency alone, one sine at a time."


def envelopes(texture, sampling_rate):
    """What a motor would have to play.

    Args:
        texture (`np.ndarray`): (samples,), N.
        sampling_rate (`int`): Hz.

    Returns:
        `tuple[np.ndarray, np.ndarray, np.ndarray]`: times (points,) in s, from 0 to the end of the texture; amplitude
        (points,) in N of a sine of the texture's power; frequency (points,) in Hz, the mean of the power spectrum.
    """
    duration = len(texture) / sampling_rate
    times = np.linspace(0, duration, max(2, round(duration / STEP_SECONDS) + 1))
    half = max(1, round(WINDOW_SECONDS * sampling_rate / 2))
    padded = np.pad(texture, half, mode="symmetric")
    centres = np.minimum(np.round(times * sampling_rate).astype(int), len(texture))
    window = np.hanning(2 * half + 1)[:-1]
    frames = padded[centres[:, None] + np.arange(2 * half)] * window
    power = np.abs(np.fft.rfft(frames)) ** 2
    total = power.sum(axis=1)
    frequencies = np.fft.rfftfreq(2 * half, 1 / sampling_rate)
    amplitude = np.sqrt(2 * np.square(frames).sum(axis=1) / np.square(window).sum())
    return times, amplitude, (power @ frequencies) / np.where(total > 0, total, 1)


def to_unit(frequency, limits):
    """Frequencies in Hz as the share of what a motor reaches, 0 to 1; beyond its limits they are cut."""
    low, high = limits
    return np.clip((frequency - low) / (high - low), 0, 1)


def from_unit(share, limits):
    """The way back, Hz."""
    low, high = limits
    return low + share * (high - low)


def play(times, amplitude, frequency, sampling_rate, samples):
    """The sine that a motor would play, with straight lines between the points: (samples,) float32, N."""
    seconds = np.arange(samples) / sampling_rate
    phase = 2 * np.pi * np.cumsum(np.interp(seconds, times, frequency)) / sampling_rate
    return (np.interp(seconds, times, amplitude) * np.sin(phase)).astype(np.float32)
