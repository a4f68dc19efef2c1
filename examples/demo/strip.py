"""The strip under the finger: plays textures under a pointer, in the browser alone."""

import base64
import json
import math
from pathlib import Path

import numpy as np

from tactile_diffusers.playback import TextureProfile
from tactile_diffusers.playback.finger import CUTOFF_HZ
from tactile_diffusers.playback.force_laws import SLOWEST_SLIDING, SPEED_EXPONENT, TURNING_SPEED
from tactile_diffusers.signal import BAND_HZ, DEVICE_RATE, REFERENCE_FORCE, SEGMENT_SAMPLES

#: Speed in mm/s that a texture of unknown speed is taken to have: the middle of the paper's limits.
UNKNOWN_SPEED = 80.0
#: Constants of the stream's laws; of what is heard, the RMS of full scale, and the force that it stands for at real
#: level, N.
LAWS = {
    "normalForce": REFERENCE_FORCE,
    "speedExponent": SPEED_EXPONENT,
    "slowestSliding": SLOWEST_SLIDING,
    "turningSpeed": TURNING_SPEED,
    "band": BAND_HZ,
    "cutoff": CUTOFF_HZ,
    "deviceRate": DEVICE_RATE,
    "soundLevel": 0.1,
    "realLevel": 0.02,
}
_SOURCE = Path(__file__).with_name("strip.html").read_text(encoding="utf-8")
PARTS = {tag: _SOURCE.split(f"<{tag}>")[1].split(f"</{tag}>")[0] for tag in ("style", "main", "script")}


def strip_value(tracks, link=None):
    """What the strip plays: JSON.

    A profile is one segment of the texture (`start_of`) over position, looped and filled as in [`TextureProfile`]; the
    laws are those of [`TextureStream`], with a lighter filter of the finger's path.

    Args:
        tracks (`Sequence[tuple[str, Texture]]`): by name, at least 0.2 s each: lanes under one finger.
        link (`str`, *optional*): query that opens the page with the same texture.
    """
    start = start_of(tracks)
    lanes = [_track(name, texture, start) for name, texture in tracks]
    active = min(1, len(lanes) - 1)  # what comes second is a result, and lies under the finger at first
    return json.dumps({"tracks": lanes, "link": link, "active": active, **LAWS})


def start_of(tracks):
    """The sample at which the strip begins: 0, or, of long textures that begin alike, a little before they differ."""
    rows = [texture.samples for _, texture in tracks]
    size = min(map(len, rows))
    differs = np.any([row[:size] != rows[0][:size] for row in rows], axis=0)
    alike = int(differs.argmax()) if differs.any() else 0 if len({*map(len, rows)}) == 1 else size
    return max(0, min(alike - SEGMENT_SAMPLES // 4, max(map(len, rows)) - SEGMENT_SAMPLES))


def _track(name, texture, start):
    speed = texture.reference_speed if math.isfinite(texture.reference_speed) else UNKNOWN_SPEED
    start = min(start, max(0, len(texture.samples) - SEGMENT_SAMPLES))
    samples = texture.samples[start : start + SEGMENT_SAMPLES]
    profile = TextureProfile(samples, texture.sampling_rate, speed, separate=False)
    known = math.isfinite(texture.friction_coefficient)
    return {
        "name": name,
        "profile": base64.b64encode(profile.period().astype("<f4").tobytes()).decode("ascii"),
        "pitch": profile.pitch,
        "referenceSpeed": speed,
        "friction": texture.friction_coefficient if known else 0.0,
        "level": max(texture.rms, 1e-9),
    }
