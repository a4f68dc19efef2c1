"""Tables for people: Markdown from rows of numbers or leaves."""

import math

from tactile_diffusers.evaluation.metrics.statistics import is_leaf


def text(value, digits=2, interval=False):
    """A number, leaf or string as people read it, a dash for None; numbers below 0.01 get three significant digits.

    With `interval` the 95 % interval of a leaf follows in brackets.
    """
    if is_leaf(value):
        bounds = value["interval"] if interval else None
        shown = f" [{text(bounds[0], digits)}, {text(bounds[1], digits)}]" if bounds else ""
        return text(value["mean"], digits) + shown
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "–"
    if isinstance(value, float):
        value = value if abs(value) >= 1e-7 else 0.0  # rounding, not a result
        return f"{value:.3g}" if 0 < abs(value) < 10**-digits else f"{value:.{digits}f}"
    return str(value)


def markdown_table(rows, digits=2, labels=None, interval=False):
    """Rows, name -> column -> number or leaf, as a Markdown table; what is missing becomes a dash.

    `labels` are the columns to show, in order, and their headings, or pairs (heading, digits after the point); all by
    default. With `interval`, leaves are followed by theirs.
    """
    if labels is None:
        labels = {column: column for row in rows.values() for column in row}
    columns = {key: (label, digits) if isinstance(label, str) else label for key, label in labels.items()}
    lines = ["| | " + " | ".join(label for label, _ in columns.values()) + " |", "|---" * (len(columns) + 1) + "|"]
    for name, row in rows.items():
        cells = [text(row.get(key), places, interval) for key, (_, places) in columns.items()]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def title(name, level):
    """A heading and the empty line after it."""
    return f"{'#' * level} {name}\n\n"
