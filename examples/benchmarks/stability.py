"""Do hard cases stay within their bounds? `python examples/benchmarks/stability.py --output report`

Exit code 1 if one does not. The cases of numbers are in stability_signals.py, those of running are here.
"""

import logging
import math
import multiprocessing
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import numpy as np
import stability_signals as signals
import torch
from benchmarking import finish, machine, make_parser, parse, resident_mib
from stability_bench import RATINGS, SAME, SAME_DB, Bench, Row, not_finite, relative
from tqdm.auto import tqdm

from tactile_diffusers.cli.program import load_pipeline
from tactile_diffusers.io.argument_types import positive_number
from tactile_diffusers.pipelines import TactileTexturePipeline
from tactile_diffusers.playback import TextureProfile, TextureStream
from tactile_diffusers.playback.finger import FASTEST, FingerPath
from tactile_diffusers.playback.force_laws import SLOWEST_SLIDING, SPEED_EXPONENT
from tactile_diffusers.signal import DEVICE_RATE

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.tables import title

SENSOR_HZ, BLOCK = 125.0, 80
#: Speeds of random motion, mm/s: at rest, creeping, usual, and just not lifted.
EXTREMES = (0.0, 0.01, 1.0, 80.0, 300.0, 0.99 * FASTEST)
#: Length of a straight stroke, s.
STROKE_SECONDS = 0.4
#: Of a steady finger, mm/s: 100 m in ten minutes.
STEADY = 1e5 / 600
#: Memory that may come and go with allocators and caches, MiB: less than 10 kB for each of 1,000 textures.
MEMORY_MIB = 8.0
WARM_UP = 50


def held():
    """MiB that this process has asked for and not given back; the system may have put some aside, or files in."""
    return resident_mib(parts=("RssAnon", "VmSwap"))


def grown(begin):
    """MiB by which this process has grown; 0 anywhere but on Linux, where it is not known."""
    return float(np.nan_to_num(held() - begin))


def many(bench):
    """Textures in a row: memory, and whether the last is the first."""
    count = 5 if bench.quick else 1000
    warm = min(WARM_UP, count)

    def texture(number):
        return bench.pipe(RATINGS[:1], generator=torch.Generator().manual_seed(bench.seed + number)).textures

    first = texture(0)
    for number in range(warm):
        texture(number)
    begin = held()
    bad = sum(not_finite(texture(number)) for number in range(count))
    growth, case = grown(begin), f"{count} textures"
    yield Row(case, f"growth of memory after the first {warm + 1}", growth, MEMORY_MIB, "MiB")
    yield Row(case, "values that are not finite", bad, 0, "")
    yield Row(case, "the first seed again, largest difference", float(np.abs(texture(0) - first).max()), 0.0, "N")


def stream(bench):
    """Minutes of random motion between extremes, and a long way at a steady speed."""
    out = bench.pipe(RATINGS[:1], generator=bench.generator())
    profile = TextureProfile(out.textures[0], out.sampling_rate, out.reference_speed)
    place = extreme_motion(bench.minutes, bench.seed)
    yield from _extremes(profile, place, f"{bench.minutes:g} min of random motion, up to {max(EXTREMES):g} mm/s")
    yield from _far(profile, bench.minutes)


def extreme_motion(minutes, seed):
    """Places of a finger at the sensor's reports, mm: straight strokes of random speeds, some at rest."""
    rng, reports = np.random.default_rng(seed), round(STROKE_SECONDS * SENSOR_HZ)
    strokes = round(minutes * 60 / STROKE_SECONDS) + 1
    speed = rng.choice(EXTREMES, strokes) * rng.choice([-1, 1], strokes)
    return np.cumsum(np.repeat(speed, reports)) / SENSOR_HZ


def _blocks(follower, read, place):
    """Reports a path to what follows it, and yields what it answers, block by block."""
    number = 0
    for _ in range(int(len(place) / SENSOR_HZ * DEVICE_RATE) // BLOCK):
        while number < len(place) and number / SENSOR_HZ <= follower.time:
            follower.report(number / SENSOR_HZ, place[number])
            number += 1
        yield read(BLOCK)


def _extremes(profile, place, case):
    follower, bad, largest, begin = TextureStream(profile, 0.0, SENSOR_HZ), 0, 0.0, None
    warm = len(place) / SENSOR_HZ / 10
    for block in _blocks(follower, follower.read, place):
        if begin is None and follower.time > warm:
            begin = held()
        bad += not_finite(block)
        largest = max(largest, float(np.abs(block).max()))
    yield Row(case, "values that are not finite", bad, 0, "")
    yield Row(case, "largest force over the profile's own", largest / _loudest(profile), 1.0, "")
    yield Row(case, "growth of memory after a tenth of it", grown(begin), MEMORY_MIB, "MiB")


def _loudest(profile):
    """Largest force of steady fingers, up to twice the fastest: where it turns, its path is led ahead. N."""
    found, speeds = [], np.geomspace(1, 2 * FASTEST, 120)
    for speed, faster in pairwise(speeds):  # of the speeds between two of these, the faster one has the largest gain
        place = np.arange(0, profile.length, profile.pitch / 2)
        texture = profile.read(place, np.full(len(place), speed))
        found.append(np.abs(texture).max() * (max(faster, SLOWEST_SLIDING) / profile.reference_speed) ** SPEED_EXPONENT)
    return max(found)


def _far(profile, minutes):
    """Where a steady finger is read after a long way, in samples of the profile, and what it then feels."""
    case = f"{STEADY * minutes * 60 / 1e3:g} m at a steady speed"
    place = STEADY * np.arange(round(minutes * 60 * SENSOR_HZ)) / SENSOR_HZ
    path, follower = FingerPath(DEVICE_RATE, SENSOR_HZ), TextureStream(profile, 0.0, SENSOR_HZ)
    for position, _ in _blocks(path, path.advance, place):
        found = position[:, 0]
    for force in _blocks(follower, follower.read, place):
        felt = force
    wanted = STEADY * (path.time - np.arange(BLOCK, 0, -1) / DEVICE_RATE)
    error = np.abs(found - wanted).max() / profile.pitch
    yield Row(case, "place, error in samples of the profile", float(error), 0.01, "samples")
    law = (STEADY / profile.reference_speed) ** SPEED_EXPONENT
    texture = -law * profile.read(wanted, np.full(BLOCK, STEADY))
    yield Row(case, "force, RMS of the error over RMS", relative(felt, texture), 0.01, "")


def threads(bench):
    """Other numbers of torch's threads; pipelines in Python's threads."""
    before, reference = torch.get_num_threads(), bench.reference
    try:
        for count in (1, 2) if bench.quick else (1, 2, 3, 4):
            torch.set_num_threads(count)
            yield from bench.against(f"{count} of torch", bench.make(), SAME, reference=reference)
    finally:
        torch.set_num_threads(before)
    again = 1 if bench.quick else 10
    apart, shared = [bench.copy() for _ in range(2)], [TactileTexturePipeline.from_pipe(bench.pipe) for _ in range(2)]
    for name, pipes in (("two pipelines", apart), ("two pipelines of the same weights", shared)):
        with ThreadPoolExecutor(2) as pool:
            made = list(pool.map(lambda pipe: [bench.make(pipe).textures for _ in range(again)], pipes))
        worst = max(relative(textures, bench.reference.textures) for one in made for textures in one)
        yield Row(f"{name} in two threads", "waveform, RMS of the error over RMS", worst, SAME, "")


def processes(bench):
    """Workers that are forked, where that is possible, or spawned."""
    reference = bench.reference  # workers have it, too
    for method in sorted({"fork", "spawn"} & set(multiprocessing.get_all_start_methods())):
        with multiprocessing.get_context(method).Pool(2, _receive, (bench,)) as pool:
            # a worker that stands still would otherwise be waited for
            made = pool.map_async(_texture, range(4), chunksize=1).get(timeout=bench.limit)
        worst = max(relative(one, reference.textures) for one in made)
        yield Row(f"two workers, {method}", "waveform, RMS of the error over RMS", worst, SAME, "")


def _receive(bench):
    global _BENCH
    torch.set_num_threads(1)  # torch's own threads do not survive a fork
    _BENCH = bench


def _texture(_):
    return _BENCH.make().textures


def compiled(bench):
    """Both models in one graph each; quick: without making code of it."""
    pipe = bench.copy()
    for model in (pipe.dale, pipe.lctg):
        model.compile(fullgraph=True, backend="eager" if bench.quick else "inductor")
    yield from bench.against("both models, fullgraph", bench.make(pipe), SAME)


#: Kinds of cases: functions of a `Bench` that yield rows. First those that watch memory: what other cases have given
#: back to the allocator would hide growth.
CASES = {
    "many in a row": many,
    "stream": stream,
    "precision": signals.precision,
    "ratings": signals.ratings,
    "guidance": signals.guidance,
    "steps": signals.steps,
    "level": signals.levels,
    "length": signals.lengths,
    "input": signals.inputs,
    "sampling rate": signals.sampling_rates,
    "threads": threads,
    "processes": processes,
    "compiled": compiled,
}


def measure(bench, cases, quiet=True):
    """Rows of `cases`, as `CASES`; what raises an error is a row that fails, and the other cases go on."""
    rows = []
    for name, case in tqdm(cases.items(), disable=quiet, desc="cases"):
        try:
            rows.extend(row._replace(case=f"{name}: {row.case}") for row in case(bench))
        except Exception as error:  # of any kind: it is what this suite looks for
            words = " ".join(f"{type(error).__name__}: {error}".split())[:200].replace("|", "/")
            rows.append(Row(f"{name}: stopped", words, math.nan, 0.0, ""))
    return rows


def main(argv=None):
    """Measures and writes stability.json, stability.md and stability.png; returns 1 if a row misses its bound."""
    parser = make_parser("stability.py", "Hard cases, each against a bound.")
    parser.add_argument("--minutes", type=positive_number, default=10.0, help="of the stream; default: 10")
    parser.add_argument("--quick", action="store_true", help="the same cases, fewer steps and repetitions")
    arguments = parse(parser, argv)
    bench = Bench(load_pipeline(arguments.checkpoint), arguments.seed, arguments.quick, arguments.minutes)
    logging.disable(logging.WARNING)  # ratings out of range are the point
    try:
        rows = measure(bench, CASES, arguments.quiet)
    finally:
        logging.disable(logging.NOTSET)
    report = {
        "machine": machine(),
        "seed": arguments.seed,
        "quick": arguments.quick,
        "passed": sum(row.passed for row in rows),
        "count": len(rows),
        "missed": table([row for row in rows if not row.passed]),
        "rows": [row._asdict() | {"passed": row.passed} for row in rows],
    }
    plot(rows, arguments.output / "stability.png")
    finish(arguments, "stability", report, markdown(report, rows))
    return 0 if all(row.passed for row in rows) else 1


def markdown(report, rows):
    """What was measured and why bounds are what they are, and the table."""
    about = (
        f"{sum(row.passed for row in rows)} of {len(rows)} within their bounds; {report['machine']}; seed "
        f"{report['seed']}. Errors are those of the worst of {len(RATINGS)} textures, against what float32 makes of "
        "the same noise; a value that is not finite fails. Bounds: where only the order of float32 operations differs, "
        f"{SAME:.1e} of the RMS (a hundred roundings) and {SAME_DB:g} dB; of a coarser type five of its roundings, and "
        "0.1 dB (0.5 dB for weights of 8 bits), far below the 2.2 dB that a fingertip tells apart; what is generated "
        "within 9 standard deviations of the training set, as its farthest texture is; more steps gain at "
        "least half of what their order promises."
    )
    return f"{title('Hard cases', 4)}{about}\n\n{table(rows)}\n"


def table(rows):
    """The rows as Markdown."""
    lines = ["| case | what is measured | value | at most | unit | |", "|---" * 6 + "|"]
    for row in rows:
        verdict = "pass" if row.passed else "**FAIL**"
        lines.append(f"| {row.case} | {row.measured} | {row.value:.3g} | {row.bound:.3g} | {row.unit} | {verdict} |")
    return "\n".join(lines)


def plot(rows, path):
    """Value over bound of every row, by kind of case; those whose bound is zero stand at either end."""
    from matplotlib.figure import Figure

    kinds = {}
    for row in rows:
        share = row.value / row.bound if row.bound else 0.0 if row.passed else math.inf
        kinds.setdefault(row.case.split(":")[0], []).append((share, row.passed))
    figure = Figure(figsize=(7, 0.32 * len(kinds) + 1.2), layout="constrained")
    panel = figure.subplots()
    for place, found in enumerate(kinds.values()):
        shares = np.clip(np.nan_to_num([share for share, _ in found], nan=np.inf), 1e-4, 1e2)
        colours = ["tab:blue" if passed else "tab:red" for _, passed in found]
        panel.scatter(shares, np.full(len(shares), place), c=colours, s=14, alpha=0.6, linewidths=0)
    labels = [f"{kind} ({sum(not passed for _, passed in found)} of {len(found)})" for kind, found in kinds.items()]
    panel.set(xscale="log", xlabel="value / bound", yticks=range(len(kinds)), yticklabels=labels)
    panel.invert_yaxis()
    panel.axvline(1, color="black", linewidth=0.8)
    figure.suptitle("Hard cases (bounds missed, of rows)", fontsize=11)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


if __name__ == "__main__":
    sys.exit(main())
