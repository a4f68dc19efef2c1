"""What commands share that take a recording: its arguments, how it is read, how what is made of it is written."""

import math
import sys
from dataclasses import dataclass
from pathlib import Path

from ..io.argument_types import positive_number
from ..signal.constants import RATING_AXES
from .program import checkpoint_name, program, warn

#: Ratings of which nothing is known.
OPEN = (math.nan,) * len(RATING_AXES)


@dataclass(frozen=True)
class Recording:
    """What a file holds.

    Attributes:
        force (`np.ndarray`): (samples,), N, with its mean.
        rate (`float`): Hz.
        texture (`np.ndarray`): the force band-passed to 20-1000 Hz.
        friction_coefficient (`float`): NaN where the file does not tell it.
        notes (`list[str]`): how the file was understood.
    """

    force: object
    rate: float
    texture: object
    friction_coefficient: float
    notes: list


def add_recording_arguments(parser):
    """Adds the file with the lateral force, and where in it the force is."""
    kinds = "csv, xlsx, npy, npz, mat, hdf5, parquet or wav with the lateral force, or recordings.h5"
    parser.add_argument("recording_file", type=Path, metavar="FILE", help=kinds)
    parser.add_argument(
        "--column", metavar="NAME", help="of the force, by name or number from 0; default: the only possible one"
    )
    parser.add_argument(
        "--recording",
        metavar="NAME",
        help="in recordings.h5: surface/explorer/trial; in other files: the sheet, group or array; default: the first",
    )
    parser.add_argument(
        "--rate", type=float, metavar="HZ", help="sampling rate, Hz; default: the file's, or that of its time stamps"
    )
    parser.add_argument(
        "--newtons_per_unit",
        type=positive_number,
        metavar="N",
        help="N per unit of the numbers, or at full scale of a WAV; default: by the name of the column, as Fx_mN, or "
        "the sidecar of a WAV of this package; else 1",
    )


def _read_own(path):
    """Texture and metadata of a .npz or HDF5 file of this package, or of a WAV with its sidecar; `None` of others."""
    import zipfile

    from ..data.folder.tables import kind_of
    from ..data.folder.trees import open_tree
    from ..export.lossless import HDF5_FORMAT, read_hdf5, read_npz
    from ..export.wav import read_wav, sidecar_path

    if path.suffix.lower() == ".wav" and sidecar_path(path).is_file():
        return read_wav(path)
    if path.suffix.lower() == ".npz" and zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            ours = {"texture.npy", "units.npy"} <= set(archive.namelist())
        return read_npz(path) if ours else None
    if kind_of(path) == "hdf5" and open_tree(path, "hdf5").attributes.get("format") == HDF5_FORMAT:
        return read_hdf5(path)
    return None


def read_recording_file(script, arguments, quiet=True):
    """The [`Recording`] that the arguments name; prints the notes, and warns of what is too loud."""
    from ..data.folder import read_recording
    from ..data.folder.recording import LARGEST_RMS
    from ..signal import REFERENCE_FORCE, band_pass, rms

    path, scale = arguments.recording_file, arguments.newtons_per_unit
    asked = (scale, arguments.column, arguments.rate, arguments.recording)
    own = _read_own(path) if asked == (None,) * 4 else None
    if own is not None:
        force, rate, notes, friction = own[0], own[1]["sampling_rate"], [], own[1]["friction_coefficient"]
    else:
        force, rate, notes = read_recording(path, arguments.column, arguments.rate, scale, arguments.recording)
        friction = math.nan
    for note in [] if quiet else notes:
        print(f"{program(script)}: note: {note}", file=sys.stderr)
    texture = band_pass(force - force.mean(), rate)
    if rms(texture) > LARGEST_RMS:
        warn(
            script,
            f"{arguments.recording_file}: RMS {1e3 * rms(texture):.0f} mN is more than textures have at a normal force "
            f"of {REFERENCE_FORCE} N. Give --newtons_per_unit if these are not newtons.",
        )
    return Recording(force, rate, texture, friction, notes)


def write_texture(arguments, name, out, ratings=OPEN, row=0, original=None, seed=None, picture=True, axes=RATING_AXES):
    """Writes name.npz, .wav and .png of one texture of an output, says so unless `--quiet`, and returns the paths."""
    from ..export import write_figure, write_npz, write_wav
    from ..signal import rms

    arguments.output.mkdir(parents=True, exist_ok=True)
    files = [arguments.output / f"{name}{suffix}" for suffix in (".npz", ".wav", ".png")[: 3 if picture else 2]]
    texture, friction = out.textures[row], float(out.friction_coefficient[row])
    common = {"sampling_rate": out.sampling_rate, "friction_coefficient": friction, "ratings": ratings}
    origin = {"reference_speed": out.reference_speed, "checkpoint": checkpoint_name(arguments.checkpoint)}
    for write, path in zip((write_npz, write_wav), files, strict=False):
        write(path, texture, seed=arguments.seed if seed is None else seed, **origin, **common)
    if picture:
        write_figure(files[2], texture, original=original, axes=axes, **common)
    if not arguments.quiet:
        written = ", ".join(map(str, files))
        print(f"{written}: {len(texture) / out.sampling_rate:.2f} s, RMS {1e3 * rms(texture):.2f} mN", end="")
        print("" if math.isnan(friction) else f", friction coefficient {friction:.2f}")
    return files
