"""Tables for people: Markdown from rows of numbers."""

import math


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

    lines = ["| | " + " | ".join(columns) + " |", "|---" * (len(columns) + 1) + "|"]
    lines += [f"| {name} | " + " | ".join(text(row.get(c)) for c in columns) + " |" for name, row in rows.items()]
    return "\n".join(lines)
