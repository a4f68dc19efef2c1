"""Apple's AHAP (Core Haptics, "Representing haptic patterns in AHAP files"): a lossy preview."""

import json
import math

import numpy as np

from ..io.files import write_text
from .metadata import METADATA_KEY
from .previews import DECIMALS, LOSSY, from_unit, preview, read_preview, to_unit

#: Hz at sharpness 0 and 1, as the MPEG reference encoder reads AHAP (`AhapEncoder.cpp`); Apple gives none.
FREQUENCY_HZ = (65.0, 300.0)
#: A continuous event lasts 30 s at most (CHHapticEvent.duration) ...
LONGEST_EVENT = 30.0
#: ... and a curve has 16 points at most (the SDK of `.haptic` keeps to that, `ahap.rs`).
MOST_POINTS = 16
_INTENSITY, _SHARPNESS = "HapticIntensityControl", "HapticSharpnessControl"


def write_ahap(path, texture, **about):
    """Writes a lossy preview: continuous events whose intensity and sharpness follow the texture every 20 ms.

    The intensity curve is the square root of the amplitude of a sine of the texture's power, because phones play
    intensity squared (`ahap.rs` of facebook/meta-haptics-sdk); 1 = the largest (`newtons_per_full_scale`). The
    sharpness curve is the mean of the power spectrum, 0 = 65 Hz and 1 = 300 Hz, cut beyond. Spectrum and waveform are
    lost. `Metadata.Description` says so; what belongs to the texture is in `Metadata.tactile_diffusers`. Core Haptics
    ignores keys that it does not know.

    Args:
        path (`str` or `Path`): the file; its folder must exist. An existing file is replaced as a whole.
        texture (`np.ndarray`): (samples,), N.
        **about: as for `write_haptic`.

    Raises:
        ValueError: on a bad argument, before anything is written.
    """
    times, amplitude, frequency, stored = preview(texture, **about)
    pattern = [
        *_curves(_INTENSITY, times, np.sqrt(amplitude)),
        *_curves(_SHARPNESS, times, to_unit(frequency, FREQUENCY_HZ)),
        *_events(float(times[-1])),
    ]
    contents = {"Version": 1.0, "Metadata": {"Description": LOSSY, METADATA_KEY: stored}, "Pattern": pattern}
    write_text(path, json.dumps(contents, indent=1, allow_nan=False) + "\n")


def read_ahap(path):
    """Reads what `write_ahap` wrote and plays it, as `read_haptic` does, with the same result and errors."""
    return read_preview(path, "an AHAP file", _parse)


def _curves(parameter, times, values):
    """Curves of at most 16 points, each from the last point of the one before; times count from the curve's own."""
    curves = []
    for first in range(0, len(times) - 1, MOST_POINTS - 1):
        part = slice(first, first + MOST_POINTS)
        start = round(float(times[first]), DECIMALS)
        points = [
            {"Time": round(time - start, DECIMALS), "ParameterValue": round(value, DECIMALS)}
            for time, value in zip(times[part].tolist(), values[part].tolist(), strict=True)
        ]
        curve = {"ParameterID": parameter, "Time": start, "ParameterCurveControlPoints": points}
        curves.append({"ParameterCurve": curve})
    return curves


def _events(duration):
    """Events of intensity 1 and sharpness 0: curves multiply the one and add to the other."""
    parameters = [
        {"ParameterID": "HapticIntensity", "ParameterValue": 1.0},
        {"ParameterID": "HapticSharpness", "ParameterValue": 0.0},
    ]
    events = []
    for start in (LONGEST_EVENT * np.arange(math.ceil(duration / LONGEST_EVENT))).tolist():
        length = round(min(LONGEST_EVENT, duration - start), DECIMALS)
        event = {"Time": start, "EventType": "HapticContinuous", "EventDuration": length, "EventParameters": parameters}
        events.append({"Event": event})
    return events


def _parse(contents):
    times, intensity = _joined(contents["Pattern"], _INTENSITY)
    _, sharpness = _joined(contents["Pattern"], _SHARPNESS)
    return contents["Metadata"][METADATA_KEY], times, np.square(intensity), from_unit(sharpness, FREQUENCY_HZ)


def _joined(pattern, parameter):
    curves = [entry["ParameterCurve"] for entry in pattern if "ParameterCurve" in entry]
    points = [
        (curve["Time"] + point["Time"], point["ParameterValue"])
        for curve in curves
        if curve["ParameterID"] == parameter
        for point in curve["ParameterCurveControlPoints"]
    ]
    return np.array(points).T
