"""`ablate.py`: trains the rows of an ablation one after the other, measures them, and reports them."""

import json
import signal
import sys
from pathlib import Path

from tqdm.auto import tqdm

from tactile_diffusers.cli.program import Parser, add_output_argument, existing_file, existing_folder, program, refuse
from tactile_diffusers.data.splits import SPLITS
from tactile_diffusers.io.argument_types import count
from tactile_diffusers.io.files import write_text
from tactile_diffusers.io.reading import read_json, reading

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

#: Folder of the row files, beside the training scripts.
ROWS = Path("configs") / "ablation"


def parse_arguments(scripts, argv=None):
    """Arguments of the command.

    Raises:
        SystemExit: on bad arguments, with exit code 2 and a line that says what is wrong.
    """
    parser = Parser(
        prog=program("ablate.py"),
        description="Train and measure the rows of an ablation, each a JSON file that says what it asks. What is done "
        "is kept under OUTPUT/ROW: the same command goes on where it was cut off. A row is done again when its file "
        "changes; after a change of the code delete its folder, or only its result.json to measure it again.",
    )
    add = parser.add_argument
    add("--data", type=existing_file, required=True, metavar="PREPARED.h5", help="from examples/prepare_data.py")
    add("--rows", type=existing_folder, default=scripts / ROWS, metavar="FOLDER", help="row files; default: ours")
    add_output_argument(parser, "trainings, results, report.md")
    add("--only", nargs="+", metavar="NAME", help="rows to train and measure; default: all")
    add(
        "--seeds", type=int, nargs="+", default=[None], metavar="N", help="trainings of each row; default: its own seed"
    )
    add("--equal_time", metavar="NAME", help="train each row again for as long as this one took; default: do not")
    add("--shorten", type=count, default=1, metavar="N", help="a trial: every training N times shorter; default: 1")
    add("--threads", type=count, default=1, help="of training and measuring; default: 1")
    add("--split", choices=SPLITS[1:], default="validation", help="held-out surfaces; default: validation")
    add("--report_only", action="store_true", help="only report what is done; default: train and measure first")
    add("--quiet", action="store_true", help="no progress bars; default: show them")
    arguments = parser.parse_args(argv)
    return arguments


def main(argv=None, scripts=Path(__file__).parents[1]):
    """Runs the command.

    Args:
        argv (`list[str]`, *optional*): in place of the command line.
        scripts (`Path`, *optional*): folder of the training scripts.

    Returns:
        `int`: 0; 1 if a row failed or there is nothing to report; 2 if rows or folders are not as they must be.
    """
    arguments = parse_arguments(scripts, argv)
    import torch
    from ablate_measure import Bench
    from ablate_rows import read_rows
    from ablate_training import check_stages, stages

    try:
        rows = read_rows(arguments.rows)
        chosen = [] if arguments.report_only else _chosen(rows, arguments.only)
        _chosen(rows, arguments.equal_time and [arguments.equal_time])
        chosen = {row.path for row in chosen}
        rows = [row.scaled(1 / arguments.shorten) if arguments.shorten > 1 else row for row in rows]
        rows = [row if seed is None else row.seeded(seed) for row in rows for seed in arguments.seeds]
        known, plans = {}, {}
        for row in rows:
            plans[row.name] = stages(row, arguments.output / row.name, arguments.data, known)
            if row.path in chosen:
                check_stages(row, plans[row.name], scripts)
    except (ValueError, OSError) as error:
        refuse("ablate.py", error)
        return 2
    torch.set_num_threads(arguments.threads)
    bench = Bench(arguments.data, arguments.split, arguments.quiet)
    failed = False

    def run_all(rows):
        nonlocal failed
        for row in tqdm([row for row in rows if row.path in chosen], desc="rows", disable=arguments.quiet):
            try:
                _run(row, plans[row.name], scripts, arguments, bench)
            except (RuntimeError, ValueError, OSError) as error:
                refuse("ablate.py", f"row {row.name}: {error}")
                failed = True

    with _killed_as_interrupted():
        run_all(rows)
        timed = _timed(rows, plans, arguments)
        plans |= {row.name: stages(row, arguments.output / row.name, arguments.data, known) for row in timed}
        run_all(timed)
    rows += timed
    reported = _report(rows, plans, arguments)
    return int(failed or not reported)


def _chosen(rows, only):
    names = [row.name for row in rows]
    unknown = sorted(set(only or ()) - set(names))
    if unknown:
        raise ValueError(f"--only: there is no row {unknown[0]!r}. There are {', '.join(names)}.")
    return [row for row in rows if only is None or row.name in only]


def _timed(rows, plans, arguments):
    """The rows with as many steps as fit into the time of the row `--equal_time`, seed by seed, where both are done."""
    found, results = [], {row.name: _stored(row.name, plans[row.name], arguments) for row in rows}
    names = {row.seed: row.name for row in rows if row.path.stem == arguments.equal_time}
    for row in rows:
        own, other = results[row.name], results.get(names.get(row.seed))
        if own and other and row.path.stem != arguments.equal_time:
            paces = [pace for pace in ("step_seconds", "dale_step_seconds") if pace in own and pace in other]
            factors = [other[pace] / own[pace] for pace in paces]
            question = f"{row.question}, as long as `{arguments.equal_time}`"
            found.append(row.scaled(*factors, equal_time=True, question=question))
    return found


class _killed_as_interrupted:
    """While it lasts, SIGTERM ends the command as Ctrl-C does, so that no training is left behind."""

    def __enter__(self):
        self._before = signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))

    def __exit__(self, *_):
        signal.signal(signal.SIGTERM, self._before)


def _conditions(plan, arguments):
    """What a row's result depends on: everything that its last stage learnt from, and what it was measured on."""
    return {"digest": plan[-1].digest, "split": arguments.split}


def _stored(name, plan, arguments):
    """A row's result as it was written; `None` if there is none of this row as its file is now, or it is damaged."""
    from ablate_results import check_result

    path = arguments.output / name / "result.json"
    try:
        with reading(path, "a result"):
            result = read_json(path, "JSON")
            if any(result.get(name) != value for name, value in _conditions(plan, arguments).items()):
                return None
            check_result(result)
    except FileNotFoundError:
        return None
    except ValueError as error:  # it is measured again
        print(f"{program('ablate.py')}: warning: {error}", file=sys.stderr)
        return None
    return result


def _run(row, plan, scripts, arguments, bench):
    """Trains and measures a row, unless that is done."""
    from ablate_training import train, training_facts
    from report.result_files import machine_facts

    from tactile_diffusers.io.locks import locked_folder

    folder = arguments.output / row.name
    folder.mkdir(parents=True, exist_ok=True)
    with locked_folder(folder):  # other commands may be at other rows of the same output
        if _stored(row.name, plan, arguments) is not None:
            return
        train(row, plan, scripts, arguments.threads)
        measured = bench.measure(plan[-1].folder, generates=row.dale is not None)
        result = {"machine": machine_facts(), **_conditions(plan, arguments), **training_facts(plan), **measured}
        write_text(folder / "result.json", json.dumps(result, indent=1, allow_nan=False) + "\n")


def _report(rows, plans, arguments):
    """Writes ablation.json, report.md and the pictures of the rows that are done, and the README if asked to.

    Returns:
        `bool`: whether there was a row to report.
    """
    from ablate_results import averaged, markdown, plot_rate_distortion, plot_rows, seed_rows

    stored = [(row, _stored(row.name, plans[row.name], arguments)) for row in rows]
    missing = [row.name for row, result in stored if result is None]
    if missing:
        print(f"ablate.py: no result yet of {', '.join(missing)} as in {arguments.rows}", file=sys.stderr)
    results = {
        row.name: {"question": row.question, "group": row.group, "seed": row.seed, **result}
        for row, result in stored
        if result is not None
    }
    if not results:
        return False
    output, facts = arguments.output, {"data": arguments.data.name, "split": arguments.split}
    facts["shortened"] = arguments.shorten
    write_text(
        output / "ablation.json", json.dumps({**facts, "shown": seed_rows(results), "rows": results}, indent=1) + "\n"
    )
    shown = averaged(results)
    plot_rows(shown, output / "rows.png")
    plot_rate_distortion(shown, output / "rate_distortion.png")
    text = markdown(results, **facts)
    write_text(output / "report.md", text)
    print(text)
    return True


if __name__ == "__main__":
    sys.exit(main())
