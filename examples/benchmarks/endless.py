"""Are textures without end seamless and in time, generated while they are played?

`python examples/benchmarks/endless.py --output report`
"""

import multiprocessing
import sys
import time
from pathlib import Path

import numpy as np
from benchmarking import finish, machine, make_parser, parse, resident_mib
from moving_finger import BLOCK, BUDGET, SENSOR_HZ, delays, largest_step, motion, play
from tqdm.auto import tqdm

from tactile_diffusers import TactileTexturePipeline
from tactile_diffusers.cli.program import load_pipeline
from tactile_diffusers.io.argument_types import positive_number
from tactile_diffusers.playback import EndlessProfile, EndlessStream, GeneratingProcess, on_time
from tactile_diffusers.playback.endless import HANDOVER
from tactile_diffusers.playback.stream import FADE_SECONDS
from tactile_diffusers.playback.window_generator import OVERLAP
from tactile_diffusers.signal import DEVICE_RATE, band_levels_db

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.tables import markdown_table, title

#: Surfaces that follow each other, and how often ratings change, s.
RATINGS = ([1.5, 0.0, -1.0], [-1.0, 1.0, 0.0], [0.0, -1.0, 1.0], [1.0, 1.0, 1.0], [-1.5, 0.0, 0.5])
CHANGE_SECONDS = 2.0
#: Windows in which joints are compared with what lies between them; of each surface.
WINDOWS = 24
#: Starts and changes that are timed.
TIMES = 9
#: Share of the minutes for which the columns beside a process of its own are timed.
COMPARED = 0.2


def main(argv=None):
    """Measures and writes endless.json and endless.md."""
    parser = make_parser("endless.py", "Textures without end, generated while they are played.")
    parser.add_argument("--minutes", type=positive_number, default=10.0, help="of random motion; default: 10")
    arguments = parse(parser, argv)
    checkpoint, quiet = arguments.checkpoint, arguments.quiet
    pipe = load_pipeline(checkpoint)
    pipes = {"undistilled decoder": TactileTexturePipeline.from_pipe(pipe, lctg_distilled=None)}
    if pipe.lctg_distilled is not None:
        pipes["distilled decoder"] = pipe
    report = {
        "machine": machine(),
        "minutes": arguments.minutes,
        "joints": joints(pipe, quiet),
        "starts": all_starts(pipes),
        "real time": real_time(list(pipes.values())[-1], arguments.minutes, arguments.seed, quiet),
    }
    return finish(arguments, "endless", report, markdown(report))


def all_starts(pipes):
    """Times to the first sample and to other ratings, with each decoder, and the last one in a process of its own."""
    with on_time():
        found = {name: starts(one) for name, one in pipes.items()}
        with GeneratingProcess(list(pipes.values())[-1]) as process:
            found[f"{list(pipes)[-1]}, in a process"] = starts(process)
    return found


def real_time(pipe, minutes, seed, quiet):
    """Random motion, generating in a thread or in a process; and how late the machine alone wakes a program."""
    place = motion(minutes, seed)
    with on_time():
        found = {"in a thread": clock(pipe, place, minutes * COMPARED, quiet)}
        with GeneratingProcess(pipe) as process:
            found["in a process"] = clock(process, place, minutes, quiet)
    found["waking, of the machine"] = wakes(minutes * COMPARED, quiet)
    fastest = float(np.abs(np.diff(place)).max() * SENSOR_HZ)
    own = 1e3 * max(largest_step(one, fastest) for one in profiles(pipe))
    for name in ("in a thread", "in a process"):
        found[name]["profiles' own mN"] = own
    return found


def markdown(report):
    """The tables."""
    names = dict.fromkeys(name for row in report["real time"].values() for name in row)
    rows = {name: {column: row.get(name) for column, row in report["real time"].items()} for name in names}
    parts = [
        f"{title('Without end', 4)}Windows of fresh takes are generated in a thread while they are played. Where two "
        f"meet, against the middle of windows; {report['machine']}:",
        markdown_table({"joints": report["joints"]}),
        f"{title('Starting and changing', 4)}From ratings to the first sample, and from new ratings until they alone "
        "are felt, on a warm pipeline:",
        markdown_table(report["starts"], 1),
        f"{title('In real time', 4)}Under random motion, ratings changed every {CHANGE_SECONDS:g} s, blocks of {BLOCK} "
        f"samples, generated on one core by a `GeneratingProcess` ({report['minutes']:g} minutes) or by a thread "
        f"({report['minutes'] * COMPARED:g}); an underrun is a block that comes more than one block late. The last "
        "column is how late this machine wakes a program that does nothing else, while another one computes:",
        markdown_table(rows, 3) + "\n",
    ]
    return "\n\n".join(parts)


def joints(pipe, quiet):
    """Level and bands where windows meet, against the middle of windows, and how they agree: means over surfaces."""
    begin, end = (edge * OVERLAP / (1 - OVERLAP) for edge in HANDOVER)
    levels, bands, agreement = [], [], []
    for seed, ratings in enumerate(tqdm(RATINGS, disable=quiet, desc="joints")):
        profile, speed = EndlessProfile(pipe, ratings, seed), pipe.dale.config.reference_speed
        samples = round((end - begin) * profile.spacing / speed * DEVICE_RATE)
        pieces = {"joint": [], "middle": []}
        for index in range(1, WINDOWS):
            profile.generate(index - 1, index)
            for name, place in (("joint", begin), ("middle", 0.5)):
                x = (index + place) * profile.spacing + np.arange(samples) * speed / DEVICE_RATE
                pieces[name].append(profile.read(x - profile.window_length / 2, np.full(samples, speed)))
                if name == "joint":
                    one, other = (
                        profile.windows[k].read(x - k * profile.spacing, np.full(samples, speed))
                        for k in (index - 1, index)
                    )
                    agreement.append(np.corrcoef(one, other)[0, 1])
        power = {name: np.mean(np.square(rows)) for name, rows in pieces.items()}
        levels.append(10 * np.log10(power["joint"] / power["middle"]))
        spectra = {name: 10 ** (band_levels_db(np.stack(rows), DEVICE_RATE) / 10) for name, rows in pieces.items()}
        bands.append(10 * np.log10(spectra["joint"].mean(0) / spectra["middle"].mean(0)))
    return {
        "level, dB": float(np.mean(levels)),
        "largest of nine bands, dB": float(max(np.mean(bands, axis=0), key=abs)),
        "correlation of two windows": float(np.mean(agreement)),
    }


def starts(pipe):
    """Time from ratings to the first sample, and from new ratings until they alone are felt; `pipe` or a process."""
    first, changes = [], []
    for number in range(TIMES + 1):  # the first one warms up
        begin = time.perf_counter()
        with EndlessStream(EndlessProfile(pipe, RATINGS[0], number), SENSOR_HZ) as stream:
            stream.read(1)
            first.append(time.perf_counter() - begin)
            while stream.profile.missing():
                time.sleep(0.001)
            before, begin = stream.profile, time.perf_counter()
            stream.change(RATINGS[1])
            while stream.profile is before:
                time.sleep(0.0005)
            changes.append(time.perf_counter() - begin + FADE_SECONDS)
    return {
        "first sample ms": 1e3 * float(np.median(first[1:])),
        "change felt ms": 1e3 * float(np.median(changes[1:])),
        "slowest change ms": 1e3 * float(max(changes[1:])),
    }


def clock(pipe, place, minutes, quiet):
    """Random motion in real time, while windows are generated and ratings change: a dict; `pipe` or a process."""
    blocks, changes = round(minutes * 60 * DEVICE_RATE / BLOCK), round(CHANGE_SECONDS / BUDGET)
    memory, busy, began = [], time.process_time(), time.perf_counter()
    with EndlessStream(EndlessProfile(pipe, RATINGS[0]), SENSOR_HZ) as stream:

        def change(index):
            if (index + 1) % changes == 0:
                stream.change(RATINGS[index // changes % len(RATINGS)])
            if index % round(5 / BUDGET) == 0:
                memory.append(resident_mib())

        stream.read(BLOCK)
        times, late, found = play(stream, place, blocks, change, quiet, "endless", in_real_time=True)
    wall, quarter = time.perf_counter() - began, max(1, len(memory) // 4)
    return delays(times) | {
        "over budget": int((times > BUDGET).sum()),
        "underruns": late,
        "reading, share of a core": float(times.sum() / wall),
        "all, share of a core": (time.process_time() - busy) / wall,
        "windows stood in for": stream.substituted,
        "memory MiB": float(np.mean(memory[-quarter:])),
        "its growth MiB": float(np.mean(memory[-quarter:]) - np.mean(memory[quarter : 2 * quarter] or memory)),
        **found,
    }


def wakes(minutes, quiet):
    """How late the machine itself wakes a program that sleeps from block to block while another computes: a dict."""
    late = np.empty(round(minutes * 60 * DEVICE_RATE / BLOCK))
    other = multiprocessing.get_context("spawn").Process(target=_compute, daemon=True)
    other.start()
    start = time.perf_counter() + 1.0  # it has begun by then
    for index in tqdm(range(len(late)), disable=quiet, desc="machine", mininterval=5):
        time.sleep(max(0.0, start + index * BUDGET - time.perf_counter()))
        late[index] = time.perf_counter() - start - index * BUDGET
    other.terminate()
    return delays(late) | {"over budget": int((late > BUDGET).sum())}


def _compute():
    while True:
        np.sin(np.arange(10_000))


def profiles(pipe, windows=6):
    """Some windows of every surface, for the steps that they have of their own."""
    made = []
    for ratings in RATINGS:
        profile = EndlessProfile(pipe, ratings)
        profile.generate(*range(windows))
        made.extend(profile.windows.values())
    return made


if __name__ == "__main__":
    sys.exit(main())
