#!/usr/bin/env python
"""Measures what the results pages state, of the bundled checkpoint, one step after the other on an idle machine.

    python examples/results/run.py                     # what is missing or stale: a night on two cores
    python examples/results/run.py --quick             # a check: shorter steps, few textures, pages in runs/quick
    python examples/results/run.py --only speed --again
    python examples/results/run.py --check             # runs nothing; 1 if a figure is of other weights

Data sets are made from their seeds in --data. Each step writes its files, and `run.json` keeps under which conditions:
digest of the checkpoint, command, data, machine, load before it began, commit, date, seconds. A step that is done with
the present weights is not done again. Steps that time something wait until nothing else runs.
"""

import argparse
import json
import os
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

from tactile_diffusers import bundled_checkpoint
from tactile_diffusers.data import PreparedDataset
from tactile_diffusers.io.files import write_text
from tactile_diffusers.pipelines.folders import folder_digest

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.result_files import IDLE, conditions, stamp

HERE = Path(__file__).parent
EXAMPLES = HERE.parent
#: Longest time to wait for an idle machine, s.
PATIENCE = 1800


class Step(NamedTuple):
    """Commands, their words after `python examples/` with "; " between them, and what they make.

    {data} is the folder of data sets, {out} that of the results, {slides} a file that is not ours to share. `quick`
    are further words of the last command for a check, `None` = it is left out there. `page` is a page that the commands
    write, to which a line of conditions is added; `shown` a folder whose files, not folders, are copied beside what is
    made.
    """

    words: str
    makes: str
    quick: str | None = None
    timed: bool = False
    page: str | None = None
    shown: str | None = None


VIRTUAL = "prepare_data.py --source virtual"
EVALUATE = "evaluate.py --checkpoint bundled --data"
ABLATE = "research/ablate.py --data {data}/prepared.h5 --seeds 0 1 --threads 2 --quiet"
ANCHOR = "--anchor {data}/paper/as_published-seed-0/dale"
WORLDS = '"another world={data}/other.h5" "recipe 3, other settings={data}/settings.h5"'
STEPS = {
    "data": Step(
        f"{VIRTUAL} --surfaces 600 --seconds 40 --workers 2 --output {{data}}/recordings.h5 "
        "--prepared {data}/prepared.h5",
        "{data}/prepared.h5",
        "--surfaces 80 --seconds 12 --validation 8 --test 12",
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
    "data of another world": Step(
        "research/other_world.py --surfaces 260 {data}/other_recordings.h5; prepare_data.py --source recordings "
        "--recordings {data}/other_recordings.h5 --prepared {data}/other.h5 --validation 10 --test 50",
        "{data}/other.h5",
    ),
    "data card": Step(
        "inspect_data.py --recordings {data}/recordings.h5 --prepared {data}/prepared.h5 --output {out}/data",
        "{out}/data/card.json",
        "",
    ),
    "laws": Step("research/validate_virtual.py --output {out}/laws", "{out}/laws/validation.json", "--quick"),
    "paper's configuration": Step(
        f"{ABLATE} --rows examples/configs/paper --only as_published all_mends --shorten 2 --output {{data}}/paper",
        "{out}/paper_rows/ablation.json",
        shown="{data}/paper",
    ),
    "speed": Step(
        f"benchmarks/peers.py --batches 1 16 --repeats 5 --output {{out}}/speed {ANCHOR}",
        "{out}/speed/peers.json",
        timed=True,
    ),
    "speed of a call": Step(
        "benchmarks/speed.py --output {out}/speed", "{out}/speed/speed.json", "--repeats 2", timed=True
    ),
    "speed against error": Step(
        f"benchmarks/speed_error.py --data {{data}}/prepared.h5 --output {{out}}/speed {ANCHOR}",
        "{out}/speed/speed_error.json",
        timed=True,
    ),
    "preparing": Step(
        "benchmarks/data_loading.py --recordings {data}/recordings.h5 --output {out}/preparation",
        "{out}/preparation/data.json",
        "",
        timed=True,
    ),
    "many textures": Step(
        "benchmarks/many_textures.py --output {out}/speed", "{out}/speed/dataset.json", "--textures 400", timed=True
    ),
    "without end": Step(
        "benchmarks/endless.py --output {out}/real_time", "{out}/real_time/endless.json", "--minutes 0.3", timed=True
    ),
    "other speeds": Step(
        "benchmarks/stream.py --output {out}/real_time",
        "{out}/real_time/stream.json",
        "--surfaces 8 --minutes 0.3",
        timed=True,
    ),
    "a scene": Step(
        "benchmarks/scene.py --output {out}/real_time", "{out}/real_time/scene.json", "--repeats 2", timed=True
    ),
    "hard cases": Step(
        "benchmarks/stability.py --threads 1 --output {out}/hard_cases", "{out}/hard_cases/stability.json", "--quick"
    ),
    "long textures": Step(
        "benchmarks/long_textures.py --output {out}/hard_cases",
        "{out}/hard_cases/long_textures.json",
        "--textures 2 --duration_s 10",
    ),
    "judges": Step(
        f"{EVALUATE} {{data}}/prepared.h5 --steps 1 2 3 5 10 --output {{out}}/judges",
        "{out}/judges/report.json",
        "--quick --steps 1 2",
    ),
    "steps": Step(
        "benchmarks/decoder.py --data {data}/prepared.h5 --output {out}/steps", "{out}/steps/decoder.json", "--few"
    ),
    "latents": Step(
        "research/latents.py --data {data}/prepared.h5 --quiet --output {out}/latents",
        "{out}/latents/latents.json",
        "",
    ),
    "solvers": Step(
        "research/sampler.py --data {data}/prepared.h5 --segments 24 --quiet --output {out}/scheduler",
        "{out}/scheduler/scheduler.json",
        page="{out}/scheduler/scheduler.md",
    ),
    "design": Step(
        f"{ABLATE} --shorten 2 --output {{data}}/ablation", "{out}/ablation/ablation.json", shown="{data}/ablation"
    ),
    "audio distance": Step(
        "research/audio_distance.py --data {data}/prepared.h5 --output {out}/audio",
        "{out}/audio/audio_distance.json",
        page="{out}/audio/audio_distance.md",
    ),
    "few surfaces": Step(
        f"research/few_surfaces.py {WORLDS} --output {{out}}/adaptation",
        "{out}/adaptation/figures.json",
        page="{out}/adaptation.md",
    ),
    "fine tuning": Step(
        f"research/fine_tuning.py {WORLDS} --own {{data}}/prepared.h5 --output {{out}}/fine_tuning",
        "{out}/fine_tuning/figures.json",
        page="{out}/fine_tuning.md",
    ),
    "a new axis": Step("research/new_axis.py {data}/axes.h5 --output {out}/new_axis", "{out}/new_axis/figures.json"),
    "editing": Step(
        "research/editing.py --data {data}/prepared.h5 --output {out}/editing",
        "{out}/editing/editing.json",
        page="{out}/editing/editing.md",
    ),
    "comparisons": Step(
        "research/preference.py --output {out}",
        "{out}/preference.md",
        "--people 8 --listeners 1",
        page="{out}/preference.md",
    ),
    "sensitivity": Step(
        "research/sensitivity.py --output {out}/sensitivity",
        "{out}/sensitivity/sensitivity.json",
        page="{out}/sensitivity/sensitivity.md",
    ),
    "real recordings": Step(
        "research/biotac.py {slides} {data}/biotac.h5 {data}/biotac_prepared.h5; train_lctg.py --train_data_dir "
        "{data}/biotac_prepared.h5 --max_train_steps 1500 --validation_samples 0 --lr_warmup_steps 100 --output_dir "
        "{data}/biotac --overwrite_output_dir; evaluate.py --checkpoint {data}/biotac --data {data}/biotac_prepared.h5 "
        "--sections reconstruction --steps 5 10 --per-surface 16 --output {out}/biotac/trained; prepare_data.py "
        "--source recordings --recordings {data}/biotac.h5 --prepared {data}/biotac20.h5 --no_limits --validation 0 "
        f"--test 3; {EVALUATE} {{data}}/biotac20.h5 --sections reconstruction --steps 1 --per-surface 16 --output "
        "{out}/biotac",
        "{out}/biotac/report.json",
    ),
    "first pages": Step("results/first_pages.py --results {out}", "{out}/README.md", ""),
}


def record(out):
    """What `run.json` holds: step -> conditions."""
    path = out / "run.json"
    return json.loads(path.read_text()) if path.is_file() else {}


def stale(found, digest):
    """Steps whose figures are of other weights than the bundled ones."""
    return [name for name, one in found.items() if one["checkpoint"]["sha256"] != digest]


def wait_until_idle():
    """Waits until nothing else runs; goes on after half an hour: the conditions tell the load."""
    begin = time.monotonic()
    while os.getloadavg()[0] > IDLE / 2 and time.monotonic() - begin < PATIENCE:
        time.sleep(5)


def measured_on(words):
    """The prepared data set that a command is given, or `None`."""
    for word in words[1:]:
        path = Path(word.rpartition("=")[2])
        if path.suffix == ".h5" and path.is_file():
            try:
                return PreparedDataset(path, "train")
            except ValueError:  # recordings
                continue
    return None


def run(name, quick, **paths):
    """Runs a step with its `paths`, {data} and others: its conditions, or `None` if it failed."""
    step = STEPS[name]
    commands = step.words.split("; ")
    if quick:
        commands[-1] += f" {step.quick}"
    commands = [shlex.split(command.format(**paths)) for command in commands]
    if step.timed and not quick:
        wait_until_idle()
    found = conditions(bundled_checkpoint(), measured_on(commands[-1]))
    found["command"] = "; ".join(f"python examples/{one}" for one in step.words.split("; ")).format(
        **{"data": "DATA", "out": paths["out"].name, "slides": "biotac_slide.h5"}
    )
    begin, made = time.time(), Path(step.makes.format(**paths))
    writes = Path(step.shown.format(**paths)) / made.name if step.shown else made
    for words in commands:
        print(f"== {name}: {shlex.join(words)}", flush=True)
        done = subprocess.run([sys.executable, EXAMPLES / words[0], *words[1:]])
        # a benchmark that wrote its figures and returns 1 says that a bound is missed: that is a result
        if done.returncode and not (writes.exists() and writes.stat().st_mtime >= begin):
            return None
    if step.shown:
        made.parent.mkdir(parents=True, exist_ok=True)
        for path in filter(Path.is_file, writes.parent.iterdir()):
            shutil.copy(path, made.parent)
    if step.page:
        page = Path(step.page.format(**paths))
        write_text(page, f"{page.read_text().rstrip()}\n\n{stamp(found)}\n")
    return found | {"seconds": round(time.time() - begin, 1)}


def main(argv=None):
    """Runs the command; 1 if a step failed or, with `--check`, figures are stale."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="folder of the data sets; default: runs/results, runs/quick/data")
    parser.add_argument("--output", type=Path, help="default: the committed pages; with --quick: runs/quick/results")
    parser.add_argument("--slides", type=Path, help="biotac_slide.h5; without it real recordings are left out")
    parser.add_argument("--quick", action="store_true", help="a check: shorter steps with few textures")
    parser.add_argument("--only", nargs="+", choices=STEPS, metavar="STEP", help=f"of {', '.join(STEPS)}")
    parser.add_argument("--again", action="store_true", help="also what is done with the present weights")
    parser.add_argument("--check", action="store_true", help="run nothing: are figures of other weights?")
    args = parser.parse_args(argv)
    out = args.output or (Path("runs/quick/results") if args.quick else HERE)
    data = args.data or Path("runs/quick/data" if args.quick else "runs/results")
    found, digest = record(out), folder_digest(bundled_checkpoint())
    old = stale(found, digest)
    if args.check:
        print("\n".join(f"stale: {name}" for name in old) or "All figures are of the bundled checkpoint.")
        return int(bool(old))
    data.mkdir(parents=True, exist_ok=True)
    out.mkdir(parents=True, exist_ok=True)
    for name in args.only or STEPS:
        step = STEPS[name]
        made = Path(step.makes.format(data=data, out=out)).exists()
        lacks = (args.quick and step.quick is None) or ("{slides}" in step.words and args.slides is None)
        if lacks or (made and name in found and name not in old and not args.again):
            continue
        result = run(name, args.quick, data=data, out=out, slides=args.slides)
        if result is None:
            print(f"{name} failed; the same command goes on here.", file=sys.stderr)
            return 1
        found[name] = result
        write_text(out / "run.json", json.dumps(found, indent=1) + "\n")
    print(f"{sum(one.get('seconds', 0) for one in found.values()) / 60:.0f} minutes in all.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
