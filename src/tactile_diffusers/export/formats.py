"""The table of formats, and what a texture loses in a file of each."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..signal import BAND_HZ, band_edges, nine_band_error_db
from .hjif import read_hjif, write_hjif
from .lossless import read_hdf5, read_npz, write_hdf5, write_npz
from .png import read_png, write_png
from .previews import read_ahap, read_haptic, write_ahap, write_haptic
from .wav import read_wav, sidecar_path, write_wav


@dataclass(frozen=True)
class Format:
    """One way to write a texture.

    Attributes:
        suffix (`str`): of its files; no two formats share one.
        write, read (`Callable`): `write(path, texture, **about)`, with what `write_npz` takes, and `read(path)`, which
            returns the texture and a dict of the rest.
        kind (`str`): `"lossless"` (to float32 rounding), `"lossy"` (newtons come back, rounded or low-passed) or
            `"preview"` (amplitude and frequency alone).
        description (`str`): one line.
        spatial (`bool`): over position, so that the reference speed must be known.
        options (`tuple[str, ...]`): further keywords of `write`.
    """

    suffix: str
    write: Callable
    read: Callable
    kind: str
    description: str
    spatial: bool = False
    options: tuple[str, ...] = ()


_FLOAT, _PCM = partial(write_wav, subtype="FLOAT"), partial(write_wav, subtype="PCM_16")
_FRICTION, _TEXTURE = partial(write_hjif, modality="Friction"), partial(write_hjif, modality="Vibrotactile Texture")
#: Every format by its name, in the order of the documentation.
FORMATS = {
    "npz": Format(".npz", write_npz, read_npz, "lossless", "NumPy archive, float32 newtons"),
    "hdf5": Format(".h5", write_hdf5, read_hdf5, "lossless", "HDF5, float32 newtons"),
    "wav": Format(".wav", _FLOAT, read_wav, "lossless", "WAV, float32, scale in a JSON sidecar"),
    "wav16": Format(".16bit.wav", _PCM, read_wav, "lossy", "WAV, 16 bits, scale in a JSON sidecar"),
    "png": Format(
        ".friction.png",
        write_png,
        read_png,
        "lossy",
        "friction map, 8-bit grey over position, as Tanvas takes it",
        spatial=True,
        options=("pixel_pitch", "height", "normal_force"),
    ),  # fmt: skip
    "hjif": Format(".hjif", write_hjif, read_hjif, "lossy", "MPEG haptics, Force over time"),
    "hjif-friction": Format(
        ".friction.hjif",
        _FRICTION,
        read_hjif,
        "lossy",
        "MPEG haptics, Friction over position",
        spatial=True,
        options=("normal_force",),
    ),  # fmt: skip
    "hjif-texture": Format(
        ".texture.hjif", _TEXTURE, read_hjif, "lossy", "MPEG haptics, Vibrotactile Texture over position", spatial=True
    ),
    "haptic": Format(".haptic", write_haptic, read_haptic, "preview", "Meta .haptic, amplitude and frequency alone"),
    "ahap": Format(".ahap", write_ahap, read_ahap, "preview", "Apple AHAP, intensity and sharpness alone"),
}


def round_trip(path, name, texture, sampling_rate, highest_frequency=BAND_HZ[1]):
    """Reads a file and compares it with the texture that was written to it.

    Args:
        path (`str` or `Path`): the file.
        name (`str`): of its format, a key of `FORMATS`.
        texture (`np.ndarray`): (samples,), N.
        sampling_rate (`int`): Hz.
        highest_frequency (`float`, *optional*, defaults to 1000.0): what the texture itself holds, Hz.

    Returns:
        `dict`: `bytes` (with a sidecar), `bands`, how many of the nine bands the file holds in full,
        `nine_band_error_db` over these (NaN if none or the texture is too short), and `snr_db`, signal to error over
        all frequencies (infinite if both are the same).
    """
    found, metadata = FORMATS[name].read(path)
    texture = np.asarray(texture, dtype=np.float64)
    edges = band_edges()
    highest = min(highest_frequency, metadata.get("highest_frequency", BAND_HZ[1]))
    bands = int((edges[1:] <= highest * (1 + 1e-9)).sum())
    try:
        band_error = float(nine_band_error_db(found, texture, sampling_rate, edges[: bands + 1])) if bands else np.nan
    except ValueError:  # too short for bands of 11 Hz
        band_error = np.nan
    error = np.square(found - texture).sum()
    with np.errstate(divide="ignore"):
        snr = 10 * np.log10(np.square(texture).sum() / error) if error > 0 else np.inf
    size = sum(file.stat().st_size for file in (path, sidecar_path(path)) if file.is_file())
    return {"bytes": size, "bands": bands, "nine_band_error_db": band_error, "snr_db": float(snr)}
