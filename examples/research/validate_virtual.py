"""`python examples/research/validate_virtual.py`: laws of the virtual surfaces, intended and measured on hands."""

import sys
from dataclasses import asdict
from math import isfinite
from pathlib import Path

from tqdm import tqdm

from tactile_diffusers.cli.program import Parser, program
from tactile_diffusers.virtual import RECIPE_VERSION

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from laws import LAWS, hands, measured, page
from report.result_files import write_results

#: Where the project keeps the measured data, beside the repository.
HUMAN = Path(__file__).parents[3] / "shared" / "data" / "human"


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = Parser(
        prog=program("validate_virtual.py"),
        description="Measure the laws of the virtual surfaces: as intended, and beside measured hands. Exit "
        "code 1 if a law is off, or outside what was measured without a known reason.",
    )
    parser.add_argument(
        "--output",
        type=Path,
        required=True,
        metavar="FOLDER",
        help="gets validation and hands, .json and .md, and PNGs",
    )
    parser.add_argument("--quick", action="store_true", help="measure less, with wider tolerances")
    known = [*LAWS, "hands"]
    parser.add_argument(
        "--laws", nargs="+", choices=known, default=known, metavar="LAW", help="default: all, and hands"
    )
    parser.add_argument(
        "--human",
        type=Path,
        metavar="FOLDER",
        help="measured data; adds stroke.png, a recording that nobody may publish (default: ../shared/data/human if "
        "it is there, else quoted numbers)",
    )
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    arguments = parser.parse_args(argv)
    if arguments.output.exists() and not arguments.output.is_dir():
        parser.error(f"argument --output: {arguments.output} is a file; give a folder")
    if arguments.human and not (arguments.human / "hatt_summary.json").is_file():
        parser.error(
            f"argument --human: {arguments.human} has no hatt_summary.json; leave it out to use quoted numbers"
        )
    return arguments


def markdown(laws):
    """The tables, intended against measured, of {name: `Law`}."""
    lines = [f"# Virtual surfaces, recipe {RECIPE_VERSION}: intended and measured"]
    for law in laws.values():
        lines += ["", f"## {law.title}", "", f"Source: {law.source}.", ""]
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


def finite(numbers):
    """Numbers for JSON, which knows no infinity: `None` instead."""
    return [number if isfinite(number) else None for number in numbers]


def write_hands(output, human, quick):
    """Writes hands.md, hands.json and its pictures; returns the rows that are outside without a known reason."""
    rows, (surfaces, textures, *_), facts = hands.compare(human, quick)
    report = {
        "recipe_version": RECIPE_VERSION,
        "quick": quick,
        "facts": facts,
        "rows": [{**asdict(row), "measured": finite(row.measured), "inside": row.inside} for row in rows],
    }
    write_results(output, "hands", report, page.markdown(rows, facts, RECIPE_VERSION), indent=1)
    page.draw_shapes(textures, output / "shapes.png")
    page.draw_segments(surfaces, textures, output / "segments.png")
    if human:
        page.draw_segments(surfaces, textures, output / "stroke.png", measured.stroke(human))
    return [f"hands: {row.law}" for row in rows if not row.inside and not row.reason]


def main(argv=None):
    """Runs the command; returns 1 if a law is off."""
    arguments = parse_arguments(argv)
    arguments.output.mkdir(parents=True, exist_ok=True)
    human, laws, off = arguments.human or (HUMAN if HUMAN.is_dir() else None), {}, []
    for name in tqdm(arguments.laws, desc="laws", unit="law", disable=arguments.quiet):
        if name == "hands":
            off += write_hands(arguments.output, human, arguments.quick)
        else:
            laws[name] = LAWS[name](arguments.quick)
    if laws:
        write_results(arguments.output, "validation", results(laws, arguments.quick), markdown(laws), indent=1)
    off += [f"{name}: {check.quantity}" for name, law in laws.items() for check in law.checks if not check.ok]
    print("\n".join([f"wrote {arguments.output}", *(f"off: {line}" for line in off)]))
    return 1 if off else 0


if __name__ == "__main__":
    sys.exit(main())
