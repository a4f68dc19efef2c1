"""NumPy archives and HDF5: float32 newtons, with all that is needed to play or generate the texture again."""

import json

import numpy as np

from ..io.files import atomic_path
from ..io.hdf5 import check_sizes, open_whole, whole_file
from ..io.reading import check_archive, reading
from ..signal import RATING_AXES
from .metadata import UNITS, check_read, describe_texture, from_json, without_none

HDF5_FORMAT, HDF5_VERSION = "tactile-texture", 1


def write_npz(path, texture, **about):
    """Writes one texture to a compressed `.npz` file.

    The file holds `texture` (samples,) float32 in N, `sampling_rate` int64 in Hz, `friction_coefficient` float32,
    `ratings` (3,) float32, `seed` int64, `reference_speed` float32 in mm/s, `checkpoint`, a string, empty if
    unknown, and `units`, which says what they mean, as JSON; `np.load` reads it without pickle.

    Args:
        path (`str` or `Path`): the file; its folder must exist. An existing file is replaced as a whole.
        texture (`np.ndarray`): (samples,), N.
        **about: what is stored with the texture, in this and every other format:
            sampling_rate (`int`): Hz.
            friction_coefficient (`float`): mean lateral / mean normal force; NaN = unknown.
            ratings (`Sequence[float]`): (3,) z-scores: roughness, bumpiness, slipperiness; NaN or None = not specified.
            seed (`int`): of the generator that drew the noise; `None` = unknown, or it was recorded. Stored as -1.
            reference_speed (`float`, *optional*): finger speed at which the texture is felt in this time, mm/s; NaN,
                the default, = unknown.
            checkpoint (`str`, *optional*): name of the checkpoint that generated it; `None` = unknown.

    Raises:
        FileNotFoundError: if the folder does not exist.
        ValueError: on a bad argument, before anything is written.
    """
    texture, metadata = describe_texture(texture, **about)
    metadata = without_none(metadata)
    arrays = {
        "texture": texture.astype(np.float32),
        "sampling_rate": np.int64(metadata["sampling_rate"]),
        "friction_coefficient": np.float32(metadata["friction_coefficient"]),
        "ratings": np.float32(metadata["ratings"]),
        "seed": np.asarray(metadata["seed"]),
        "reference_speed": np.float32(metadata["reference_speed"]),
        "checkpoint": np.asarray(metadata["checkpoint"]),
        "units": np.asarray(json.dumps(UNITS)),
    }
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, **arrays)


def read_npz(path):
    """Reads what `write_npz` wrote.

    Args:
        path (`str` or `Path`): the file.

    Returns:
        `tuple[np.ndarray, dict]`: the texture (samples,) float32 in N, and `sampling_rate`, `friction_coefficient`,
        `ratings`, `seed`, `reference_speed` and `checkpoint`; NaN or `None` = unknown.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: if it is no archive of a texture.
    """
    with reading(path, "a NumPy archive of a texture", "Write the texture again."):
        check_archive(path)
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
        if "texture" not in arrays:
            raise ValueError(f"{path} lacks texture. Write the texture again.")
        texture = arrays.pop("texture")
        metadata = from_json({name: value.tolist() for name, value in arrays.items()}, path)
        return check_read(texture, metadata)


def write_hdf5(path, texture, **about):
    """Writes one texture to an HDF5 file; arguments and errors are those of `write_npz`.

    The file holds the dataset `texture` (samples,) float32 with the attributes `rate` (Hz) and `unit` ("N"). Attributes
    of the file: `format`, `version`, `friction_coefficient`, `reference_speed` (mm/s), `ratings` (3,), `rating_axes`,
    `seed`, `checkpoint`, empty if unknown, and `units`, which says what these mean, as JSON.
    """
    texture, metadata = describe_texture(texture, **about)
    rate = metadata.pop("sampling_rate")
    with whole_file(path) as file:
        file.attrs.update({"format": HDF5_FORMAT, "version": HDF5_VERSION, "rating_axes": ", ".join(RATING_AXES)})
        file.attrs["units"] = json.dumps(UNITS)
        file.attrs.update(without_none(metadata))
        file.create_dataset("texture", data=texture.astype(np.float32), compression="gzip", shuffle=True)
        file["texture"].attrs.update({"rate": rate, "unit": "N"})


def read_hdf5(path):
    """Reads what `write_hdf5` wrote, with the result and errors of `read_npz`."""
    with reading(path, "an HDF5 file of a texture", "Write the texture again."), open_whole(path) as file:
        check_sizes(file)
        if file.attrs.get("format") != HDF5_FORMAT or "texture" not in file:
            raise ValueError(f"{path} is not a file of format {HDF5_FORMAT}.")
        found = {name: value.tolist() if hasattr(value, "tolist") else value for name, value in file.attrs.items()}
        for name in ("format", "version", "rating_axes"):
            found.pop(name, None)
        found["sampling_rate"] = file["texture"].attrs["rate"].item()
        return check_read(file["texture"][()], from_json(found, path))
