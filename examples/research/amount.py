"""Figures of several reports over the size of their training data: `python examples/research/amount.py --report
50=report_50 2000=report_2000 --output data.png`.

Reports that share the agreement of raters of most reports stand over the number of training surfaces; reports that
share a number of surfaces stand over Cronbach's alpha.
"""

import argparse
import sys
from collections import Counter
from pathlib import Path

import numpy as np

from tactile_diffusers.cli.compare import read_report
from tactile_diffusers.evaluation.comparison import report_row
from tactile_diffusers.evaluation.report_figures import figure_panels

DRAWN = {"nine_band_db": "unseen surfaces, dB", "matrix": "response matrix, largest difference"}


def series(reports):
    """What the data differ in: label of the abscissa -> {name: abscissa}, of reports that share all else."""
    size = {name: report["data"]["training_surfaces"] for name, report in reports.items()}
    alphas = {name: (report["data"].get("rater_alpha") or {}).values() for name, report in reports.items()}
    alpha = {name: round(float(np.mean(list(values))), 3) if values else None for name, values in alphas.items()}
    usual = Counter(alpha.values()).most_common(1)[0][0]
    by_size = {name: size[name] for name in reports if alpha[name] == usual}
    groups = [{name: alpha[name] for name in reports if size[name] == count and alpha[name]} for count in size.values()]
    by_alpha = max(groups, key=lambda group: len(set(group.values())))
    found = {"training surfaces": by_size, "Cronbach's alpha of ratings, mean over axes": by_alpha}
    return {label: points for label, points in found.items() if len(set(points.values())) > 1}


def plot(reports, output_path):
    """Error on unseen surfaces and difference of the response matrix, over what the training data differ in."""
    found, rows = series(reports), {name: report_row(report) for name, report in reports.items()}
    with figure_panels(output_path, len(found), len(DRAWN), (9, 3.4 * len(found))) as panels:
        for row, (abscissa, points) in zip(panels, found.items(), strict=True):
            for panel, (key, label) in zip(row, DRAWN.items(), strict=True):
                _draw(panel, points, rows, key, "DALE", marker="o", color="C0")
                if key == "nine_band_db":
                    _draw(panel, points, rows, "ridge", "ridge regression, same data", marker="x", color="C1")
                panel.set(xlabel=abscissa, ylabel=label, xscale="log" if "surfaces" in abscissa else "linear")
                panel.legend(fontsize=7)


def _draw(panel, points, rows, key, label, **style):
    values = [rows[name][key] for name in points]
    means = [value["mean"] if isinstance(value, dict) else value for value in values]
    panel.plot(list(points.values()), np.array(means, dtype=float), linestyle="none", label=label, **style)


def main(argv=None):
    """Runs the command; returns 0, or 1 where the reports differ in nothing that is drawn."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--report", nargs="+", required=True, metavar="NAME=FOLDER", help="folders of evaluate.py")
    parser.add_argument("--output", type=Path, required=True, metavar="FILE.png")
    arguments = parser.parse_args(argv)
    named = dict(item.split("=", 1) for item in arguments.report)
    reports = {name: read_report(Path(folder) / "report.json") for name, folder in named.items()}
    if not series(reports):
        print("The reports share the number of training surfaces and the agreement of raters: nothing to draw.")
        return 1
    plot(reports, arguments.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
