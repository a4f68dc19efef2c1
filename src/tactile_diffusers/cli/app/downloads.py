"""A texture as files to take away."""

from ...export import write_figure, write_npz, write_wav
from .strip import strip_page


def _about(texture):
    return {
        "sampling_rate": texture.sampling_rate,
        "friction_coefficient": texture.friction_coefficient,
        "ratings": texture.ratings,
    }


def _npz(path, texture):
    about = {**_about(texture), "seed": texture.seed, "reference_speed": texture.reference_speed}
    write_npz(path, texture.samples, **about)


def _wav(path, texture):
    write_wav(path, texture.samples, seed=texture.seed, **_about(texture))


def _wav_float(path, texture):
    write_wav(path, texture.samples, seed=texture.seed, subtype="FLOAT", **_about(texture))


def _figure(path, texture):
    write_figure(path, texture.samples, **_about(texture))


def _strip(path, texture):
    path.write_text(strip_page(texture), encoding="utf-8")


#: Name on the page -> suffix and writer(path, texture). A format more is a line more.
FORMATS = {
    "NumPy archive, newtons (.npz)": (".npz", _npz),
    "WAV, 16 bit, with its scale in JSON (.wav)": (".wav", _wav),
    "WAV, float, with its scale in JSON (.wav)": (".wav", _wav_float),
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
