"""Reports of `evaluate.py` side by side, as one table and pictures.

python examples/compare.py --report ours=report paper=report_paper --output beside
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from report.control_tables import matrix_difference, share_right
from report.figures import band_centre, plot_axis_spectra
from report.labels import default_guidance
from report.rows import latent_shift
from report.tables import markdown_table

from tactile_diffusers.cli.program import Parser, add_output_argument, command
from tactile_diffusers.io.files import write_text
from tactile_diffusers.io.reading import read_json, reading

#: Headings and digits of the table.
_LABELS = {
    "surfaces": ("training surfaces", 0),
    "alpha": "Cronbach's alpha of ratings",
    "changes": "changes as between real surfaces",
    "matrix": "response matrix, largest difference from real",
    "diagonal": "its diagonal",
    "diagonal_real": "that of real segments",
    "nine_band_db": "unseen surfaces, dB",
    "ridge": "ridge regression, same data",
    "ktd_excess": "KTD over real",
    "ftd_excess": "FTD over real",
    "diversity_of_rating": "diversity over that of real textures of such ratings",
    "shift": "latent shift at ±2, %",
}


def parse_arguments(argv=None):
    """Arguments of the command, with `report` as a dict: name -> path of report.json."""
    parser = Parser(
        prog="compare.py",
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


def comparison_markdown(reports):
    """A table of reports, name -> report.json, and a link to the picture.

    A ValueError if one lacks the sections control or generation, or they are of different held-out surfaces.
    """
    for name, report in reports.items():
        if not (report.get("control") and report.get("generation")):
            raise ValueError(f"The report {name!r} has no sections control and generation: evaluate them.")
    # data sets of the same surfaces whose raters agree more, or less, have other names
    facts = {tuple(r["data"][key] for key in ("split", "surfaces", "segments")) for r in reports.values()}
    if len(facts) > 1:
        raise ValueError(f"The reports are of different held-out surfaces: {sorted(facts)}. Evaluate on the same data.")
    if len(versions := {report["data"].get("embedding_version", 1) for report in reports.values()}) > 1:
        raise ValueError(f"The reports have distances of different embeddings, versions {versions}: evaluate again.")
    split, surfaces, segments = facts.pop()
    data = "`, `".join(sorted({report["data"]["name"] for report in reports.values()}))
    machines = sorted({f"{r['machine']['processor']}, {r['machine']['threads']} thread(s)" for r in reports.values()})
    note = (
        f"{segments} segments of {surfaces} {split} surfaces of `{data}` ({'; '.join(machines)}), default guidance. A "
        "change is right within 20 % of that between real surfaces with such ratings, or within its 95 % interval. "
        "Diagonals and alpha: roughness, bumpiness, slipperiness."
    )
    parts = [note, markdown_table({name: report_row(report) for name, report in reports.items()}, labels=_LABELS)]
    if len(spectra_of(reports)) > 1:
        parts.append("![spectra over one axis at a time](axes.png)")
    return "\n\n".join(parts) + "\n"


def check_report(report):
    """Raises a ValueError, KeyError, TypeError or AttributeError if no table or picture can be made of a report."""
    comparison_markdown({"one": report})
    for axes in spectra_of({"one": report}).values():
        for axis, swept in axes.items():
            for value, bands in swept.items():
                numbers = [float(value), *map(band_centre, bands)]
                numbers += [leaf["mean"] for leaf in bands.values() if leaf["mean"] is not None]
                if not np.isfinite(numbers).all():
                    raise ValueError(f"the spectra over {axis} hold what is no number")


def report_row(report):
    """The row of a report: column of the table -> text, number or leaf."""
    guidance = default_guidance(report)
    control, generation, unseen = report["control"], report["generation"][guidance], report["unseen_surfaces"]
    ours = control[guidance]
    return {
        "surfaces": report["data"]["training_surfaces"],
        "alpha": _listed((report["data"].get("rater_alpha") or {}).values()) or None,
        "changes": share_right(ours, control),
        "matrix": matrix_difference(ours["response"], control["response_real"]),
        "diagonal": _diagonal(ours["response"]),
        "diagonal_real": _diagonal(control["response_real"]),
        "nine_band_db": unseen["nine_band_db"]["model"],
        "ridge": unseen["nine_band_db"].get("ridge"),
        "ktd_excess": generation["ktd_excess"],
        "ftd_excess": generation["ftd_excess"],
        "diversity_of_rating": generation.get("diversity_of_rating"),
        "shift": latent_shift(report) if report.get("paper") else None,
    }


def _diagonal(matrix):
    return _listed(matrix[axis][axis]["mean"] for axis in range(len(matrix)))


def _listed(values):
    return ", ".join("–" if value is None else f"{value:.2f}" for value in values)


def spectra_of(reports):
    """Spectra over one axis at a time of the reports that have the section paper: name -> axis -> rating -> leaves."""
    return {name: report["paper"]["spectra_db"] for name, report in reports.items() if report.get("paper")}


def read_report(path):
    """A report.json that can be compared; a `ValueError` if it is damaged, or lacks a section."""
    with reading(path, "a report to compare", "Run examples/evaluate.py again."):
        report = read_json(path, "JSON")
        check_report(report)
    return report


@command("compare.py")
def main(argv=None):
    """Runs the command."""
    arguments = parse_arguments(argv)
    reports = {name: read_report(path) for name, path in arguments.report.items()}
    text = comparison_markdown(reports)
    arguments.output.mkdir(parents=True, exist_ok=True)
    if len(spectra := spectra_of(reports)) > 1:
        plot_axis_spectra(spectra, arguments.output / "axes.png")
    write_text(arguments.output / "report.md", text)
    print(text)


if __name__ == "__main__":
    sys.exit(main())
