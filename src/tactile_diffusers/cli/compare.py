"""`python examples/compare.py`: reports of `evaluate.py` side by side, as one table and pictures."""

from pathlib import Path

from ..io.reading import read_json, reading
from .program import Parser, add_output_argument, program, refuse


def parse_arguments(argv=None):
    """Arguments of the command.

    Raises:
        SystemExit: on bad arguments, with exit code 2 and a line that says what is wrong.
    """
    parser = Parser(
        prog=program("compare.py"),
        description="Compare reports of evaluate.py on the same held-out surfaces: the effect of ratings in each.",
    )
    parser.add_argument(
        "--report",
        nargs="+",
        required=True,
        metavar="NAME=FOLDER",
        help="output folders of evaluate.py with the sections control and generation, called by these names",
    )
    add_output_argument(parser, "report.md and pictures")
    arguments = parser.parse_args(argv)
    arguments.report = dict(_named(parser, item) for item in arguments.report)
    return arguments


def _named(parser, item):
    name, _, folder = item.partition("=")
    if not (name and folder):
        parser.error(f"argument --report: {item!r} must be NAME=FOLDER")
    path = Path(folder) / "report.json"
    if not path.is_file():
        parser.error(f"argument --report: {path} is not a file; write one with examples/evaluate.py")
    return name, path


def read_report(path):
    """A report.json that can be compared.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: if it is damaged, or lacks a section.
    """
    from ..evaluation.comparison import check_report

    with reading(path, "a report to compare", "Run examples/evaluate.py again."):
        report = read_json(path, "JSON")
        check_report(report)
    return report


def main(argv=None):
    """Runs the command.

    Returns:
        `int`: 0, or 2 if a report was refused (one line on stderr, and nothing written).
    """
    arguments = parse_arguments(argv)
    from ..evaluation.comparison import comparison_markdown, plot_axis_spectra
    from ..io.files import write_text

    try:
        reports = {name: read_report(path) for name, path in arguments.report.items()}
        text = comparison_markdown(reports)
    except ValueError as error:
        return refuse("compare.py", error)
    arguments.output.mkdir(parents=True, exist_ok=True)
    plot_axis_spectra(reports, arguments.output / "axes.png")
    write_text(arguments.output / "report.md", text)
    print(text)
    return 0
