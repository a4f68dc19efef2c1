"""From one format to another, with what was lost on the way said."""

import warnings
from pathlib import Path

from .formats import FORMATS, round_trip
from .metadata import ABOUT

#: An error so far below the texture, dB, is the rounding of float32.
EXACT_DB = 120.0


def format_of(path):
    """The name of the format of a file, a key of `FORMATS`, by its suffix: the longest one that fits.

    `.png` alone is a friction map; `.hjif` alone is over time.

    Raises:
        ValueError: for a suffix of none.
    """
    name = Path(path).name
    fitting = [key for key, form in FORMATS.items() if name.endswith(form.suffix)]
    if not fitting and name.endswith(".png"):
        fitting = ["png"]
    if not fitting:
        suffixes = ", ".join(form.suffix for form in FORMATS.values())
        raise ValueError(f"{path} must end in one of {suffixes}: no other format holds a texture.")
    return max(fitting, key=lambda key: len(FORMATS[key].suffix))


def read_texture(path):
    """Reads a texture from a file of any format that this package writes, with the result and errors of `read_npz`."""
    return FORMATS[format_of(path)].read(Path(path))


def convert(source, target, **options):
    """Reads a file and writes it in another format, reads that again, and says what was lost.

    Args:
        source, target (`str` or `Path`): files; their suffixes say of which formats. An existing target is replaced.
        options: further keywords of the target's writer, such as `pixel_pitch` of `write_png`.

    Returns:
        `dict`: what `round_trip` gives of the target, and `losses`, sentences: what the source's own format had lost
        before, what the target's loses, and what its writer warned of. No sentence = nothing.

    Raises:
        FileNotFoundError: if `source` or the folder of `target` does not exist.
        ValueError: for a suffix of no format, both files being the same, a file that cannot be read, or a texture that
            the target cannot hold, such as one of unknown speed over position. Nothing is written then.
    """
    source, target = Path(source), Path(target)
    names = format_of(source), format_of(target)
    before, after = (FORMATS[name] for name in names)
    if source.resolve() == target.resolve():
        raise ValueError(f"`target` must be another file than `source`, got {target} for both.")
    if unknown := sorted(set(options) - set(after.options)):
        raise ValueError(f"`{unknown[0]}` is no option of {names[1]}, which takes {list(after.options) or 'none'}.")
    texture, metadata = before.read(source)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        after.write(target, texture, **{name: metadata[name] for name in ABOUT}, **options)
    held = {name: metadata[name] for name in ("highest_frequency",) if name in metadata}
    row = round_trip(target, names[1], texture, metadata["sampling_rate"], **held)
    losses = [] if before.kind == "lossless" else [_earlier(source, names[0], before, metadata)]
    if after.kind == "preview":
        losses.append(f"{target.name} is a preview: the waveform and its spectrum are lost ({after.description}).")
    elif row["snr_db"] < EXACT_DB:
        losses.append(
            f"{target.name} holds {row['bands']} of 9 bands in full, to {row['nine_band_error_db']:.3f} dB; the error "
            f"lies {row['snr_db']:.1f} dB below the texture."
        )
    return {
        **row,
        "source_format": names[0],
        "format": names[1],
        "losses": losses + [str(one.message) for one in caught],
    }


def _earlier(source, name, form, metadata):
    if form.kind == "preview":
        return f"{source.name} is a preview, amplitude and frequency alone: the texture itself was lost before."
    highest = metadata.get("highest_frequency")
    beyond = f", and nothing above {highest:.0f} Hz" if highest else ""
    return f"{source.name} was rounded when it was written as {name}{beyond}: that is not undone."
