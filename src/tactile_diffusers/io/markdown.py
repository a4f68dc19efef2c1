"""Tables of reports and cards."""


def table(header, rows, align="---:"):
    """A Markdown table; the first column is left-aligned text, None becomes a dash."""
    lines = ["| " + " | ".join(header) + " |", "|---" + f"|{align}" * (len(header) - 1) + "|"]
    return "\n".join(lines + ["| " + " | ".join(_cell(value) for value in row) + " |" for row in rows])


def _cell(value):
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.2f}" if abs(value) >= 0.1 or value == 0 else f"{value:.2g}"
    return str(value).replace("|", "\\|").replace("\n", " ")
