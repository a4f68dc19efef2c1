"""HDF5: one texture and all that belongs to it in one file that most laboratories can read."""

import json

import numpy as np

from ..io.hdf5 import check_sizes, open_whole, whole_file
from ..io.reading import reading
from ..signal import RATING_AXES
from .metadata import UNITS, check_read, describe_texture, from_json

FORMAT, VERSION = "tactile-texture", 1


def write_hdf5(path, texture, **about):
    """Writes one texture to an HDF5 file.

    The file holds the dataset `texture` (samples,) float32 with the attributes `rate` (Hz) and `unit` ("N"). Attributes
    of the file: `format`, `version`, `friction_coefficient`, `reference_speed` (mm/s), `ratings` (3,), `rating_axes`,
    `seed`, `units`, which says what these mean, as JSON, and, if known, `checkpoint`.

    Args:
        path (`str` or `Path`): the file; its folder must exist. An existing file is replaced as a whole.
        texture, **about: as for `write_npz`.

    Raises:
        FileNotFoundError: if the folder does not exist.
        ValueError: on a bad argument, before anything is written.
    """
    texture, metadata = describe_texture(texture, **about)
    rate = metadata.pop("sampling_rate")
    with whole_file(path) as file:
        file.attrs.update({"format": FORMAT, "version": VERSION, "rating_axes": ", ".join(RATING_AXES)})
        file.attrs["units"] = json.dumps(UNITS)
        file.attrs.update({name: value for name, value in metadata.items() if value is not None})
        file.create_dataset("texture", data=texture.astype(np.float32), compression="gzip", shuffle=True)
        file["texture"].attrs.update({"rate": rate, "unit": "N"})


def read_hdf5(path):
    """Reads what `write_hdf5` wrote.

    Args:
        path (`str` or `Path`): the file.

    Returns:
        `tuple[np.ndarray, dict]`: the texture (samples,) float32 in N, and what belongs to it as in `read_npz`.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: if it is not of this format.
    """
    with reading(path, "an HDF5 file of a texture", "Write the texture again."), open_whole(path) as file:
        check_sizes(file)
        if file.attrs.get("format") != FORMAT or "texture" not in file:
            raise ValueError(
                f"{path} is not a file of format {FORMAT}. Of a folder that examples/generate_dataset.py wrote, give "
                "the folder."
            )
        found = {name: value.tolist() if hasattr(value, "tolist") else value for name, value in file.attrs.items()}
        for name in ("format", "version", "rating_axes"):
            found.pop(name, None)
        found["sampling_rate"] = file["texture"].attrs["rate"].item()
        return check_read(file["texture"][()], from_json(found, path))
