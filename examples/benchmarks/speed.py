"""How long does generating take, and how much memory? `python examples/benchmarks/speed.py --output report`"""

import sys
from pathlib import Path

from benchmarking import finish, machine, make_parser, parse, run_child, seconds_of, timed_columns, timed_table, timings

from tactile_diffusers.cli.program import load_pipeline
from tactile_diffusers.io.argument_types import count
from tactile_diffusers.signal import SEGMENT_SECONDS

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.sections.speed import TIMED_STEPS, steps_in_time

RATINGS = [1.5, 0.0, -1.0]
BATCHES = (1, 2, 4, 8, 16, 64)
DURATIONS = (SEGMENT_SECONDS, 5.0, 10.0, 20.0, 30.0, 60.0)
STEPS = (1, 3, 10, 25, 50)
#: Latent frames of a block of 0.1 s.
BLOCK_FRAMES = 4
#: what a child process does, so that its peak memory is that of generating one texture
_CHILDREN = {
    "import only": "import tactile_diffusers",
    "load and generate one texture": """
import sys, torch
from tactile_diffusers import TactileTexturePipeline
pipe = TactileTexturePipeline.from_pretrained(sys.argv[1])
pipe.set_progress_bar_config(disable=True)
pipe([[1.5, 0.0, -1.0]], generator=torch.Generator("cpu").manual_seed(0))
""",
}


def by_steps(pipe, repeats):
    """Seconds of DALE alone, of both stages, and the real-time factor, at several steps."""
    runs = {}
    for steps in STEPS:
        common = {"ratings": [RATINGS], "num_inference_steps": steps}
        runs[steps, "latent"] = lambda c=common: pipe(output_type="latent", **c)
        runs[steps, "np"] = lambda c=common: pipe(**c)
    taken, rows = timings(runs, repeats), {}
    duration = pipe([RATINGS], num_inference_steps=1).textures.shape[-1] / pipe.feature_extractor.delivery_rate
    for steps in STEPS:
        latent, whole = (timed_columns(taken[steps, kind], "whole s") for kind in ("latent", "np"))
        rows[f"{pipe.resolve_steps(steps)[1]} + {steps} steps"] = {
            "DALE s": latent["whole s"],
            "LCTG and output s": whole["whole s"] - latent["whole s"],
            **whole,
            "real-time factor": whole["whole s"] / duration,
        }
    return rows


def in_time(pipe, repeats):
    """Steps of LCTG that last as long as what they decode, a segment and a block: what the paper calls real time."""
    latents, runs, rows = pipe([RATINGS], output_type="latent"), {}, {}
    for frames in (latents.latents.shape[-1], BLOCK_FRAMES):
        for steps in TIMED_STEPS:
            decoded = latents.latents[..., :frames], latents.level, None, steps
            runs[frames, steps] = lambda given=decoded: pipe.decode(*given)
    times, hop = seconds_of(runs, repeats), pipe.lctg.config.latent_hop / pipe.feature_extractor.sampling_rate
    few = TIMED_STEPS[0]
    for frames in dict.fromkeys(frames for frames, _ in runs):
        step, steps = steps_in_time({count: times[frames, count] for count in TIMED_STEPS}, frames * hop)
        rest = times[frames, few] - few * step
        rows[f"{frames * hop:.4g} s"] = {"s of a step": step, "s beside": rest, "steps in time": steps}
    return rows


def by_batch(pipe, repeats):
    """Seconds against the number of textures at once."""
    taken = timings({n: lambda n=n: pipe([RATINGS] * n) for n in BATCHES}, repeats)
    rows = {n: timed_columns(values, "whole s") for n, values in taken.items()}
    return {f"batch {n}": row | {"s per texture": row["whole s"] / n} for n, row in rows.items()}


def by_duration(pipe, repeats):
    """Seconds against the duration of a texture."""
    taken = timings({d: lambda d=d: pipe([RATINGS], duration_s=d) for d in DURATIONS}, repeats)
    rows = {d: timed_columns(values, "whole s") for d, values in taken.items()}
    return {f"{d:g} s": row | {"real-time factor": row["whole s"] / d} for d, row in rows.items()}


def memory(checkpoint):
    """Peak memory of the imports and of generating one texture; empty where it is not known."""
    peaks = {name: run_child(code, str(checkpoint))[1] for name, code in _CHILDREN.items()}
    return {name: {"peak MiB": peak} for name, peak in peaks.items() if peak is not None}


def main(argv=None):
    """Measures and writes speed.json and speed.md."""
    parser = make_parser("speed.py", "Time and memory of generating.")
    parser.add_argument("--repeats", type=count, default=5, metavar="N", help="the median counts; default: 5")
    arguments = parse(parser, argv)
    pipe = load_pipeline(arguments.checkpoint)
    tables = {
        "One segment": by_steps(pipe, arguments.repeats),
        "Steps that keep time": in_time(pipe, arguments.repeats),
        "Batch, default steps": by_batch(pipe, arguments.repeats),
        "Duration": by_duration(pipe, max(1, arguments.repeats // 2)),
        "Memory": memory(arguments.checkpoint),
    }
    where = machine()
    text = f"### Speed and memory\n\n{where}; medians of {arguments.repeats}. "
    text += "Spread: half the distance of the quartiles over the median.\n\n"
    text += "\n".join(f"#### {title}\n\n{timed_table(rows)}\n" for title, rows in tables.items())
    return finish(arguments, "speed", {"machine": where, **tables}, text)


if __name__ == "__main__":
    sys.exit(main())
