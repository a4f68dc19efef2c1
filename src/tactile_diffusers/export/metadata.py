"""What belongs to a texture, the same in every format: checked before it is written, and as JSON there and back."""

import math

import numpy as np

from ..signal import BAND_HZ, RATING_AXES, REFERENCE_FORCE
from ..signal.checks import check_seed, check_whole_number
from .checks import check_positive_or_unknown, check_ratings, check_texture

#: Key under which a file of another's format holds what belongs to the texture, as JSON.
METADATA_KEY = "tactile_diffusers"
#: What the numbers in a file mean, for programs and people without this package; written beside them under `units`.
UNITS = {
    "texture": f"N: lateral force about its mean, band {BAND_HZ[0]:g}-{BAND_HZ[1]:g} Hz, at a normal force of "
    f"{REFERENCE_FORCE} N",
    "sampling_rate": "Hz, of the texture as it was generated",
    "friction_coefficient": "mean lateral force / mean normal force",
    "reference_speed": "mm/s: the finger's, at which the texture is felt in this time",
    "ratings": f"z-scores in the order {', '.join(RATING_AXES)}; larger = rougher, bumpier, more slippery",
}
#: What old files may lack, and what it is then.
_OPTIONAL = {"reference_speed": None, "checkpoint": None}
_NULL_IS_NAN = ("friction_coefficient", "reference_speed")


def check_arguments(texture, sampling_rate, friction_coefficient, reference_speed, ratings, seed, checkpoint):
    """The arguments that every writer takes, once they are known to be writable.

    Args:
        texture (`np.ndarray`): (samples,), N.
        sampling_rate (`int`): Hz.
        friction_coefficient (`float`): mean lateral / mean normal force; NaN = unknown.
        reference_speed (`float`): finger speed for which the texture was made, mm/s; NaN = unknown.
        ratings (`Sequence[float]`): (3,) z-scores: roughness, bumpiness, slipperiness; NaN or None = not specified.
        seed (`int`): the seed of the generator that drew the texture.
        checkpoint (`str`, *optional*): name of the checkpoint that made it; `None` = unknown.

    Returns:
        `tuple[np.ndarray, dict]`: the texture (samples,) float64, and the rest under the names of the arguments, as
        plain int, float, str and a list of three floats.

    Raises:
        ValueError: on a bad argument.
    """
    texture = check_texture(texture, sampling_rate)
    if not (checkpoint is None or isinstance(checkpoint, str)):
        raise ValueError(f"`checkpoint` must be a name, or None if unknown, got {checkpoint!r}. Give `path.name`.")
    return texture, {
        "sampling_rate": int(sampling_rate),
        "friction_coefficient": check_positive_or_unknown("friction_coefficient", friction_coefficient),
        "reference_speed": check_positive_or_unknown("reference_speed", reference_speed),
        "ratings": check_ratings(ratings).tolist(),
        "seed": check_seed(seed),
        "checkpoint": checkpoint or None,
    }


def check_read(texture, metadata):
    """The same demands on what was read: a damaged file may say anything.

    Returns:
        `tuple[np.ndarray, dict]`: the texture as float32, and `metadata` with its numbers in the types of the writers.

    Raises:
        ValueError: as `check_arguments`.
    """
    names = ("sampling_rate", "friction_coefficient", "reference_speed", "ratings", "seed", "checkpoint")
    texture, checked = check_arguments(texture, **{name: metadata[name] for name in names})
    with np.errstate(over="ignore"):
        texture = texture.astype(np.float32)
    if not np.isfinite(texture).all():
        raise ValueError("its numbers are too large for float32")
    return texture, {**metadata, **checked}


def check_span(seconds, metadata):
    """Refuses `samples` of a lossy format that do not fit what the file holds: a header that claims any number.

    Args:
        seconds (`float`): what the file holds, at the reference speed if it is over position.
        metadata (`dict`): with `samples` and `sampling_rate`.

    Raises:
        ValueError: if they differ by more than what is lost at the end: one key frame or pixel, or 10 %.
    """
    samples, rate = metadata["samples"], metadata["sampling_rate"]
    check_whole_number("samples", samples)
    if not (rate > 0 and samples / rate <= 1.1 * seconds + 0.1):
        raise ValueError(f"`samples` is {samples} at {rate} Hz, but it holds {seconds:.3g} s")


def check_known_speed(metadata):
    """The reference speed, mm/s, of what is to be written over position.

    Raises:
        ValueError: if it is unknown.
    """
    if math.isnan(metadata["reference_speed"]):
        raise ValueError(
            "`reference_speed` is unknown (NaN), so a time has no position. Give the finger's speed in mm/s, or choose "
            "a format over time."
        )
    return metadata["reference_speed"]


def mean_friction(metadata):
    """The friction coefficient about which a map varies: 0 if it is unknown."""
    return 0.0 if math.isnan(metadata["friction_coefficient"]) else metadata["friction_coefficient"]


def metadata_to_json(metadata):
    """The same with null for NaN, which JSON does not know, and with `UNITS`."""
    return {**{name: _null_if_nan(value) for name, value in metadata.items()}, "units": UNITS}


def metadata_from_json(found, where, needed=()):
    """What `metadata_to_json` gave, with NaN for null and for what old files lack.

    Args:
        found (`dict`): as read.
        where (`str` or `Path`): what the message calls it.
        needed (`Sequence[str]`): keys beyond those of every texture.

    Raises:
        ValueError: if a key is missing.
    """
    if not isinstance(found, dict):
        raise ValueError(f"{where} holds no description of a texture. Only files that this package wrote can be read.")
    always = ("sampling_rate", "friction_coefficient", "ratings", "seed", *needed)
    missing = [name for name in always if name not in found]
    if missing:
        raise ValueError(f"{where} lacks {', '.join(missing)}. Write the texture again.")
    metadata = {**_OPTIONAL, **found}
    metadata.pop("units", None)
    metadata.update({name: _nan_if_null(metadata[name]) for name in _NULL_IS_NAN})
    metadata["ratings"] = [_nan_if_null(value) for value in metadata["ratings"]]
    return metadata


def _null_if_nan(value):
    if isinstance(value, list):
        return [_null_if_nan(one) for one in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def _nan_if_null(value):
    return math.nan if value is None else value
