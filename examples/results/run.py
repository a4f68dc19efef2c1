#!/usr/bin/env python
"""Measures what the results pages state, of the bundled checkpoint, one step after the other on an idle machine.

    python examples/results/run.py                     # what is missing or stale: a night on two cores
    python examples/results/run.py --only speed --again
    python examples/results/run.py --check             # runs nothing; 1 if a figure is of other weights

Data sets are made from their seeds in --data. Each step writes its files, and `run.json` keeps under which conditions:
digest of the checkpoint, command, machine, load before it began, commit, date, seconds. A step that is done with the
present weights is not done again. Steps that time something wait until nothing else runs.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

from tactile_diffusers import bundled_checkpoint
from tactile_diffusers.io.files import write_text
from tactile_diffusers.pipelines.folders import folder_digest

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.result_files import IDLE, conditions

HERE = Path(__file__).parent
EXAMPLES, RECORD = HERE.parent, HERE / "run.json"
#: Longest time to wait for an idle machine, s.
PATIENCE = 1800


class Step(NamedTuple):
    """One command: its words after `python examples/`, what it makes, and whether it needs the machine for itself.

    {data} is the folder of data sets, {here} that of the results, {anchor} an option where one is given.
    """

    words: str
    makes: str
    timed: bool = False


VIRTUAL = "prepare_data.py --source virtual"
STEPS = {
    "data": Step(
        f"{VIRTUAL} --surfaces 600 --seconds 40 --workers 2 --output {{data}}/recordings.h5 "
        "--prepared {data}/prepared.h5",
        "{data}/prepared.h5",
    ),
    "data, six axes": Step(
        f"{VIRTUAL} --surfaces 250 --seconds 20 --seed 11 --further_axes regularity fineness warmth --validation 0 "
        "--test 50 --output {data}/axes_recordings.h5 --prepared {data}/axes.h5",
        "{data}/axes.h5",
    ),
    "data, other settings": Step(
        f"{VIRTUAL} --surfaces 260 --seconds 20 --seed 50 --impulsiveness 1.6 --agreement 0.7 --rating_correlation 0.2 "
        "-0.7 0.0 --validation 10 --test 50 --output {data}/settings_recordings.h5 --prepared {data}/settings.h5",
        "{data}/settings.h5",
    ),
    "recordings of another world": Step(
        "research/other_world.py --surfaces 260 {data}/other_recordings.h5", "{data}/other_recordings.h5"
    ),
    "data of another world": Step(
        "prepare_data.py --source recordings --recordings {data}/other_recordings.h5 --prepared {data}/other.h5 "
        "--validation 10 --test 50",
        "{data}/other.h5",
    ),
    "data card": Step(
        "inspect_data.py --recordings {data}/recordings.h5 --prepared {data}/prepared.h5 --output {here}/data",
        "{here}/data/card.json",
    ),
    "laws": Step("research/validate_virtual.py --output {here}/laws", "{here}/laws/validation.json"),
    "judges": Step(
        "evaluate.py --checkpoint bundled --data {data}/prepared.h5 --steps 1 2 3 5 10 --output {here}/judges",
        "{here}/judges/report.json",
    ),
    "steps": Step("benchmarks/decoder.py --data {data}/prepared.h5 --output {here}/steps", "{here}/steps/decoder.json"),
    "speed": Step(
        "benchmarks/peers.py --batches 1 16 --repeats 5 --output {here}/speed{anchor}",
        "{here}/speed/peers.json",
        timed=True,
    ),
    "speed of a call": Step("benchmarks/speed.py --output {here}/speed", "{here}/speed/speed.json", timed=True),
    "speed against error": Step(
        "benchmarks/speed_error.py --data {data}/prepared.h5 --output {here}/speed{anchor}",
        "{here}/speed/speed_error.json",
        timed=True,
    ),
    "preparing": Step(
        "benchmarks/data_loading.py --recordings {data}/recordings.h5 --output {here}/preparation",
        "{here}/preparation/data.json",
        timed=True,
    ),
    "many textures": Step("benchmarks/many_textures.py --output {here}/speed", "{here}/speed/dataset.json", timed=True),
    "without end": Step("benchmarks/endless.py --output {here}/real_time", "{here}/real_time/endless.json", timed=True),
    "other speeds": Step("benchmarks/stream.py --output {here}/real_time", "{here}/real_time/stream.json", timed=True),
    "a scene": Step("benchmarks/scene.py --output {here}/real_time", "{here}/real_time/scene.json", timed=True),
    "hard cases": Step(
        "benchmarks/stability.py --threads 1 --output {here}/hard_cases", "{here}/hard_cases/stability.json"
    ),
    "few surfaces": Step(
        'research/few_surfaces.py "another world={data}/other.h5" "recipe 3, other settings={data}/settings.h5" '
        "--output {here}/adaptation",
        "{here}/adaptation/figures.json",
    ),
    "fine tuning": Step(
        'research/fine_tuning.py "another world={data}/other.h5" "recipe 3, other settings={data}/settings.h5" '
        "--own {data}/prepared.h5 --output {here}/fine_tuning",
        "{here}/fine_tuning/figures.json",
    ),
    "a new axis": Step("research/new_axis.py {data}/axes.h5 --output {here}/new_axis", "{here}/new_axis/figures.json"),
    "first pages": Step("results/first_pages.py", "{here}/README.md"),
}


def record():
    """What `run.json` holds: step -> conditions."""
    return json.loads(RECORD.read_text()) if RECORD.is_file() else {}


def stale(found, digest):
    """Steps whose figures are of other weights than the bundled ones."""
    return [name for name, one in found.items() if one["checkpoint"]["sha256"] != digest]


def wait_until_idle():
    """Waits until nothing else runs; goes on after half an hour: the conditions tell the load."""
    begin = time.monotonic()
    while os.getloadavg()[0] > IDLE / 2 and time.monotonic() - begin < PATIENCE:
        time.sleep(5)


def run(name, data, anchor):
    """Runs a step: its conditions, or `None` if it failed."""
    import shlex

    step = STEPS[name]
    words = shlex.split(step.words.format(data=data, here=HERE, anchor=f" --anchor {anchor}" if anchor else ""))
    if step.timed:
        wait_until_idle()
    found = conditions(bundled_checkpoint()) | {
        "command": "python examples/"
        + step.words.format(data="DATA", here=HERE.name, anchor=" --anchor FOLDER" if anchor else "")
    }
    print(f"== {name}: {' '.join(words)}", flush=True)
    begin, made = time.time(), Path(step.makes.format(data=data, here=HERE))
    done = subprocess.run([sys.executable, EXAMPLES / words[0], *words[1:]])
    # a benchmark that wrote its figures and returns 1 says that a bound is missed: that is a result
    if done.returncode and not (made.exists() and made.stat().st_mtime >= begin):
        return None
    return found | {"seconds": round(time.time() - begin, 1)}


def main(argv=None):
    """Runs the command; 1 if a step failed or, with `--check`, figures are stale."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("runs") / "results", help="folder of the data sets")
    parser.add_argument("--anchor", type=Path, help="checkpoint of the paper's configuration, for the tables of speed")
    parser.add_argument("--only", nargs="+", choices=STEPS, metavar="STEP", help=f"of {', '.join(STEPS)}")
    parser.add_argument("--again", action="store_true", help="also what is done with the present weights")
    parser.add_argument("--check", action="store_true", help="run nothing: are figures of other weights?")
    args = parser.parse_args(argv)
    found, digest = record(), folder_digest(bundled_checkpoint())
    old = stale(found, digest)
    if args.check:
        print("\n".join(f"stale: {name}" for name in old) or "All figures are of the bundled checkpoint.")
        return int(bool(old))
    args.data.mkdir(parents=True, exist_ok=True)
    for name in args.only or STEPS:
        made = Path(STEPS[name].makes.format(data=args.data, here=HERE)).exists()
        if made and name in found and name not in old and not args.again:
            continue
        result = run(name, args.data, args.anchor)
        if result is None:
            print(f"{name} failed; the same command goes on here.", file=sys.stderr)
            return 1
        found[name] = result
        write_text(RECORD, json.dumps(found, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
