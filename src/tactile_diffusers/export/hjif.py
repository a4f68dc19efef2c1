"""MPEG haptics (ISO/IEC 23090-31) in its JSON interchange format, `.hjif`.

One perception, one channel, one Curve band with one effect: a key frame for every sample. The JSON schemas of
MPEGGroup/HapticJSONSchemas take it, and the reference software plays it. Of its modalities, Force is over time;
Friction and Vibrotactile Texture are over position (reference software, `IOStream.cpp`).
"""

import json
from datetime import UTC, datetime

import numpy as np

from ..io.files import write_text
from ..io.reading import read_json, reading
from ..signal import BAND_HZ, REFERENCE_FORCE, resample
from ..signal.checks import check_number
from .metadata import check_known_speed, check_read, check_span, describe_texture, from_json, mean_friction, to_json

#: Key frames per s; over position at least as many at the reference speed.
KEY_FRAME_RATE = 8000
#: Decimals of a key frame's amplitude, in [-1, 1].
DECIMALS = 5
TEMPORAL, SPATIAL = ("Force",), ("Friction", "Vibrotactile Texture")
#: Powers of ten of the unit of the independent variable: ms, the schemas' default, and micrometres.
_MILLI, _MICRO = -3, -6
_UM_PER_MM = 1000


def write_hjif(path, texture, *, modality="Force", normal_force=REFERENCE_FORCE, **about):
    """Writes one texture as a haptic experience of one perception.

    Key frames lie in [-1, 1]; times the channel's `gain` they are newtons (Force, Vibrotactile Texture), or the
    friction coefficient `friction_coefficient` + texture / `normal_force` (Friction; about 0 if the mean is unknown).
    Force: 8000 key frames per s. Over position: a whole number of micrometres apart, `unit_exponent` -6, and
    `timescale` is the reference speed in um/s, so that a player which takes position for time plays what is felt at
    that speed. All that belongs to the texture is JSON in the `description`.

    Args:
        path, texture, **about: as for `write_npz`.
        modality (`str`, *optional*, defaults to `"Force"`): `"Force"`, over time, or `"Friction"` or `"Vibrotactile
            Texture"`, over position; these need a reference speed of at least 8 mm/s.
        normal_force (`float`, *optional*, defaults to 0.5): N at which the texture was recorded; for Friction.

    Raises:
        ValueError: on a bad argument, before anything is written.
    """
    texture, metadata = describe_texture(texture, **about)
    if modality not in TEMPORAL + SPATIAL:
        raise ValueError(f"`modality` must be one of {', '.join(TEMPORAL + SPATIAL)}, got {modality!r}.")
    normal_force = check_number("normal_force", normal_force, "N", above=0)
    timescale, step = (KEY_FRAME_RATE, 1) if modality in TEMPORAL else _micrometres(check_known_speed(metadata))

    values = resample(texture, metadata["sampling_rate"], timescale / step, method="fourier")
    if modality == "Friction":
        values = mean_friction(metadata) + values / normal_force
        metadata["normal_force"] = normal_force
    gain = float(np.abs(values).max()) or 1.0  # silence: any scale will do
    experience = _experience(modality, timescale, step, np.round(values / gain, DECIMALS), gain)
    experience["description"] = json.dumps(to_json({**metadata, "samples": len(texture)}), allow_nan=False)
    write_text(path, json.dumps(experience, separators=(",", ":"), allow_nan=False) + "\n")


def _micrometres(speed):
    """Ticks per s, of which each is a micrometre at this speed (mm/s), and ticks between key frames."""
    step = int(speed * _UM_PER_MM / KEY_FRAME_RATE)
    if step < 1:
        raise ValueError(
            f"`reference_speed` must be at least {KEY_FRAME_RATE / _UM_PER_MM:g} mm/s for key frames a micrometre or "
            f"more apart, got {speed:g}. Choose the modality Force."
        )
    return round(speed * _UM_PER_MM), step


def _experience(modality, timescale, step, amplitudes, gain):
    """All but the description; ids and optional members as the reference encoder and its loader want them."""
    frames = [
        {"relative_position": place * step, "amplitude_modulation": amplitude}
        for place, amplitude in enumerate(amplitudes.tolist())
    ]
    band = {
        "band_type": "Curve",
        "curve_type": "Linear",
        "lower_frequency_limit": 0,
        "upper_frequency_limit": BAND_HZ[1],
        "effects": [{"effect_type": "Basis", "position": 0, "phase": 0, "base_signal": "Sine", "keyframes": frames}],
    }
    unit = "friction coefficient" if modality == "Friction" else "N"
    channel = {
        "id": 0,
        "description": f"{unit} = gain x amplitude",
        "gain": gain,
        "mixing_coefficient": 1,
        "frequency_sampling": round(timescale / step),
        "sample_count": len(frames),
        "bands": [band],
    }
    perception = {
        "id": 0,
        "perception_modality": modality,
        "description": "friction of a sliding finger",
        "avatar_id": 0,
        "unit_exponent": _MILLI if modality in TEMPORAL else _MICRO,
        "perception_unit_exponent": 0,
        "effect_library": [],
        "channels": [channel],
    }
    return {
        "version": "2023",
        "profile": "Main",
        "level": 1,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "description": "",
        "timescale": timescale,
        "avatars": [],
        "perceptions": [perception],
        "syncs": [],
    }


def read_hjif(path):
    """Reads what `write_hjif` wrote.

    Between key frames the texture is continued as the band-limited signal they sample. A player that draws straight
    lines, as the format says, gives the same at the key frames alone: let it run at their rate.

    Result and errors are those of `read_npz`; the dict also holds `modality`, `gain`, `key_frame_rate` (Hz, at the
    reference speed) and `samples`.
    """
    with reading(path, "a .hjif file that this package wrote", "Write the texture again."):
        experience = read_json(path, "JSON")
        found = json.loads(experience["description"])
        (perception,) = experience["perceptions"]
        (channel,) = perception["channels"]
        frames = channel["bands"][0]["effects"][0]["keyframes"]
        values = np.array([frame["amplitude_modulation"] for frame in frames]) * channel["gain"]
        rate = experience["timescale"] / (frames[1]["relative_position"] if len(frames) > 1 else 1)
        modality = perception["perception_modality"]
        metadata = from_json(found, path, "samples", *(("normal_force",) if modality == "Friction" else ()))
        check_span(len(frames) / check_number("timescale", rate, "Hz", above=0), metadata)
        if modality == "Friction":
            values = (values - mean_friction(metadata)) * metadata["normal_force"]
        metadata |= {"modality": modality, "gain": channel["gain"], "key_frame_rate": rate}
        texture = resample(values, rate, metadata["sampling_rate"], metadata["samples"], method="fourier")
        return check_read(texture, metadata)
