"""`python examples/benchmark.py`: speed and memory of generating, on this machine."""

import argparse
import importlib
import json
import platform
import statistics
import time
from pathlib import Path

from ..data.files import write_text
from ..signal import SEGMENT_SECONDS
from . import readme
from .child import run_child

#: suites beside "speed" -> the module whose `run(arguments, pipe)` measures
SUITES = {
    name: f"{__package__}.benchmark_{name}" for name in ("scheduler", "data", "stream", "scene", "dataset", "decoder")
}
#: what a child process does so that its peak memory is that of generating one texture
_GENERATE_ONCE = """
import sys, torch
from tactile_diffusers import TactileTexturePipeline
pipe = TactileTexturePipeline.from_pretrained(sys.argv[1])
pipe.set_progress_bar_config(disable=True)
pipe([[1.5, 0.0, -1.0]], generator=torch.Generator("cpu").manual_seed(0))
"""


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = argparse.ArgumentParser(prog="benchmark.py", description="Measure speed, memory and accuracy.")
    parser.add_argument("--checkpoint", metavar="FOLDER", help="default: the bundled checkpoint")
    parser.add_argument("--suite", choices=["speed", *SUITES], default="speed", help="default %(default)s")
    parser.add_argument("--output", type=Path, required=True, metavar="FOLDER", help="JSON and Markdown")
    parser.add_argument("--threads", type=int, help="of torch; default: its own choice")
    parser.add_argument("--repeats", type=int, default=5, help="the median counts")
    compared = parser.add_argument_group("suites beside speed")
    compared.add_argument(
        "--data", type=Path, metavar="PREPARED.h5", help="scheduler: also compare on trained models; data: load this"
    )
    compared.add_argument("--recordings", type=Path, metavar="R.h5", help="data: prepare these; default: virtual ones")
    compared.add_argument("--segments", type=int, default=60, help="scheduler: held-out segments, one a surface")
    compared.add_argument("--surfaces", type=int, help="stream: virtual ones, recorded, default 60; scene: default 100")
    compared.add_argument(
        "--decoders",
        nargs="+",
        default=[],
        metavar="NAME=FOLDER",
        help="decoder: output folders of examples/distill_lctg.py; default: what the checkpoint brings",
    )
    compared.add_argument("--textures", type=int, default=2000, help="dataset: that are generated")
    compared.add_argument("--minutes", type=float, default=10.0, help="stream: of random motion")
    compared.add_argument("--seed", type=int, default=0)
    compared.add_argument("--quiet", action="store_true", help="no progress bars")
    readme.add_arguments(parser, None)
    arguments = parser.parse_args(argv)
    if arguments.surfaces is None:
        arguments.surfaces = 100 if arguments.suite == "scene" else 60
    if arguments.repeats < 1 or (arguments.threads is not None and arguments.threads < 1):
        parser.error("arguments --repeats and --threads must be at least 1")
    if arguments.segments < 3 or arguments.seed < 0:
        parser.error("arguments --segments and --seed must be at least 3 and 0")
    if arguments.surfaces < 1 or not 0 < arguments.minutes < 1e4:
        parser.error("arguments --surfaces and --minutes must be at least 1 and above 0")
    for word in arguments.decoders:
        name, _, folder = word.partition("=")
        if not name or not (Path(folder) / "lctg_distilled").is_dir():
            parser.error(
                f"argument --decoders: must be NAME=FOLDER with {folder or 'FOLDER'}/lctg_distilled, got {word}"
            )
    if arguments.suite == "decoder" and arguments.data is None:
        parser.error("argument --data: --suite decoder needs a prepared data set; see examples/prepare_data.py")
    if arguments.textures < 1000:
        parser.error(f"argument --textures: must be at least 1000, got {arguments.textures}")
    if arguments.data is not None and not arguments.data.is_file():
        parser.error(f"argument --data: {arguments.data} is not a file; write one with examples/prepare_data.py")
    if arguments.recordings is not None and not arguments.recordings.is_file():
        parser.error(f"argument --recordings: {arguments.recordings} is not a file")
    arguments.readme_name = arguments.readme_name or arguments.suite
    readme.check_arguments(parser, arguments)
    return arguments


def _median_seconds(run, repeats):
    run()  # warm up
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def _stages(pipe, repeats):
    """Seconds of DALE alone, of both stages, and the real-time factor, at several steps."""
    from ..pipelines.recorded import DEFAULT_STEPS

    rows = {}
    for steps in (3, DEFAULT_STEPS, 10, 25):
        common = {"ratings": [[1.5, 0.0, -1.0]], "num_inference_steps": steps}
        latent = _median_seconds(lambda c=common: pipe(output_type="latent", **c), repeats)
        whole = _median_seconds(lambda c=common: pipe(**c), repeats)
        seconds = pipe(**common).textures.shape[-1] / pipe.feature_extractor.delivery_rate
        rows[f"{steps} + {steps} steps"] = {
            "DALE s": latent,
            "LCTG and output s": whole - latent,
            "whole s": whole,
            "real-time factor": whole / seconds,
        }
    return rows


def _scaling(pipe, repeats):
    """Seconds against batch size and duration."""
    batches, durations = {}, {}
    for count in (1, 2, 4, 8, 16):
        seconds = _median_seconds(lambda n=count: pipe([[1.5, 0.0, -1.0]] * n), repeats)
        batches[f"batch {count}"] = {"whole s": seconds, "s per texture": seconds / count}
    for duration in (SEGMENT_SECONDS, 5.0, 10.0, 20.0, 30.0):
        seconds = _median_seconds(lambda d=duration: pipe([[1.5, 0.0, -1.0]], duration_s=d), max(1, repeats // 2))
        durations[f"{duration:g} s"] = {"whole s": seconds, "real-time factor": seconds / duration}
    return batches, durations


def _peak_memory(checkpoint):
    """Peak resident memory in MiB of a process that loads the pipeline and makes one texture, and of the imports.

    Linux only: elsewhere the table is left empty.
    """
    if platform.system() != "Linux":
        return {}
    peaks = {}
    for name, code in (("import only", "import tactile_diffusers"), ("load and generate one texture", _GENERATE_ONCE)):
        peaks[name] = {"peak MiB": run_child(code, checkpoint)[1]}
    return peaks


def main(argv=None):
    """Runs the command."""
    arguments = parse_arguments(argv)
    import torch

    from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint

    if arguments.threads:
        torch.set_num_threads(arguments.threads)
    checkpoint = str(arguments.checkpoint or bundled_checkpoint())
    pipe = TactileTexturePipeline.from_pretrained(checkpoint)
    pipe.set_progress_bar_config(disable=True)
    if arguments.suite in SUITES:
        text = importlib.import_module(SUITES[arguments.suite]).run(arguments, pipe)
    else:
        text = _speed(arguments, pipe, checkpoint)
    if arguments.readme is not None:
        readme.write_between(arguments.readme, arguments.readme_name, text)
    print(text)
    return 0


def _speed(arguments, pipe, checkpoint):
    """Measures, writes benchmark.json and benchmark.md, and returns the Markdown."""
    import torch

    from ..evaluation.tables import markdown_table
    from ..pipelines.recorded import DEFAULT_STEPS

    batches, durations = _scaling(pipe, arguments.repeats)
    report = {
        "machine": f"{platform.machine()}, {torch.get_num_threads()} threads, torch {torch.__version__}",
        "steps": _stages(pipe, arguments.repeats),
        "batch": batches,
        "duration": durations,
        "memory": _peak_memory(checkpoint),
    }
    titles = {
        "steps": "One segment",
        "batch": f"Batch, {DEFAULT_STEPS} + {DEFAULT_STEPS} steps",
        "duration": "Duration",
        "memory": "Memory",
    }
    tables = [f"#### {title}\n\n{markdown_table(report[key], 3)}\n" for key, title in titles.items()]
    text = [f"### Speed and memory\n\n{report['machine']}; medians of {arguments.repeats}.\n", *tables]
    arguments.output.mkdir(parents=True, exist_ok=True)
    write_text(arguments.output / "benchmark.json", json.dumps(report, indent=2) + "\n")
    write_text(arguments.output / "benchmark.md", "\n".join(text))
    return "\n".join(text)
