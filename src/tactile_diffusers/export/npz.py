"""NumPy archives: a texture with all that is needed to play or to make it again."""

import numpy as np

from ..data.files import atomic_path
from .checks import check_positive_or_unknown, check_ratings, check_seed, check_texture


def write_npz(path, texture, *, sampling_rate, friction_coefficient, ratings, seed, reference_speed):
    """Writes one texture to a compressed `.npz` file.

    The file holds `texture` (samples,) float32 in N, `sampling_rate` int64 in Hz, `friction_coefficient` float32,
    `ratings` (3,) float32, `seed` int64 and `reference_speed` float32 in mm/s; `np.load` reads it without pickle.

    Args:
        path (`str` or `Path`): the file; its folder must exist. An existing file is replaced as a whole.
        texture (`np.ndarray`): (samples,), N.
        sampling_rate (`int`): Hz.
        friction_coefficient (`float`): mean lateral / mean normal force; NaN = unknown.
        ratings (`Sequence[float]`): (3,) z-scores: roughness, bumpiness, slipperiness; NaN or None = not specified.
        seed (`int`): the seed of the generator that drew the texture.
        reference_speed (`float`): finger speed for which the texture was made, mm/s; NaN = unknown.

    Raises:
        ValueError: on a bad argument, before anything is written.
    """
    texture = check_texture(texture, sampling_rate)
    arrays = {
        "texture": texture.astype(np.float32),
        "sampling_rate": np.int64(sampling_rate),
        "friction_coefficient": np.float32(check_positive_or_unknown("friction_coefficient", friction_coefficient)),
        "ratings": check_ratings(ratings).astype(np.float32),
        "seed": np.asarray(check_seed(seed)),
        "reference_speed": np.float32(check_positive_or_unknown("reference_speed", reference_speed)),
    }
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, **arrays)
