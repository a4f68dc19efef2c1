"""Lossy previews for phones and controllers: Apple's AHAP and Meta's `.haptic`, amplitude and frequency over time.

Their motors play one sine at a time. A texture is noise over 20-1000 Hz, so a preview says how strong and how
high-pitched it is from moment to moment; its spectrum and its waveform are lost, and the description in the file says
so. What belongs to the texture is stored in the file's metadata under `tactile_diffusers`, which players ignore.
"""

import json
import math

import numpy as np

from ..io.files import write_text
from ..io.reading import read_json, reading
from ..version import __version__
from .metadata import METADATA_KEY, check_read, check_span, describe_texture, from_json, to_json

#: s between points, and of the Hann windows around them: bins of 25 Hz, enough for a mean frequency.
STEP_SECONDS, WINDOW_SECONDS = 0.02, 0.04
#: Decimals of all numbers.
DECIMALS = 5
#: In the description of every preview.
LOSSY = "Lossy preview of a friction texture: amplitude and mean frequency alone, one sine at a time."
#: Hz at frequency 0 and 1 of Meta's controllers (`resources/acf/MetaQuest.acf` of facebook/meta-haptics-sdk).
HAPTIC_HZ = (55.0, 200.0)
#: Hz at sharpness 0 and 1, as the MPEG reference encoder reads AHAP (`AhapEncoder.cpp`); Apple gives none.
AHAP_HZ = (65.0, 300.0)
#: A continuous event of AHAP lasts 30 s at most (CHHapticEvent.duration) ...
LONGEST_EVENT = 30.0
#: ... and a curve has 16 points at most (the SDK of `.haptic` keeps to that, `ahap.rs`).
MOST_POINTS = 16
_INTENSITY, _SHARPNESS = "HapticIntensityControl", "HapticSharpnessControl"


def write_haptic(path, texture, **about):
    """Writes Meta's `.haptic` 1.0 (facebook/meta-haptics-sdk, `resources/haptic-file-spec.md`): a point every 20 ms.

    Amplitude is that of a sine of the texture's power, 1 = the largest (`newtons_per_full_scale`); frequency is the
    mean of the power spectrum, 0 = 55 Hz and 1 = 200 Hz as on Meta Quest controllers, cut beyond.

    Arguments and errors are those of `write_npz`.
    """
    times, amplitude, frequency, stored = _preview(texture, **about)
    values = {"amplitude": amplitude, "frequency": _to_unit(frequency, HAPTIC_HZ)}
    points = {
        name: [{"time": time, name: value} for time, value in _rounded(times, column)]
        for name, column in values.items()
    }
    contents = {
        "version": {"major": 1, "minor": 0, "patch": 0},
        "metadata": {"editor": f"tactile_diffusers {__version__}", "description": LOSSY, METADATA_KEY: stored},
        "signals": {"continuous": {"envelopes": points}},
    }
    write_text(path, json.dumps(contents, indent=1, allow_nan=False) + "\n")


def read_haptic(path):
    """Reads what `write_haptic` wrote and plays it: a sine of changing amplitude and frequency.

    Result and errors are those of `read_npz`, the preview in place of the texture; the dict also holds
    `newtons_per_full_scale` and `samples`.
    """

    def parse(contents):
        points = contents["signals"]["continuous"]["envelopes"]
        times, amplitude = (np.array([point[name] for point in points["amplitude"]]) for name in ("time", "amplitude"))
        frequency = _from_unit(np.array([point["frequency"] for point in points["frequency"]]), HAPTIC_HZ)
        return contents["metadata"][METADATA_KEY], times, amplitude, frequency

    return _play(path, "a .haptic file", parse)


def write_ahap(path, texture, **about):
    """Writes Apple's AHAP (Core Haptics, "Representing haptic patterns in AHAP files"): a point every 20 ms.

    The intensity curve is the square root of the amplitude of a sine of the texture's power, because phones play
    intensity squared (`ahap.rs` of facebook/meta-haptics-sdk); 1 = the largest (`newtons_per_full_scale`). The
    sharpness curve is the mean of the power spectrum, 0 = 65 Hz and 1 = 300 Hz, cut beyond.

    Arguments and errors are those of `write_npz`.
    """
    times, amplitude, frequency, stored = _preview(texture, **about)
    pattern = [
        *_curves(_INTENSITY, times, np.sqrt(amplitude)),
        *_curves(_SHARPNESS, times, _to_unit(frequency, AHAP_HZ)),
        *_events(float(times[-1])),
    ]
    contents = {"Version": 1.0, "Metadata": {"Description": LOSSY, METADATA_KEY: stored}, "Pattern": pattern}
    write_text(path, json.dumps(contents, indent=1, allow_nan=False) + "\n")


def read_ahap(path):
    """Reads what `write_ahap` wrote and plays it, as `read_haptic` does, with the same result and errors."""

    def parse(contents):
        times, intensity = _joined(contents["Pattern"], _INTENSITY)
        _, sharpness = _joined(contents["Pattern"], _SHARPNESS)
        return contents["Metadata"][METADATA_KEY], times, np.square(intensity), _from_unit(sharpness, AHAP_HZ)

    return _play(path, "an AHAP file", parse)


def _preview(texture, **about):
    """Times (points,), s; amplitude, 1 = the largest; frequency, Hz; and what is stored with it, as JSON."""
    texture, metadata = describe_texture(texture, **about)
    times, amplitude, frequency = _envelopes(texture, metadata["sampling_rate"])
    scale = float(amplitude.max()) or 1.0  # silence: any scale will do
    metadata |= {"newtons_per_full_scale": scale, "samples": len(texture)}
    return times, amplitude / scale, frequency, to_json(metadata)


def _play(path, kind, parse):
    """Texture and metadata; `parse` gives the stored metadata, times, amplitudes and Hz of the file's JSON object."""
    with reading(path, f"{kind} that this package wrote", "Write the texture again."):
        stored, times, amplitude, frequency = parse(read_json(path, "JSON"))
        metadata = from_json(stored, path, "newtons_per_full_scale", "samples")
        check_span(times[-1], metadata)
        seconds = np.arange(metadata["samples"]) / metadata["sampling_rate"]
        phase = 2 * np.pi * np.cumsum(np.interp(seconds, times, frequency)) / metadata["sampling_rate"]
        newtons = np.interp(seconds, times, amplitude * metadata["newtons_per_full_scale"])
        return check_read((newtons * np.sin(phase)).astype(np.float32), metadata)


def _envelopes(texture, sampling_rate):
    """Times, s; amplitude of a sine of the texture's power, N; mean frequency of its power, Hz: each (points,)."""
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


def _to_unit(frequency, limits):
    """Frequencies in Hz as the share of what a motor reaches, 0 to 1; beyond its limits they are cut."""
    low, high = limits
    return np.clip((frequency - low) / (high - low), 0, 1)


def _from_unit(share, limits):
    low, high = limits
    return low + share * (high - low)


def _rounded(times, values):
    return zip(np.round(times, DECIMALS).tolist(), np.round(values, DECIMALS).tolist(), strict=True)


def _curves(parameter, times, values):
    """Curves of at most 16 points, each from the last point of the one before; times count from the curve's own."""
    curves = []
    for first in range(0, len(times) - 1, MOST_POINTS - 1):
        part = slice(first, first + MOST_POINTS)
        start = round(float(times[first]), DECIMALS)
        points = [
            {"Time": time, "ParameterValue": value} for time, value in _rounded(times[part] - start, values[part])
        ]
        curve = {"ParameterID": parameter, "Time": start, "ParameterCurveControlPoints": points}
        curves.append({"ParameterCurve": curve})
    return curves


def _events(duration):
    """Events of intensity 1 and sharpness 0: curves multiply the one and add to the other."""
    parameters = [
        {"ParameterID": name, "ParameterValue": value}
        for name, value in (("HapticIntensity", 1.0), ("HapticSharpness", 0.0))
    ]
    events = []
    for start in (LONGEST_EVENT * np.arange(math.ceil(duration / LONGEST_EVENT))).tolist():
        length = round(min(LONGEST_EVENT, duration - start), DECIMALS)
        event = {"Time": start, "EventType": "HapticContinuous", "EventDuration": length, "EventParameters": parameters}
        events.append({"Event": event})
    return events


def _joined(pattern, parameter):
    """Times and values (2, points) of a parameter, over all of its curves."""
    curves = [entry["ParameterCurve"] for entry in pattern if "ParameterCurve" in entry]
    points = [
        (curve["Time"] + point["Time"], point["ParameterValue"])
        for curve in curves
        if curve["ParameterID"] == parameter
        for point in curve["ParameterCurveControlPoints"]
    ]
    return np.array(points).T
