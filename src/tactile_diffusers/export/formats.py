"""The table of formats, for the command and the documentation."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from .ahap import read_ahap, write_ahap
from .haptic import read_haptic, write_haptic
from .hdf5 import read_hdf5, write_hdf5
from .hjif import read_hjif, write_hjif
from .npz import read_npz, write_npz
from .png import read_png, write_png
from .wav import read_wav, write_wav


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


#: Every format by its name, in the order of the documentation.
FORMATS = {
    "npz": Format(".npz", write_npz, read_npz, "lossless", "NumPy archive, float32 newtons"),
    "hdf5": Format(".h5", write_hdf5, read_hdf5, "lossless", "HDF5, float32 newtons"),
    "wav": Format(
        ".wav", partial(write_wav, subtype="FLOAT"), read_wav, "lossless", "WAV, float32, scale in a JSON sidecar"
    ),
    "wav16": Format(
        ".16bit.wav", partial(write_wav, subtype="PCM_16"), read_wav, "lossy", "WAV, 16 bits, scale in a JSON sidecar"
    ),
    "png": Format(
        ".friction.png",
        write_png,
        read_png,
        "lossy",
        "friction map, 8-bit grey over position, as Tanvas takes it",
        spatial=True,
        options=("pixel_pitch", "height", "normal_force"),
    ),
    "hjif": Format(".hjif", write_hjif, read_hjif, "lossy", "MPEG haptics, Force over time"),
    "hjif-friction": Format(
        ".friction.hjif",
        partial(write_hjif, modality="Friction"),
        read_hjif,
        "lossy",
        "MPEG haptics, Friction over position",
        spatial=True,
        options=("normal_force",),
    ),
    "hjif-texture": Format(
        ".texture.hjif",
        partial(write_hjif, modality="Vibrotactile Texture"),
        read_hjif,
        "lossy",
        "MPEG haptics, Vibrotactile Texture over position",
        spatial=True,
    ),
    "haptic": Format(".haptic", write_haptic, read_haptic, "preview", "Meta .haptic, amplitude and frequency alone"),
    "ahap": Format(".ahap", write_ahap, read_ahap, "preview", "Apple AHAP, intensity and sharpness alone"),
}
