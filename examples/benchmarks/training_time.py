"""How long does it take from recordings to a checkpoint, and how much memory?

`python examples/benchmarks/training_time.py --output report`
"""

import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarking import finish, machine, resident_mib

from tactile_diffusers import bundled_checkpoint
from tactile_diffusers.cli.program import Parser, add_output_argument
from tactile_diffusers.io.argument_types import count
from tactile_diffusers.training.record import read_losses

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.result_files import conditions
from report.tables import markdown_table, title

SCRIPTS = Path(__file__).resolve().parents[1]
LAUNCHER = [sys.executable, "-m", "accelerate.commands.launch", "--cpu", "--num_processes", "1", "--num_machines", "1"]
LAUNCHER += ["--mixed_precision", "no", "--dynamo_backend", "no"]
#: The commands of examples/README.md, word for word, after `python` or `accelerate launch`.
PREPARE = (
    "prepare_data.py --source virtual --surfaces 600 --seconds 40 --workers 2 --output recordings.h5 "
    "--prepared prepared.h5"
)
LCTG = "train_lctg.py --train_data_dir prepared.h5 --max_train_steps 6000 --latent_penalty 0.002 --output_dir runs/lctg"
DALE = (
    "train_dale.py --train_data_dir prepared.h5 --pretrained_model_name_or_path runs/lctg --max_train_steps 4000 "
    "--output_dir runs/dale"
)
#: Steps that are run of each training, and after which of them a step's time is taken.
STEPS, WARM = 200, 50


def main(argv=None):
    """Measures and writes training.json and training.md."""
    parser = Parser(prog="training_time.py", description="Time and memory from recordings to a checkpoint.")
    add_output_argument(parser, "folder of the results, as JSON and Markdown")
    parser.add_argument("--surfaces", type=count, default=60, metavar="N", help="that are prepared and trained on; the "
        "rest is reckoned in proportion; default: 60")  # fmt: skip
    arguments = parser.parse_args(argv)
    arguments.conditions = conditions(bundled_checkpoint())
    where = machine("2 cores")
    with tempfile.TemporaryDirectory() as folder:
        rows = {
            "prepare_data.py": preparation(SCRIPTS, Path(folder), arguments.surfaces),
            "train_lctg.py": training(SCRIPTS, Path(folder), LCTG),
            "train_dale.py": training(SCRIPTS, Path(folder), DALE),
        }
    rows["together"] = {
        "minutes": sum(row["minutes"] for row in rows.values()),
        "peak MiB": max(row["peak MiB"] for row in rows.values()),
    }
    text = (
        f"{title('Time and memory of training', 4)}The three commands of examples/README.md, {where}. Measured: "
        f"{arguments.surfaces} of 600 surfaces prepared, {STEPS} of 4000 steps of each training, the rest in "
        "proportion to surfaces and steps; what comes before and after the steps counts once. Memory: largest sum over "
        f"a command's processes.\n\n{markdown_table(rows, 2)}\n"
    )
    return finish(arguments, "training", {"machine": where, "rows": rows}, text)


def preparation(scripts, folder, surfaces):
    """Prepares fewer virtual surfaces than README does: minutes and disk are reckoned for as many."""
    wanted = int(_option(PREPARE, "surfaces"))
    seconds, peak = watched([sys.executable, *_words(scripts, PREPARE, surfaces=surfaces)], folder)
    size = sum((folder / name).stat().st_size for name in ("recordings.h5", "prepared.h5"))
    scale = wanted / surfaces
    return {"minutes": seconds * scale / 60, "peak MiB": peak, "disk MiB": size * scale / 2**20}


def training(scripts, folder, command):
    """Runs the first steps of a training and reckons the rest: a dict."""
    wanted, output = int(_option(command, "max_train_steps")), _option(command, "output_dir")
    words = _words(scripts, command, max_train_steps=STEPS)
    seconds, peak = watched([*LAUNCHER, *words, "--report_to", "none"], folder)
    at = {entry["step"]: entry["seconds"] for entry in read_losses(folder / output)}
    step = (at[STEPS] - at[WARM]) / (STEPS - WARM)
    beside = seconds - at[STEPS]
    return {
        "minutes": (beside + step * wanted) / 60,
        "peak MiB": peak,
        "ms a step": 1e3 * step,
        "seconds beside": beside,
    }


def _option(command, name):
    words = shlex.split(command)
    return words[words.index(f"--{name}") + 1]


def _words(scripts, command, **changes):
    script, *words = shlex.split(command)
    for name, value in changes.items():
        words[words.index(f"--{name}") + 1] = str(value)
    return [str(scripts.resolve() / script), *words, "--quiet"]


def watched(words, folder):
    """Runs a command in a folder: seconds, and the largest memory in MiB of it and all that it started, at once.

    Pages that they share count for each; NaN where there is no /proc. A RuntimeError if it fails.
    """
    began, peak = time.monotonic(), float("nan")
    with tempfile.TemporaryFile("w+") as log:
        process = subprocess.Popen(words, cwd=folder, stdout=log, stderr=subprocess.STDOUT)
        try:
            while process.poll() is None:
                held = memory(process.pid)
                peak = held if held > peak or peak != peak else peak
                time.sleep(0.2)
        except BaseException:
            process.kill()
            raise
        seconds = time.monotonic() - began
        if process.returncode:
            log.seek(0)
            raise RuntimeError(f"{Path(words[-1]).name}: {' '.join(words)} failed:\n{log.read()[-1500:]}")
    return seconds, peak


def memory(pid):
    """Resident memory in MiB of a process and of all that it started; NaN where there is no /proc."""
    try:
        children = " ".join(path.read_text() for path in Path(f"/proc/{pid}").glob("task/*/children")).split()
    except OSError:  # it has just ended
        return float("nan")
    below = (memory(child) for child in children)
    return resident_mib(pid) + sum(value for value in below if value == value)


if __name__ == "__main__":
    sys.exit(main())
