"""A texture as files to take away."""

from functools import partial

from ... import export
from .strip import strip_page


def _about(texture):
    return {
        "sampling_rate": texture.sampling_rate,
        "friction_coefficient": texture.friction_coefficient,
        "ratings": texture.ratings,
    }


def _format(write, path, texture):
    write(path, texture.samples, seed=texture.seed, reference_speed=texture.reference_speed, **_about(texture))


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


def write_files(texture, name, folder):
    """Writes a texture in one format.

    Args:
        texture ([`Texture`]): what is written.
        name (`str`): of `FORMATS`.
        folder (`Path`): empty; file names are ours, whatever the request.

    Returns:
        `list[Path]`: of the files.

    Raises:
        ValueError: for an unknown format.
    """
    if name not in FORMATS:
        raise ValueError(f"The format must be one of {list(FORMATS)}, got {name!r}.")
    suffix, write = FORMATS[name]
    write(folder / f"texture{suffix}", texture)
    return sorted(folder.iterdir())
