"""`python examples/compare.py`: reports of `evaluate.py` side by side, as one table and pictures."""

import argparse
from pathlib import Path

from ..io.reading import read_json, reading
from .program import Parser, add_output_argument, command, program


def parse_arguments(argv=None):
    """Arguments of the command, with `report` as a dict: name -> path of report.json."""
    parser = Parser(
        prog=program("compare.py"),
        description="Compare reports of evaluate.py on the same held-out surfaces: the effect of ratings in each.",
    )
    parser.add_argument(
        "--report",
        nargs="+",
        required=True,
        metavar="NAME=FOLDER",
        type=_named,
        help="output folders of evaluate.py with the sections control and generation, called by these names",
    )
    add_output_argument(parser, "report.md and pictures")
    arguments = parser.parse_args(argv)
    arguments.report = dict(arguments.report)
    return arguments


def _named(item):
    name, _, folder = item.partition("=")
    if not (name and folder):
        raise argparse.ArgumentTypeError(f"{item!r} must be NAME=FOLDER")
    path = Path(folder) / "report.json"
    if not path.is_file():
        raise argparse.ArgumentTypeError(f"{path} is not a file; write one with examples/evaluate.py")
    return name, path


def read_report(path):
    """A report.json that can be compared; a `ValueError` if it is damaged, or lacks a section."""
    from ..evaluation.comparison import check_report

    with reading(path, "a report to compare", "Run examples/evaluate.py again."):
        report = read_json(path, "JSON")
        check_report(report)
    return report


@command("compare.py")
def main(argv=None):
    """Runs the command."""
    arguments = parse_arguments(argv)
    from ..evaluation.comparison import comparison_markdown, spectra_of
    from ..evaluation.report_figures import plot_axis_spectra
    from ..io.files import write_text

    reports = {name: read_report(path) for name, path in arguments.report.items()}
    text = comparison_markdown(reports)
    arguments.output.mkdir(parents=True, exist_ok=True)
    if len(spectra := spectra_of(reports)) > 1:
        plot_axis_spectra(spectra, arguments.output / "axes.png")
    write_text(arguments.output / "report.md", text)
    print(text)
