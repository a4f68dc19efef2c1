"""Tables for people: Markdown from rows of numbers."""

import math

#: how people read the keys of the studies
LABELS = {
    "nine_band_db": "nine-band error, dB",
    "snr_db": "SNR, dB",
    "ktd": "KTD",
    "ftd": "FTD",
    "rms_mn": "RMS, mN",
    "surface_nine_band_db": "error of the surface's mean spectrum, dB",
    "level_r": "r of level",
    "log_friction_r": "r of log friction",
}


def label(key):
    """A column's heading; band keys such as "signed_20_60_db" become "20–60 Hz, dB"."""
    if key.startswith("signed_"):
        low, high = key.split("_")[1:3]
        return f"{low}–{high} Hz, dB"
    return LABELS.get(key, key)


def markdown_table(rows, digits=2):
    """Rows of a study as Markdown.

    Args:
        rows (`dict[str, dict[str, float]]`): row name -> column -> value; missing or NaN values become a dash.
        digits (`int`): after the point.

    Returns:
        `str`
    """
    columns = list(dict.fromkeys(column for row in rows.values() for column in row))

    def text(value):
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return "–"
        return f"{value:.{digits}f}" if isinstance(value, float) else str(value)

    lines = ["| | " + " | ".join(map(label, columns)) + " |", "|---" * (len(columns) + 1) + "|"]
    lines += [f"| {name} | " + " | ".join(text(row.get(c)) for c in columns) + " |" for name, row in rows.items()]
    return "\n".join(lines)
