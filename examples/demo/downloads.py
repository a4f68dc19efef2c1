"""A texture as files to take away."""

import threading
import warnings
from functools import partial

import numpy as np
from strip import strip_page

from tactile_diffusers import export
from tactile_diffusers.signal.checks import check_number

#: Where Python keeps what is done with warnings, there is one for all threads.
_WARNINGS = threading.Lock()


def _about(texture):
    return {
        "sampling_rate": texture.sampling_rate,
        "friction_coefficient": texture.friction_coefficient,
        "ratings": texture.ratings,
    }


def _format(write, path, texture, **options):
    made = {"seed": texture.seed, "reference_speed": texture.reference_speed, "checkpoint": texture.checkpoint}
    write(path, texture.samples, **made, **_about(texture), **options)


def _figure(path, texture):
    export.write_figure(path, texture.samples, **_about(texture))


def _strip(path, texture):
    path.write_text(strip_page(texture), encoding="utf-8")


#: Name on the page -> suffix and writer(path, texture).
FORMATS = {
    **{
        f"{one.description} ({one.suffix})": (one.suffix, partial(_format, one.write))
        for one in export.FORMATS.values()
    },
    "picture (.png)": (".png", _figure),
    "finger strip, a page that works alone (.html)": (".html", _strip),
}


_MAPS = [name for name, (suffix, _) in FORMATS.items() if suffix == export.FORMATS["png"].suffix]


def is_map(name):
    """Whether a format, of `FORMATS`, is a picture whose pixels have a pitch."""
    return name in _MAPS


def write_files(texture, name, folder, pixel_pitch):
    """Writes a texture in one format.

    Args:
        texture ([`Texture`]): what is written.
        name (`str`): of `FORMATS`.
        folder (`Path`): empty; file names are ours, whatever the request.
        pixel_pitch (`float`): mm, for a friction map; others ignore it.

    Returns:
        `tuple[list[Path], list[str]]`: the files, and what their writer warns of.

    Raises:
        ValueError: for an unknown format, or a pitch that no display has.
    """
    if name not in FORMATS:
        raise ValueError(f"The format must be one of {list(FORMATS)}, got {name!r}.")
    suffix, write = FORMATS[name]
    options = {}
    if is_map(name):
        check_number("pixel pitch", pixel_pitch, "mm", above=0)
        options["pixel_pitch"] = float(pixel_pitch)
    with _WARNINGS, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        write(folder / f"{_stem(texture)}{suffix}", texture, **options)
    # the writers' own, which point here; another thread may warn meanwhile
    told = [str(warning.message) for warning in caught if warning.filename == __file__]
    return sorted(folder.iterdir()), told


def _stem(texture):
    """A name that tells textures apart, of letters, digits, ".", "_" and "-": "texture_0.90_0.50_any_seed1"."""
    parts = (f"{np.round(value, 2) + 0.0:.2f}" if np.isfinite(value) else "any" for value in texture.ratings)
    return f"texture_{'_'.join(parts)}_seed{'-none' if texture.seed is None else texture.seed}"
