"""What the benchmarks share: common arguments, results as two files, medians, and code in a fresh process."""

import platform
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import torch

from tactile_diffusers.cli.program import Parser, add_checkpoint_argument, add_output_argument, add_seed_argument
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.io.argument_types import count

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.result_files import conditions, machine_facts, stamp, write_results
from report.tables import markdown_table

#: A run that takes longer than this is not repeated, s.
LONG_RUN = 10.0
#: A spread over this is told beside a table, %.
LARGEST_SPREAD = 20
#: not getrusage: on Linux a child's maximum begins at its parent's
_PEAK = "print(open('/proc/self/status').read().split('VmHWM:')[1].split()[0])"


def make_parser(script, description):
    """A parser with the arguments that all benchmarks have."""
    parser = Parser(prog=script, description=description)
    add_output_argument(parser, "folder of the results, as JSON and Markdown")
    add_checkpoint_argument(parser)
    add_seed_argument(parser, "seed of all that is drawn")
    parser.add_argument("--threads", type=count, metavar="N", help="of torch; default: its own choice")
    parser.add_argument("--quiet", action="store_true", help="no progress bars")
    return parser


def parse(parser, argv):
    """The arguments, with torch's threads set, and the `conditions` of what is measured."""
    arguments = parser.parse_args(argv)
    if arguments.threads:
        torch.set_num_threads(arguments.threads)
    data = getattr(arguments, "data", None)
    data = data and PreparedDataset(data, "train")
    arguments.conditions = conditions(arguments.checkpoint, data)
    return arguments


def finish(arguments, name, report, text):
    """Writes NAME.json and NAME.md, with the conditions, and prints the Markdown; returns exit code 0."""
    text = f"{text}\n{stamp(arguments.conditions)}\n"
    write_results(arguments.output, name, {"conditions": arguments.conditions} | report, text)
    print(text)
    return 0


def machine(computing=None):
    """The machine in words: processor, what computes (by default torch's threads), version of torch."""
    computing = computing or f"{torch.get_num_threads()} threads"
    return f"{machine_facts()['processor']}, {computing}, torch {torch.__version__}"


def seconds_of(runs, repeats, long_run=LONG_RUN):
    """Median seconds of several runs, repeated in turn, so that a drift of the machine meets all alike.

    Args:
        runs (`dict[str, Callable]`): name -> what is timed; each runs once before that, to warm up.
        repeats (`int`): timings of each.
        long_run (`float`): what takes more seconds to warm up is not run again: that time counts.

    Returns:
        `dict[str, float]`: name -> seconds.
    """
    return {name: statistics.median(values) for name, values in timings(runs, repeats, long_run).items()}


def timed_columns(values, name="s"):
    """Median seconds of timings, and half the distance of their quartiles over the median: columns of a table."""
    low, middle, high = np.quantile(values, (0.25, 0.5, 0.75))
    return {name: float(middle), "spread, %": float(100 * (high - low) / 2 / middle)}


def timed_table(rows, digits=3, **options):
    """`markdown_table`, and under it a line that names the rows whose spread is too large to trust their seconds."""
    loose = [name for name, row in rows.items() if row.get("spread, %", 0) > LARGEST_SPREAD]
    remark = f"\n\nThe spread exceeds {LARGEST_SPREAD} %: {', '.join(loose)}." if loose else ""
    return markdown_table(rows, digits, **options) + remark


def timings(runs, repeats, long_run=LONG_RUN):
    """As `seconds_of`, all of them: name -> list of seconds."""
    first = {name: _seconds(run) for name, run in runs.items()}
    times = {name: [seconds] if seconds > long_run else [] for name, seconds in first.items()}
    for _ in range(repeats):
        for name, run in runs.items():
            if first[name] <= long_run:
                times[name].append(_seconds(run))
    return times


def _seconds(run):
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def run_child(code, *arguments):
    """Runs Python code, which sees `arguments` in `sys.argv[1:]`, in a fresh process.

    Returns:
        `tuple[str, float | None]`: what it printed, and its peak resident memory in MiB; `None` anywhere but on Linux.

    Raises:
        RuntimeError: if it fails, with the end of what it wrote to stderr.
    """
    linux = platform.system() == "Linux"
    code = f"{code}\n{_PEAK if linux else 'print(0)'}"
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"A process that was measured failed with {done.returncode}:\n{done.stderr[-2000:]}")
    *printed, kibibytes = done.stdout.splitlines()
    return "\n".join(printed), int(kibibytes) / 2**10 if linux else None


def resident_mib(process="self", parts=("VmRSS",)):
    """Memory that a process (its number) or this one holds now, MiB; NaN where there is no /proc, or it has ended."""
    try:
        status = (Path("/proc") / str(process) / "status").read_text()
        return sum(int(status.split(f"{part}:")[1].split()[0]) for part in parts) / 2**10
    except (OSError, IndexError):
        return float("nan")
