"""What a texture loses in a file, measured by reading it back."""

import numpy as np

from ..signal import BAND_HZ, band_edges, nine_band_error_db
from .formats import FORMATS
from .wav import sidecar_path


def round_trip(path, name, texture, sampling_rate):
    """Reads a file and compares it with the texture that was written to it.

    Args:
        path (`str` or `Path`): the file.
        name (`str`): of its format, a key of `FORMATS`.
        texture (`np.ndarray`): (samples,), N.
        sampling_rate (`int`): Hz.

    Returns:
        `dict`: `bytes` (with a sidecar), `bands`, how many of the nine bands the file holds in full,
        `nine_band_error_db` over these (NaN if none or the texture is too short), and `snr_db`, signal to error over
        all frequencies (infinite if both are the same).
    """
    found, metadata = FORMATS[name].read(path)
    texture = np.asarray(texture, dtype=np.float64)
    edges = band_edges()
    highest = metadata.get("highest_frequency", BAND_HZ[1])
    bands = int((edges[1:] <= highest * (1 + 1e-9)).sum())
    try:
        band_error = float(nine_band_error_db(found, texture, sampling_rate, edges[: bands + 1])) if bands else np.nan
    except ValueError:  # too short for bands of 11 Hz
        band_error = np.nan
    error = np.square(found - texture).sum()
    with np.errstate(divide="ignore"):
        snr = 10 * np.log10(np.square(texture).sum() / error) if error > 0 else np.inf
    size = sum(file.stat().st_size for file in (path, sidecar_path(path)) if file.is_file())
    return {"bytes": size, "bands": bands, "nine_band_error_db": band_error, "snr_db": float(snr)}


def round_trip_markdown(rows):
    """A table of formats, in Markdown.

    Args:
        rows (`list[dict]`): what `round_trip` gave, with `format`; of several textures the mean is shown.

    Returns:
        `str`
    """
    lines = ["| `--formats` | file | | nine-band error | SNR | kB | |", "|---|---|---|---:|---:|---:|---|"]
    for name, form in FORMATS.items():
        chosen = [row for row in rows if row["format"] == name]
        if not chosen:
            continue
        band, snr, size = (np.mean([row[key] for row in chosen]) for key in ("nine_band_error_db", "snr_db", "bytes"))
        bands = min(row["bands"] for row in chosen)
        held = "" if bands == 9 else f" ({bands} of 9 bands)"
        band_text = "–" if np.isnan(band) else f"{_decibels(band, 3)}{held}"
        lines.append(
            f"| `{name}` | `{form.suffix}` | {form.kind} | {band_text} | {_decibels(snr, 1)} | {size / 1000:.1f} | "
            f"{form.description} |"
        )
    return "\n".join(lines)


def _decibels(value, decimals):
    return "exact" if np.isposinf(value) or (decimals == 3 and value == 0) else f"{value:.{decimals}f} dB"
