"""What do many surfaces cost of which few are touched? Against decoding all of them.

`python examples/benchmarks/scene.py --output report`
"""

import json
import math
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from benchmarking import finish, machine, make_parser, parse, run_child

from tactile_diffusers.cli.program import load_pipeline
from tactile_diffusers.io.argument_types import count
from tactile_diffusers.playback import TextureProfile, TextureScene

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.tables import markdown_table, title

TOUCHED = 3
#: Surfaces that go through both stages at once where all are decoded: larger batches are no faster on a CPU.
BATCH = 16
#: Ratings are drawn between plus and minus this.
LARGEST_RATING = 1.0
CASES = ("pipeline alone", "scene", "scene from a file", "all decoded")
#: Columns and their digits.
COLUMNS = {name: (name, 2) for name in ("latents s", "first profile s", "all wanted s", "processor s")} | {
    name: (name, 0) for name in ("peak MiB", "above the pipeline MiB")
}
_CHILD = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); from scene import child; "
_CHILD += "child(*sys.argv[1:])"


def main(argv=None):
    """Measures and writes scene.json and scene.md."""
    parser = make_parser("scene.py", "What many surfaces cost of which few are touched.")
    parser.add_argument("--surfaces", type=count, default=100, metavar="N", help="in the scene; default: 100")
    parser.add_argument("--repeats", type=count, default=5, metavar="N", help="the median counts; default: 5")
    arguments = parse(parser, argv)
    pipe, number = load_pipeline(arguments.checkpoint), arguments.surfaces
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.safetensors"
        report = {
            "machine": machine(),
            "surfaces": number,
            "touched": min(TOUCHED, number),
            "repeats": arguments.repeats,
            "file": file_size(pipe, number, arguments.seed, path),
        }
        settings = (arguments.checkpoint, number, arguments.seed, torch.get_num_threads(), path)
        report["cases"] = measure(arguments.repeats, [str(value) for value in settings])
    loaded = report["cases"]["pipeline alone"].get("peak MiB", math.nan)
    for row in report["cases"].values():
        row["above the pipeline MiB"] = row.get("peak MiB", math.nan) - loaded
    return finish(arguments, "scene", report, markdown(report))


def draw_surfaces(number, seed):
    """Names and ratings."""
    ratings = np.random.default_rng(seed).uniform(-LARGEST_RATING, LARGEST_RATING, (number, 3))
    return {f"surface {index}": row for index, row in enumerate(ratings)}


def file_size(pipe, number, seed, path):
    """What a scene takes on disk, and how long it takes to write and to read, latents apart: a dict."""
    scene = TextureScene(draw_surfaces(number, seed), pipe, seed=seed)
    scene.friction_coefficient(scene.names[0])  # runs DALE
    begin = time.perf_counter()
    scene.save(path)
    written = time.perf_counter()
    TextureScene.load(path, pipe)
    read = time.perf_counter()
    size = path.stat().st_size
    return {
        "kB": size / 1e3,
        "kB per surface": size / 1e3 / number,
        "written in ms": 1e3 * (written - begin),
        "read in ms": 1e3 * (read - written),
    }


def measure(repeats, settings):
    """Case -> median seconds and "peak MiB" (Linux alone) over fresh processes; the cases take turns."""
    rows = {case: [] for case in CASES}
    for _ in range(repeats):
        for case in CASES:
            printed, peak = run_child(_CHILD, case, *settings)
            rows[case].append(json.loads(printed.splitlines()[-1]) | ({"peak MiB": peak} if peak else {}))
    return {case: pd.DataFrame(found).median().to_dict() for case, found in rows.items()}


def child(case, checkpoint, number, seed, threads, path):
    """Loads the pipeline, does what the case says, and prints the times since then as JSON. All arguments are text."""
    torch.set_num_threads(int(threads))
    pipe, surfaces = load_pipeline(checkpoint), draw_surfaces(int(number), int(seed))
    touched = min(TOUCHED, len(surfaces))
    begin, worked, times = time.perf_counter(), time.process_time(), {}
    if case == "all decoded":
        kept = []
        for profiles in _decode_all(pipe, surfaces, int(seed)):
            kept.extend(profiles)
            times.setdefault("first profile s", time.perf_counter() - begin)
        times["all wanted s"] = time.perf_counter() - begin
    elif case != "pipeline alone":
        scene = TextureScene(surfaces, pipe, seed=int(seed)) if case == "scene" else TextureScene.load(path, pipe)
        for name in scene.names[:touched]:
            scene.friction_coefficient(name)
            times.setdefault("latents s", time.perf_counter() - begin)
            scene.profile(name)
            times.setdefault("first profile s", time.perf_counter() - begin)
        times["all wanted s"] = time.perf_counter() - begin
    if times:
        times["processor s"] = time.process_time() - worked
    print(json.dumps(times))


def _decode_all(pipe, surfaces, seed):
    """Yields the profiles of each batch."""
    ratings = np.stack(list(surfaces.values()))
    for start in range(0, len(ratings), BATCH):
        out = pipe(ratings[start : start + BATCH], generator=torch.Generator("cpu").manual_seed(seed + start))
        yield [TextureProfile(texture, out.sampling_rate, out.reference_speed) for texture in out.textures]


def markdown(report):
    """The two tables."""
    number, touched = report["surfaces"], report["touched"]
    names = {"scene": f"scene, {touched} touched", "scene from a file": f"scene from a file, {touched} touched"}
    cases = {names.get(case, case): row for case, row in report["cases"].items()}
    about = (
        f"{number} surfaces of which {touched} are touched, against decoding all in batches of {BATCH}. Seconds in a "
        "fresh process, from the loaded pipeline to the latents of all, to the first profile, and to all that are "
        "wanted; processor time for all, which other work on the machine does not lengthen. "
        f"{report['machine']}; medians of {report['repeats']}."
    )
    return "\n\n".join(
        [
            title("What a scene costs", 4) + about,
            markdown_table(cases, labels=COLUMNS),
            f"The file of the {number} surfaces",
            markdown_table({"file": report["file"]}) + "\n",
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
