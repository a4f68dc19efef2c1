"""What is stored with a texture in every format: checked before it is written, and as JSON there and back."""

import math

import numpy as np

from ..signal import BAND_HZ, RATING_AXES, REFERENCE_FORCE
from ..signal.checks import check_number, check_samples, check_seed, check_whole_number

#: Key under which a file of another's format holds what is stored with the texture, as JSON.
METADATA_KEY = "tactile_diffusers"
#: More ratings are no ratings of one texture.
MOST_AXES = 32
#: What the numbers in a file mean, for programs and people without this package; written beside them under `units`.
UNITS = {
    "texture": f"N: lateral force about its mean, band {BAND_HZ[0]:g}-{BAND_HZ[1]:g} Hz, at a normal force of "
    f"{REFERENCE_FORCE} N",
    "sampling_rate": "Hz, of the texture as it was generated",
    "friction_coefficient": "mean lateral force / mean normal force",
    "reference_speed": "mm/s: the finger's, at which the texture is felt in this time",
    "ratings": f"z-scores in the order {', '.join(RATING_AXES)}; larger = rougher, bumpier, more slippery; then "
    "those of the checkpoint's further axes",
}
#: The seed of a texture that was recorded, where a file cannot hold `None`.
NO_SEED = -1
# of float64: a texture that was scaled to full scale may be above it by this much, far less than half a count
_ROUNDING = 1e-9
#: What is stored with a texture in every format.
ABOUT = ("sampling_rate", "friction_coefficient", "reference_speed", "ratings", "seed", "checkpoint")


def describe_texture(
    texture, *, sampling_rate, friction_coefficient, ratings, seed, reference_speed=math.nan, checkpoint=None
):
    """The arguments that every writer takes, checked; what they are stands at `write_npz`.

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
        "seed": None if seed is None else check_seed(seed),
        "checkpoint": checkpoint or None,
    }


def without_none(metadata):
    """The same for files that cannot hold `None`: no checkpoint is "", no seed `NO_SEED`."""
    seed = NO_SEED if metadata["seed"] is None else metadata["seed"]
    return metadata | {"checkpoint": metadata["checkpoint"] or "", "seed": seed}


def check_texture(texture, sampling_rate):
    """One row of finite numbers as (samples,) float64; refuses a rate that is no whole number of Hz above 0."""
    texture = check_samples("texture", texture)
    if check_number("sampling_rate", sampling_rate, "Hz", above=0) % 1:
        raise ValueError(f"`sampling_rate` must be a whole number of Hz, got {sampling_rate}.")
    return texture


def check_ratings(ratings):
    """Ratings (axes,) float64, those of `RATING_AXES` and a checkpoint's further ones, NaN = not specified."""
    try:
        found = np.array([math.nan if value is None else float(value) for value in ratings])
    except (TypeError, ValueError, OverflowError):
        found = np.empty(0)
    if not len(RATING_AXES) <= len(found) <= MOST_AXES or np.isinf(found).any():
        raise ValueError(
            f"`ratings` must be {len(RATING_AXES)} numbers, {', '.join(RATING_AXES)}, and those of a checkpoint's "
            f"further axes, at most {MOST_AXES}, got {ratings!r}. "
            "Give NaN for an axis that is not specified."
        )
    return found


def check_positive_or_unknown(name, value):
    """A float above zero, or NaN for a quantity that was not measured; refuses all else by `name`."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.inf
    if not (math.isnan(number) or 0 < number < math.inf):
        raise ValueError(f"`{name}` must be above zero, or NaN if unknown, got {value!r}.")
    return number


def full_scale_of(peak, full_scale):
    """N of full scale: what was given, or the peak; refuses one below the peak."""
    if full_scale is None:
        return float(peak) or 1.0  # silence: any scale will do
    scale = check_number("full_scale", full_scale, "N", above=0)
    if not peak <= scale * (1 + _ROUNDING):
        raise ValueError(
            f"`texture` peaks at {peak:g} N, above `full_scale` of {scale:g} N, and would be clipped. Attenuate all "
            "textures that belong together, or give a larger full scale."
        )
    return scale


def check_read(texture, metadata):
    """The same checks of what a file holds: the texture as float32, and `metadata` with plain numbers."""
    texture, checked = describe_texture(texture, **{name: metadata[name] for name in ABOUT})
    with np.errstate(over="ignore"):
        texture = texture.astype(np.float32)
    if not np.isfinite(texture).all():
        raise ValueError("its numbers are too large for float32")
    return texture, {**metadata, **checked}


def check_span(seconds, metadata):
    """Refuses `samples` that do not fit the seconds of contents, but for 10 % and 0.1 s: headers may claim anything."""
    samples, rate = metadata["samples"], metadata["sampling_rate"]
    check_whole_number("samples", samples)
    if not (rate > 0 and samples / rate <= 1.1 * seconds + 0.1):
        raise ValueError(f"`samples` is {samples} at {rate} Hz, but it holds {seconds:.3g} s")


def check_known_speed(metadata):
    """The reference speed, mm/s, for a format over position; refuses an unknown one."""
    if math.isnan(metadata["reference_speed"]):
        raise ValueError(
            "`reference_speed` is unknown (NaN), so a time has no position. Give the finger's speed in mm/s, or choose "
            "a format over time."
        )
    return metadata["reference_speed"]


def mean_friction(metadata):
    """The friction coefficient about which a map varies: 0 if it is unknown."""
    return 0.0 if math.isnan(metadata["friction_coefficient"]) else metadata["friction_coefficient"]


def to_json(metadata):
    """The same with null for NaN, which JSON does not know, and with `UNITS`."""
    return {**{name: _null_if_nan(value) for name, value in metadata.items()}, "units": UNITS}


def from_json(stored, path, *needed):
    """The inverse of `to_json`; refuses a file that lacks keys of every texture, or `needed` ones."""
    if not isinstance(stored, dict):
        raise ValueError(f"{path} holds no description of a texture. Only files that this package wrote can be read.")
    missing = [name for name in (*ABOUT, *needed) if name not in stored]
    if missing:
        raise ValueError(f"{path} lacks {', '.join(missing)}. Write the texture again.")
    metadata = {name: value for name, value in stored.items() if name != "units"}
    for name in ("friction_coefficient", "reference_speed"):
        metadata[name] = _nan_if_null(metadata[name])
    metadata["ratings"] = [_nan_if_null(value) for value in metadata["ratings"]]
    metadata["seed"] = None if metadata["seed"] == NO_SEED else metadata["seed"]
    return metadata


def _null_if_nan(value):
    if isinstance(value, list):
        return [_null_if_nan(one) for one in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def _nan_if_null(value):
    return math.nan if value is None else value
