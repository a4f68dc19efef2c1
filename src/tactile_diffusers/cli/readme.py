"""Measured results in a README: written by the commands that measure, between two markers, never by hand."""

import shutil
from pathlib import Path

from ..io.files import atomic_path, write_text


def markers(name):
    """The lines between which results of this name are written."""
    return f"<!-- begin {name} -->", f"<!-- end {name} -->"


def add_arguments(parser, name):
    """Adds `--readme` and `--readme-name` (default `name`; `None` = the command sets it) to a command."""
    parser.add_argument("--readme", type=Path, metavar="README.md", help="write the results into this file too")
    parser.add_argument("--readme-name", default=name, metavar="NAME", help="of the markers there")


def check_arguments(parser, arguments):
    """Refuses, before any work, a README without the markers.

    Raises:
        SystemExit: with exit code 2 and the lines that are missing.
    """
    if arguments.readme is None:
        return
    begin, end = markers(arguments.readme_name)
    lines = arguments.readme.read_text(encoding="utf-8") if arguments.readme.is_file() else ""
    if not -1 < lines.find(begin) < lines.find(end):
        parser.error(f"argument --readme: {arguments.readme} must hold the lines {begin!r} and {end!r}")


def write_between(path, name, text):
    """Replaces what is between the markers of `name`; the rest of the file stays as it is."""
    begin, end = markers(name)
    lines = path.read_text(encoding="utf-8")
    head, tail = lines[: lines.index(begin) + len(begin)], lines[lines.index(end) :]
    write_text(path, f"{head}\n\n{text.strip()}\n\n{tail}")


def results_folder(name):
    """Where a README keeps the results of this name, relative to it."""
    return Path("examples") / "results" / name


def copy_results(source, target, names=("*.png", "*.json", "report.md")):
    """Copies the files of a report that a README shows or links to into a folder of the repository."""
    target.mkdir(parents=True, exist_ok=True)
    for pattern in names:
        for path in source.glob(pattern):
            with atomic_path(target / path.name) as temporary:
                shutil.copyfile(path, temporary)
