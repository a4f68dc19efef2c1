"""Friction maps: a texture over position as an 8-bit grey picture, as displays with electroadhesion take it."""

import json
import math
import warnings

import numpy as np

from ..io.files import atomic_path
from ..io.reading import MOST_UNPACKED, check_size, reading
from ..signal import BAND_HZ, REFERENCE_FORCE, resample, rms
from ..signal.checks import check_number, check_whole_number
from ..signal.resampling import KEPT_SHARE, low_pass_for, num_samples
from .metadata import (
    METADATA_KEY,
    check_known_speed,
    check_read,
    check_span,
    describe_texture,
    from_json,
    mean_friction,
    to_json,
)

#: mm between pixels of a common electroadhesive display (Tanvas; FIELD section 4).
PIXEL_PITCH = 0.15
#: Rows of the picture, all alike: enough to see it.
HEIGHT = 64
COUNTS = 255
#: Columns of the widest picture: 2 m of texture at the pitch of the finest displays.
WIDEST = 2**16
_MM_PER_INCH = 25.4


def write_png(path, texture, *, pixel_pitch=PIXEL_PITCH, height=HEIGHT, normal_force=REFERENCE_FORCE, **about):
    """Writes one texture as a friction map: grey = friction coefficient, columns = position, rows all alike.

    The coefficient at a position is `friction_coefficient` + texture / `normal_force`; 0 is the lowest of the map and
    255 the highest, so a display that adds friction plays it on top of what its glass has by itself. Coefficient =
    `friction_at_zero` + grey value x `friction_per_count`, with these numbers, all that belongs to the texture and
    `normal_force` as JSON in the text chunk `tactile_diffusers`. If the friction coefficient is unknown, the map is of
    what varies alone, about 0.

    Pixels hold what is coarser than two pitches: at the reference speed v, frequencies below v / (2 pitch). The rest
    is filtered out, with a warning that says what is lost.

    Args:
        path, texture, **about: as for `write_npz`; the reference speed must be known.
        pixel_pitch (`float`, *optional*, defaults to 0.15): mm between pixels of the display, its width / its pixels; a
            map made for another pitch is another texture.
        height (`int`, *optional*, defaults to 64): rows.
        normal_force (`float`, *optional*, defaults to 0.5): N at which the texture was recorded.

    Raises:
        ValueError: on a bad argument, or a pitch at which nothing is left or the picture is enormous; nothing is
            written then.
    """
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    texture, metadata = describe_texture(texture, **about)
    speed = check_known_speed(metadata)
    pixel_pitch = check_number("pixel_pitch", pixel_pitch, "mm", above=0)
    normal_force = check_number("normal_force", normal_force, "N", above=0)
    height, rate = check_whole_number("height", height), metadata["sampling_rate"]
    columns = _check_width(len(texture), rate, speed, pixel_pitch)
    if columns * height > MOST_UNPACKED:  # its reader takes no larger ones: rows that are all alike take no room
        raise ValueError(
            f"`height` of {height} rows makes a picture of {columns * height:.3g} pixels; at most {MOST_UNPACKED} are "
            "written. Give fewer rows, which are all alike, or a shorter texture."
        )
    held = highest_frequency(speed, pixel_pitch)
    coarse = texture if held >= BAND_HZ[1] else low_pass_for(texture, rate, speed / pixel_pitch)
    pixels = resample(coarse, rate, speed / pixel_pitch, method="fourier")
    if held < BAND_HZ[1] and rms(texture) > 0:
        _warn_of_loss(texture, pixels, speed, pixel_pitch, held)
    friction = mean_friction(metadata) + pixels / normal_force
    lowest = float(friction.min())
    per_count = float(np.ptp(friction)) / COUNTS or 1.0  # no friction anywhere but the mean: any scale will do
    row = np.round((friction - lowest) / per_count).astype(np.uint8)

    metadata |= {"friction_at_zero": lowest, "friction_per_count": per_count, "normal_force": normal_force}
    metadata |= {"pixel_pitch": pixel_pitch, "samples": len(texture)}
    chunks = PngInfo()
    chunks.add_text(METADATA_KEY, json.dumps(to_json(metadata), allow_nan=False))
    with atomic_path(path) as temporary:
        picture = Image.fromarray(np.tile(row, (height, 1)))
        picture.save(temporary, format="PNG", pnginfo=chunks, dpi=(_MM_PER_INCH / pixel_pitch,) * 2, optimize=True)


def highest_frequency(reference_speed, pixel_pitch):
    """What pixels of this pitch (mm) hold in full at this speed (mm/s): a frequency in Hz, at most that of the band."""
    return min(KEPT_SHARE * reference_speed / (2 * pixel_pitch), BAND_HZ[1])


def _check_width(samples, sampling_rate, speed, pitch):
    """Columns; refuses pitches that no display has: nothing of the texture is left, or the picture is enormous."""
    if highest_frequency(speed, pitch) <= BAND_HZ[0]:
        raise ValueError(
            f"`pixel_pitch` of {pitch:g} mm leaves nothing of a texture, whose band begins at {BAND_HZ[0]:g} Hz: at "
            f"{speed:g} mm/s it must be below {KEPT_SHARE * speed / (2 * BAND_HZ[0]):.3g} mm."
        )
    if (columns := num_samples(samples, sampling_rate, speed / pitch)) > WIDEST:
        raise ValueError(
            f"`pixel_pitch` of {pitch:g} mm makes a picture of {columns} columns; at most {WIDEST} are written. Give "
            "the display's pitch (its width in mm / its pixels), or a shorter texture."
        )
    return columns


def _warn_of_loss(texture, pixels, speed, pitch, held):
    kept = min(1.0, float(rms(pixels) / rms(texture)) ** 2)
    finest = math.floor(1e4 * KEPT_SHARE * speed / (2 * BAND_HZ[1])) / 1e4
    message = (
        f"Pixels {pitch:g} mm apart hold what is felt below {held:.0f} Hz at {speed:.3g} mm/s: {held:.0f}-"
        f"{BAND_HZ[1]:.0f} Hz is lost, {100 * (1 - kept):.1f} % of the texture's power. Only a display with pixels "
        f"of at most {finest:g} mm would hold all."
    )
    warnings.warn(message, UserWarning, stacklevel=3)


def read_png(path):
    """Reads what `write_png` wrote: its first row.

    Result and errors are those of `read_npz`, the texture as felt at the reference speed; the dict also holds
    `friction_at_zero`, `friction_per_count`, `normal_force` (N), `pixel_pitch` (mm), `samples` and `highest_frequency`,
    what the pixels hold in full, Hz.
    """
    from PIL import Image

    with reading(path, "a friction map that this package wrote", "Write the texture again."):
        with Image.open(path, formats=["PNG"]) as picture:
            if (picture.mode, picture.info.get(METADATA_KEY) is None) != ("L", False):
                raise ValueError("its scale in newtons is unknown")
            check_size(path, picture.width * picture.height)
            row, text = np.asarray(picture)[0], picture.info[METADATA_KEY]
        needed = ("friction_at_zero", "friction_per_count", "normal_force", "pixel_pitch", "samples", "reference_speed")
        metadata = from_json(json.loads(text), path, *needed)
        friction = metadata["friction_at_zero"] + row * metadata["friction_per_count"]
        speed, pitch = check_known_speed(metadata), check_number("pixel_pitch", metadata["pixel_pitch"], "mm", above=0)
        check_span(len(row) * pitch / speed, metadata)
        metadata["highest_frequency"] = highest_frequency(speed, pitch)
        newtons = (friction - mean_friction(metadata)) * metadata["normal_force"]
        texture = resample(newtons, speed / pitch, metadata["sampling_rate"], metadata["samples"], method="fourier")
        return check_read(texture, metadata)
