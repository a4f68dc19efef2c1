"""`benchmark.py --suite speed`: time and memory of generating, and how they compare."""

import statistics
import time

from child import run_child

from tactile_diffusers.evaluation.result_files import machine, write_results
from tactile_diffusers.evaluation.tables import markdown_table
from tactile_diffusers.pipelines.recorded import DEFAULT_STEPS
from tactile_diffusers.signal import SEGMENT_SECONDS

RATINGS = [1.5, 0.0, -1.0]
BATCHES = (1, 4, 16, 64)
DURATIONS = (SEGMENT_SECONDS, 5.0, 10.0, 20.0, 30.0, 60.0)
#: A run that takes longer than this is not repeated, s.
LONG_RUN = 10.0
_IMPORT = "import tactile_diffusers"
#: what a child process does so that its peak memory is that of generating one texture
_GENERATE_ONCE = """
import sys, torch
from tactile_diffusers import TactileTexturePipeline
pipe = TactileTexturePipeline.from_pretrained(sys.argv[1])
pipe.set_progress_bar_config(disable=True)
pipe([[1.5, 0.0, -1.0]], generator=torch.Generator("cpu").manual_seed(0))
"""


def seconds_of(runs, repeats, long_run=LONG_RUN):
    """Median seconds of several runs, repeated in turn, so that a drift of the machine meets all alike.

    Args:
        runs (`dict[str, Callable]`): name -> what is timed; each runs once before that, to warm up.
        repeats (`int`): timings of each.
        long_run (`float`): what takes more seconds to warm up is not run again: that time counts.

    Returns:
        `dict[str, float]`: name -> seconds.
    """
    first = {name: _seconds(run) for name, run in runs.items()}
    times = {name: [seconds] if seconds > long_run else [] for name, seconds in first.items()}
    for _ in range(repeats):
        for name, run in runs.items():
            if first[name] <= long_run:
                times[name].append(_seconds(run))
    return {name: statistics.median(values) for name, values in times.items()}


def _seconds(run):
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def peak_memory(code, *arguments):
    """Peak resident memory in MiB of a process that runs some Python code; `None` where there is no Linux."""
    return run_child(code, *arguments)[1]


def _stages(pipe, repeats):
    """Seconds of DALE alone, of both stages, and the real-time factor, at several steps."""
    runs = {}
    for steps in (3, DEFAULT_STEPS, 10, 25):
        common = {"ratings": [RATINGS], "num_inference_steps": steps}
        runs[steps, "latent"] = lambda c=common: pipe(output_type="latent", **c)
        runs[steps, "np"] = lambda c=common: pipe(**c)
    times, rows = seconds_of(runs, repeats), {}
    duration = pipe([RATINGS], num_inference_steps=1).textures.shape[-1] / pipe.feature_extractor.delivery_rate
    for steps in sorted({steps for steps, _ in runs}):
        latent, whole = times[steps, "latent"], times[steps, "np"]
        rows[f"{steps} + {steps} steps"] = {
            "DALE s": latent,
            "LCTG and output s": whole - latent,
            "whole s": whole,
            "real-time factor": whole / duration,
        }
    return rows


def _scaling(pipe, repeats):
    """Seconds against batch size and duration."""
    counts = sorted({*BATCHES, 2, 8})
    times = seconds_of({n: lambda n=n: pipe([RATINGS] * n) for n in counts}, repeats)
    batches = {f"batch {n}": {"whole s": times[n], "s per texture": times[n] / n} for n in counts}
    times = seconds_of({d: lambda d=d: pipe([RATINGS], duration_s=d) for d in DURATIONS}, max(1, repeats // 2))
    durations = {f"{d:g} s": {"whole s": times[d], "real-time factor": times[d] / d} for d in DURATIONS}
    return batches, durations


def _memory(checkpoint):
    """Peak memory of the imports and of generating one texture; empty where it is not known."""
    codes = {"import only": _IMPORT, "load and generate one texture": _GENERATE_ONCE}
    peaks = {name: peak_memory(code, checkpoint) for name, code in codes.items()}
    return {name: {"peak MiB": peak} for name, peak in peaks.items() if peak is not None}


def run(arguments, pipe):
    """Measures, writes benchmark.json and benchmark.md, and returns the Markdown.

    Args:
        arguments (`argparse.Namespace`): "checkpoint" (`str`), "output" (`Path`), "repeats", and of the comparison
            "peers" (`bool`), "anchor" and "distilled" (`Path` or `None`), "data" (`Path` or `None`), "segments",
            "seed" and "quiet".
        pipe (`TactileTexturePipeline`): from that checkpoint, with a DALE.

    Returns:
        `str`
    """
    batches, durations = _scaling(pipe, arguments.repeats)
    report = {
        "machine": machine(),
        "steps": _stages(pipe, arguments.repeats),
        "batch": batches,
        "duration": durations,
        "memory": _memory(arguments.checkpoint),
    }
    titles = {
        "steps": "One segment",
        "batch": f"Batch, {DEFAULT_STEPS} + {DEFAULT_STEPS} steps",
        "duration": "Duration",
        "memory": "Memory",
    }
    tables = [f"#### {title}\n\n{markdown_table(report[key], 3)}\n" for key, title in titles.items()]
    text = [f"### Speed and memory\n\n{report['machine']}; medians of {arguments.repeats}.\n", *tables]
    if arguments.peers:
        from peers import compare, markdown

        report["peers"] = compare(arguments, pipe, arguments.checkpoint)
        text.append(markdown(report["peers"]))
    if arguments.peers and arguments.data is not None:
        import pareto

        report["pareto"] = pareto.measure(arguments, pipe, arguments.checkpoint)
        text.append(pareto.markdown(report["pareto"]))
    write_results(arguments.output, "benchmark", report, "\n".join(text))
    if "pareto" in report:
        pareto.plot(report["pareto"], arguments.output / "pareto.png")
    return "\n".join(text)
