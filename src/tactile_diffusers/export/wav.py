"""WAV files with a JSON sidecar that turns their numbers back into newtons."""

import json
from pathlib import Path

import numpy as np

from ..io.files import atomic_path
from ..io.reading import check_wav, read_json, reading
from ..signal.checks import check_number
from .metadata import check_read, describe_texture, from_json, full_scale_of, to_json

#: Counts of full scale in a 16-bit file; the largest positive count is one less.
FULL_SCALE_COUNTS = 2**15


def sidecar_path(path):
    """Path of the JSON file that belongs to a WAV file: `texture.wav` has `texture.wav.json`."""
    return Path(f"{path}.json")


def write_with_sidecar(path, samples, sampling_rate, subtype, sidecar):
    """Writes samples as they are to a WAV file, and a dict to its sidecar: both or, on an error, neither."""
    import soundfile

    with atomic_path(sidecar_path(path)) as temporary_json, atomic_path(path) as temporary_wav:
        soundfile.write(temporary_wav, samples, sampling_rate, subtype=subtype, format="WAV")
        temporary_json.write_text(json.dumps(sidecar, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def write_wav(path, texture, *, subtype="PCM_16", full_scale=None, further=None, **about):
    """Writes one texture to a mono WAV file, by default so that its peak is full scale, and the scale to the sidecar.

    Any reader that gives samples in [-1, 1] gives newtons when these are multiplied by the sidecar's
    `newtons_per_full_scale`: to half a count, 2^-16 of the scale, for `"PCM_16"`; to float32 rounding for `"FLOAT"`.
    The sidecar also holds `unit`, `sampling_rate`, `friction_coefficient`, `reference_speed`, `ratings`, `seed` and
    `checkpoint`; null = unknown.

    Args:
        path, texture, **about: as for `write_npz`.
        subtype (`str`, *optional*, defaults to `"PCM_16"`): `"PCM_16"` or `"FLOAT"`, soundfile's names.
        full_scale (`float`, *optional*): N that are full scale, one for files that belong together; by default the
            texture's peak.
        further (`dict`, *optional*): what else the sidecar says.

    Raises:
        ValueError: on a bad argument, or a texture that peaks above `full_scale`, before anything is written.
    """
    texture, metadata = describe_texture(texture, **about)
    if subtype not in ("PCM_16", "FLOAT"):
        raise ValueError(f'`subtype` must be "PCM_16" or "FLOAT", got {subtype!r}.')
    scale = full_scale_of(np.abs(texture).max(), full_scale) * FULL_SCALE_COUNTS / (FULL_SCALE_COUNTS - 1)
    sidecar = {"newtons_per_full_scale": scale, "unit": "N", **to_json(metadata), **(further or {})}
    if subtype == "PCM_16":
        # quantised here: libsndfile multiplies by 32767 when writing and divides by 32768 when reading
        samples = np.round(texture / scale * FULL_SCALE_COUNTS).astype(np.int16)
    else:
        samples = (texture / scale).astype(np.float32)
    write_with_sidecar(path, samples, metadata["sampling_rate"], subtype, sidecar)


def read_wav(path):
    """Reads what `write_wav` wrote, with the result and errors of `read_npz`.

    A `FileNotFoundError` also if the sidecar is missing, a `ValueError` if it lacks the scale or has another rate.
    """
    import soundfile

    side = sidecar_path(path)
    if not side.is_file():
        raise FileNotFoundError(f"{side}, which holds the scale of {path} in newtons, does not exist.")
    with reading(side, "a JSON file that belongs to a WAV file", "Write the texture again."):
        sidecar = read_json(side, "JSON")
        metadata = from_json(sidecar, side, "newtons_per_full_scale")
        scale = check_number("newtons_per_full_scale", metadata["newtons_per_full_scale"], "N", above=0)
        metadata = check_read(np.zeros(1), metadata)[1]
    with reading(path, "a WAV file", "Write the texture again."):
        with open(path, "rb") as file:
            check_wav(file)
        samples, sampling_rate = soundfile.read(path, dtype="float64")
        if sampling_rate != metadata["sampling_rate"]:
            raise ValueError(
                f"{path} has {sampling_rate} Hz, but its sidecar says {metadata['sampling_rate']} Hz: "
                "they do not belong together. Write the texture again."
            )
        return check_read(samples * scale, metadata)
