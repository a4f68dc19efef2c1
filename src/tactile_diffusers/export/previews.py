"""Previews for phones and controllers: amplitude and frequency over time, all that their formats keep of a texture.

Their motors play one sine at a time. A texture is noise over 20-1000 Hz, so a preview says how strong and how
high-pitched it is from moment to moment; its spectrum and its waveform are lost.
"""

import numpy as np

from ..io.reading import read_json, reading
from .metadata import check_read, check_span, describe_texture, from_json, to_json

#: s between points, and of the Hann windows around them: bins of 25 Hz, enough for a mean frequency.
STEP_SECONDS, WINDOW_SECONDS = 0.02, 0.04
#: Decimals of all numbers.
DECIMALS = 5
#: In the description of every preview.
LOSSY = "Lossy preview of a friction texture: amplitude and mean frequency alone, one sine at a time."


def preview(texture, **about):
    """What a motor would have to play.

    Args:
        texture (`np.ndarray`): (samples,), N.
        **about: as for `write_npz`.

    Returns:
        `tuple[np.ndarray, np.ndarray, np.ndarray, dict]`: times (points,) in s, from 0 to the end of the texture;
        amplitude (points,), 1 = the largest; frequency (points,) in Hz; and what is stored with it, as JSON, with
        `newtons_per_full_scale` and `samples`.

    Raises:
        ValueError: on a bad argument.
    """
    texture, metadata = describe_texture(texture, **about)
    times, amplitude, frequency = envelopes(texture, metadata["sampling_rate"])
    scale = float(amplitude.max()) or 1.0  # silence: any scale will do
    metadata |= {"newtons_per_full_scale": scale, "samples": len(texture)}
    return times, amplitude / scale, frequency, to_json(metadata)


def read_preview(path, kind, parse):
    """Reads a preview and plays it: a sine of changing amplitude and frequency.

    Args:
        path (`str` or `Path`): the file.
        kind (`str`): of file, for messages.
        parse (`Callable`): gives, of the file's JSON object, what is stored with the texture, times in s, amplitudes
            from 0 to 1 and frequencies in Hz.

    Returns:
        `tuple[np.ndarray, dict]`: the preview (samples,) float32 in N at the sampling rate of the texture, and what is
        stored with it as in `read_npz`; also `newtons_per_full_scale` and `samples`.
    """
    with reading(path, f"{kind} that this package wrote", "Write the texture again."):
        stored, times, amplitude, frequency = parse(read_json(path, "JSON"))
        metadata = from_json(stored, path, ("newtons_per_full_scale", "samples"))
        check_span(times[-1], metadata)
        seconds = np.arange(metadata["samples"]) / metadata["sampling_rate"]
        phase = 2 * np.pi * np.cumsum(np.interp(seconds, times, frequency)) / metadata["sampling_rate"]
        newtons = np.interp(seconds, times, amplitude * metadata["newtons_per_full_scale"])
        return check_read((newtons * np.sin(phase)).astype(np.float32), metadata)


def envelopes(texture, sampling_rate):
    """Times (points,) in s; amplitude (points,) in N of a sine of the texture's power; and the mean frequency of the
    power spectrum (points,) in Hz, of a texture (samples,) in N."""
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
    """The inverse of `to_unit`, Hz."""
    low, high = limits
    return low + share * (high - low)
