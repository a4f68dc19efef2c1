"""`python examples/research/validate_virtual.py`: every law of the virtual surfaces, measured against intended."""

import sys
from dataclasses import asdict
from pathlib import Path

from laws import LAWS
from tqdm import tqdm

from tactile_diffusers.cli.program import Parser, program
from tactile_diffusers.evaluation.result_files import write_results
from tactile_diffusers.io.files import atomic_path
from tactile_diffusers.virtual import RECIPE_VERSION


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = Parser(
        prog=program("validate_virtual.py"),
        description="Measure every law of the virtual surfaces and compare it with what is intended. Exit code 1 if a "
        "law is off.",
    )
    parser.add_argument(
        "--output", type=Path, required=True, metavar="FOLDER", help="validation.json, validation.md, one PNG a law"
    )
    parser.add_argument("--quick", action="store_true", help="measure less, with wider tolerances")
    parser.add_argument("--laws", nargs="+", choices=list(LAWS), default=list(LAWS), metavar="LAW", help="default: all")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    arguments = parser.parse_args(argv)
    if arguments.output.exists() and not arguments.output.is_dir():
        parser.error(f"argument --output: {arguments.output} is a file; give a folder")
    return arguments


def markdown(laws):
    """The tables, intended against measured, of {name: `Law`}."""
    lines = [f"# Virtual surfaces, recipe {RECIPE_VERSION}: intended and measured"]
    for name, law in laws.items():
        lines += ["", f"## {law.title}", "", f"Source: {law.source}.", "", f"![{law.title}]({name}.png)", ""]
        lines += ["| quantity | intended | measured | tolerance | ok |", "|---|---:|---:|---:|---|"]
        for check in law.checks:
            quantity = f"{check.quantity}, {check.unit}" if check.unit else check.quantity
            numbers = (f"{value:.4g}" for value in (check.intended, check.measured, check.tolerance))
            lines.append(f"| {quantity} | {' | '.join(numbers)} | {'yes' if check.ok else '**no**'} |")
    return "\n".join(lines) + "\n"


def results(laws, quick):
    """What goes to validation.json, of {name: `Law`}."""
    rows = {
        name: {
            "title": law.title,
            "source": law.source,
            "ok": law.ok,
            "checks": [{**asdict(check), "ok": check.ok} for check in law.checks],
        }
        for name, law in laws.items()
    }
    return {"recipe_version": RECIPE_VERSION, "quick": quick, "ok": all(law.ok for law in laws.values()), "laws": rows}


def draw(law, path):
    """The picture of a law, below 60 kB."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(max(4.8, 3.6 * law.panels), 3.2), dpi=75, layout="constrained")
    law.draw(figure.subplots(1, law.panels, squeeze=False)[0])
    figure.suptitle(law.title, fontsize=10)
    with atomic_path(path) as temporary:
        FigureCanvasAgg(figure).print_png(temporary)


def main(argv=None):
    """Runs the command; returns 1 if a law is off."""
    arguments = parse_arguments(argv)
    arguments.output.mkdir(parents=True, exist_ok=True)
    laws = {}
    for name in tqdm(arguments.laws, desc="laws", unit="law", disable=arguments.quiet):
        laws[name] = LAWS[name](arguments.quick)
        draw(laws[name], arguments.output / f"{name}.png")
    write_results(arguments.output, "validation", results(laws, arguments.quick), markdown(laws), indent=1)
    off = [f"{name}: {check.quantity}" for name, law in laws.items() for check in law.checks if not check.ok]
    print("\n".join([f"wrote {arguments.output / 'validation.md'}", *(f"off: {line}" for line in off)]))
    return 1 if off else 0


if __name__ == "__main__":
    sys.exit(main())
