"""Textures in files of every format, and from one format to another, with what was lost on the way said."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ..signal import BAND_HZ, band_edges, nine_band_error_db
from .hjif import read_hjif, write_hjif
from .lossless import read_hdf5, read_npz, write_hdf5, write_npz
from .metadata import ABOUT
from .png import read_png, write_png
from .previews import read_ahap, read_haptic, write_ahap, write_haptic
from .wav import read_wav, sidecar_path, write_wav

#: An error so far below the texture, dB, is the rounding of float32.
EXACT_DB = 120.0


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

    def keywords(self, metadata, given):
        """Those of `write`: what a reader found, and options that were given. A map's normal force is kept."""
        known = {name: metadata[name] for name in ABOUT}
        if "normal_force" in self.options and "normal_force" in metadata:
            known["normal_force"] = metadata["normal_force"]
        return known | given


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


def format_of(path):
    """The name of the format of a file, a key of `FORMATS`, by its suffix: the longest one that fits.

    `.png` alone is a friction map; `.hjif` alone is over time.

    Raises:
        ValueError: for a suffix of none.
    """
    name = Path(path).name
    fitting = [key for key, form in FORMATS.items() if name.endswith(form.suffix)]
    if not fitting and name.endswith(".png"):
        fitting = ["png"]
    if not fitting:
        suffixes = ", ".join(form.suffix for form in FORMATS.values())
        raise ValueError(f"{path} must end in one of {suffixes}: no other format holds a texture.")
    return max(fitting, key=lambda key: len(FORMATS[key].suffix))


def read_texture(path):
    """Reads a texture from a file of any format that this package writes, with the result and errors of `read_npz`."""
    return FORMATS[format_of(path)].read(Path(path))


def convert(source, target, **options):
    """Reads a file and writes it in another format, reads that again, and says what was lost.

    Args:
        source, target (`str` or `Path`): files; their suffixes say of which formats. An existing target is replaced.
        options: further keywords of the target's writer, such as `pixel_pitch` of `write_png`. `normal_force` is by
            default that of the source where it is a map of friction.

    Returns:
        `dict`: what `round_trip` gives of the target, and `losses`, sentences: what the source's own format had lost
        before, what the target's loses, and what its writer warned of. No sentence = nothing.

    Raises:
        FileNotFoundError: if `source` or the folder of `target` does not exist.
        ValueError: for a suffix of no format, both files being the same, a file that cannot be read, or a texture that
            the target cannot hold, such as one of unknown speed over position. Nothing is written then.
    """
    source, target = Path(source), Path(target)
    names = format_of(source), format_of(target)
    before, after = (FORMATS[name] for name in names)
    if source.resolve() == target.resolve():
        raise ValueError(f"`target` must be another file than `source`, got {target} for both.")
    if unknown := sorted(set(options) - set(after.options)):
        raise ValueError(f"`{unknown[0]}` is no option of {names[1]}, which takes {list(after.options) or 'none'}.")
    texture, metadata = before.read(source)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        after.write(target, texture, **after.keywords(metadata, options))
    held = {name: metadata[name] for name in ("highest_frequency",) if name in metadata}
    row = round_trip(target, names[1], texture, metadata["sampling_rate"], **held)
    losses = [] if before.kind == "lossless" else [_earlier(source, names[0], before, metadata)]
    if after.kind == "preview":
        losses.append(f"{target.name} is a preview: the waveform and its spectrum are lost ({after.description}).")
    elif row["snr_db"] < EXACT_DB:
        losses.append(
            f"{target.name} holds {row['bands']} of 9 bands in full, to {row['nine_band_error_db']:.3f} dB; the error "
            f"lies {row['snr_db']:.1f} dB below the texture."
        )
    return {
        **row,
        "source_format": names[0],
        "format": names[1],
        "losses": losses + [str(one.message) for one in caught],
    }


def _earlier(source, name, form, metadata):
    if form.kind == "preview":
        return f"{source.name} is a preview, amplitude and frequency alone: the texture itself was lost before."
    highest = metadata.get("highest_frequency")
    beyond = f", and nothing above {highest:.0f} Hz" if highest else ""
    return f"{source.name} was rounded when it was written as {name}{beyond}: that is not undone."
