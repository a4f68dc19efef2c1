"""`benchmark.py --suite stability`: hard cases in one table, each against a bound."""

import logging
import math

import stability_running as running
import stability_signals as signals
from stability_bench import RATINGS, SAME, SAME_DB, Bench, Row
from tqdm.auto import tqdm

from tactile_diffusers.evaluation.result_files import machine, write_results
from tactile_diffusers.evaluation.tables import title

#: Kinds of cases: functions of a `Bench` that yield rows. First those that watch memory: what other cases have given
#: back to the allocator would hide growth.
CASES = {
    "many in a row": running.many,
    "stream": running.stream,
    "precision": signals.precision,
    "ratings": signals.ratings,
    "guidance": signals.guidance,
    "steps": signals.steps,
    "level": signals.levels,
    "length": signals.lengths,
    "input": signals.inputs,
    "sampling rate": signals.sampling_rates,
    "threads": running.threads,
    "processes": running.processes,
    "compiled": running.compiled,
}


def measure(bench, cases, quiet=True):
    """All rows; what raises an error is a row that fails, and the other cases go on.

    Args:
        bench (`Bench`).
        cases (`dict[str, Callable]`): as `CASES`.
        quiet (`bool`): no progress bar.

    Returns:
        `list[Row]`
    """
    rows = []
    for name, case in tqdm(cases.items(), disable=quiet, desc="cases"):
        try:
            rows.extend(row._replace(case=f"{name}: {row.case}") for row in case(bench))
        except Exception as error:  # of any kind: it is what this suite looks for
            words = " ".join(f"{type(error).__name__}: {error}".split())[:200].replace("|", "/")
            rows.append(Row(f"{name}: stopped", words, math.nan, 0.0, ""))
    return rows


def run(arguments, pipe):
    """Measures, writes stability.json and stability.md.

    Args:
        arguments (`argparse.Namespace`): "output" (`Path`, a folder), "seed", "minutes" (of the stream), "quick",
            "quiet".
        pipe (`TactileTexturePipeline`): with a DALE, float32, on the CPU.

    Returns:
        `tuple[str, int]`: the Markdown, and how many rows fail.
    """
    bench = Bench(pipe, arguments.seed, arguments.quick, arguments.minutes)
    logging.disable(logging.WARNING)  # ratings out of range are the point
    try:
        rows = measure(bench, CASES, arguments.quiet)
    finally:
        logging.disable(logging.NOTSET)
    failed = [row for row in rows if not row.passed]
    report = {
        "machine": machine(),
        "seed": arguments.seed,
        "quick": arguments.quick,
        "rows": [row._asdict() | {"passed": row.passed} for row in rows],
    }
    text = markdown(report, rows)
    write_results(arguments.output, "stability", report, text)
    return text, len(failed)


def markdown(report, rows):
    """What was measured and why bounds are what they are, and the table."""
    about = (
        f"{sum(row.passed for row in rows)} of {len(rows)} within their bounds; {report['machine']}; seed "
        f"{report['seed']}. Errors are those of the worst of {len(RATINGS)} textures, against what float32 makes of "
        "the same noise; a value that is not finite fails. Bounds: where only the order of float32 operations differs, "
        f"{SAME:.1e} of the RMS (a hundred roundings) and {SAME_DB:g} dB; of a coarser type five of its roundings, and "
        "0.1 dB (0.5 dB for weights of 8 bits), far below the 2.2 dB that a fingertip tells apart; what is generated "
        "within 5 standard deviations of the training set, as one of a million textures would be; more steps gain at "
        "least half of what their order promises."
    )
    lines = ["| case | what is measured | value | at most | unit | |", "|---|---|---|---|---|---|"]
    for row in rows:
        value, bound = (f"{number:.3g}" for number in (row.value, row.bound))
        verdict = "pass" if row.passed else "**FAIL**"
        lines.append(f"| {row.case} | {row.measured} | {value} | {bound} | {row.unit} | {verdict} |")
    return f"{title('Hard cases', 4)}{about}\n\n" + "\n".join(lines) + "\n"
