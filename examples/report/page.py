"""report.md: the tables of a report, put into the text of `report.jinja`."""

import re
from pathlib import Path

import jinja2

from tactile_diffusers.training.record import warning

from . import control_tables, labels, rows
from .tables import markdown_table, text

TEMPLATE = Path(__file__).parent / "report.jinja"
#: Fewer held-out surfaces than this are too few for distances between distributions.
ENOUGH_SURFACES = 5


def report_markdown(report):
    """The tables of a report as Markdown, with its pictures beside it."""
    template = jinja2.Template(TEMPLATE.read_text(encoding="utf-8"), trim_blocks=True, lstrip_blocks=True)
    rooms = {"rows": rows, "control": control_tables, "columns": labels, "table": markdown_table, "text": text}
    shown = template.render(rooms, report=report, warnings=list(_warnings(report)))
    return re.sub(r"\n{3,}", "\n\n", shown).strip() + "\n"


def _warnings(report):
    count = report["data"]["surfaces"]
    if seen := warning(report.get("seen_in_training"), count):
        yield seen
    if count < ENOUGH_SURFACES:
        yield f"too few surfaces to judge distances by ({count}): differences between them are chance"
