"""Previews for phones and controllers: envelopes that follow the texture, within what the formats allow."""

import json

import numpy as np
import pytest

from tactile_diffusers.export import read_ahap, read_haptic, write_ahap, write_haptic
from tactile_diffusers.signal import DEVICE_RATE, rms

COMMON = {"sampling_rate": DEVICE_RATE, "friction_coefficient": 0.6, "ratings": [0.0, 0.0, 0.0], "seed": 0}


def _sine(frequency, amplitude, seconds):
    return amplitude * np.sin(2 * np.pi * frequency * np.arange(round(seconds * DEVICE_RATE)) / DEVICE_RATE)


@pytest.mark.parametrize(("write", "read"), [(write_haptic, read_haptic), (write_ahap, read_ahap)])
def test_a_sine_within_the_limits_is_played_again(tmp_path, write, read):
    """100 Hz is within what every motor plays: level and frequency come back, phase does not."""
    write(tmp_path / "a", _sine(100, 0.02, 1.5), **COMMON)
    preview, metadata = read(tmp_path / "a")
    assert rms(preview) == pytest.approx(0.02 / np.sqrt(2), rel=0.02)
    crossings = np.count_nonzero(np.diff(np.sign(preview)) > 0) / 1.5
    assert crossings == pytest.approx(100, rel=0.03) and metadata["samples"] == 15000


def test_haptic_keeps_to_its_specification(tmp_path, pink_noise):
    write_haptic(tmp_path / "a.haptic", pink_noise(16384, DEVICE_RATE)[0], **COMMON)
    contents = json.loads((tmp_path / "a.haptic").read_text())
    assert contents["version"] == {"major": 1, "minor": 0, "patch": 0}
    assert contents["metadata"]["description"].startswith("Lossy preview")
    points = contents["signals"]["continuous"]["envelopes"]
    for name in ("amplitude", "frequency"):
        times, values = (np.array([point[key] for point in points[name]]) for key in ("time", name))
        assert (np.diff(times) > 0).all() and times[0] == 0 and times[-1] == pytest.approx(1.6384)
        assert values.min() >= 0 and values.max() <= 1
    assert max(point["amplitude"] for point in points["amplitude"]) == 1


def test_ahap_keeps_to_the_limits_of_core_haptics(tmp_path, pink_noise):
    """Events of at most 30 s, curves of at most 16 points that meet, times relative to the curve."""
    texture = np.tile(pink_noise(16384, DEVICE_RATE)[0], 20)
    write_ahap(tmp_path / "a.ahap", texture, **COMMON)
    contents = json.loads((tmp_path / "a.ahap").read_text())
    assert contents["Metadata"]["Description"].startswith("Lossy preview")
    events = [entry["Event"] for entry in contents["Pattern"] if "Event" in entry]
    assert [event["Time"] for event in events] == [0, 30]
    assert events[1]["EventDuration"] == pytest.approx(2.768)
    for parameter in ("HapticIntensityControl", "HapticSharpnessControl"):
        end = 0
        for entry in contents["Pattern"]:
            curve = entry.get("ParameterCurve", {})
            if curve.get("ParameterID") == parameter:
                points = curve["ParameterCurveControlPoints"]
                assert 2 <= len(points) <= 16 and points[0]["Time"] == 0
                assert curve["Time"] == pytest.approx(end, abs=2e-5)  # 5 decimals
                assert all(0 <= point["ParameterValue"] <= 1 for point in points)
                end = curve["Time"] + points[-1]["Time"]
        assert end == pytest.approx(len(texture) / DEVICE_RATE)
