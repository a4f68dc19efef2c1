"""Trains a row of an ablation with the training scripts, as a user would; what is finished is not trained again."""

import contextlib
import hashlib
import importlib.util
import io
import json
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from tactile_diffusers.io.files import write_text
from tactile_diffusers.io.locks import locked_folder

#: What the command asks of the scripts unless a row says otherwise.
DEFAULTS = {"report_to": "none", "checkpointing_steps": 200, "validation_samples": 16}
#: File in a stage's folder that says what is trained there.
DIGEST = "ablation.sha256"
#: Sections of a row's model that train_dale.py reads; train_lctg.py reads the others.
OF_DALE = ("dale", "dale_scheduler", "kept_at_zero")
#: Lines of a log that are shown when a training fails.
LOG_LINES = 15
#: One process on the CPU, whatever this machine's own accelerate settings are.
LAUNCHER = [sys.executable, "-m", "accelerate.commands.launch", "--cpu", "--num_processes", "1", "--num_machines", "1"]
LAUNCHER += ["--mixed_precision", "no", "--dynamo_backend", "no"]


class TrainingFailed(RuntimeError):
    """A training script ended with an error; the message holds the last lines of its log."""


@dataclass(frozen=True)
class Stage:
    """One run of a training script.

    Attributes:
        script (`str`): "train_lctg.py" or "train_dale.py".
        folder (`Path`): its output, a whole pipeline when it is finished.
        options (`dict`): its arguments.
        digest (`str`): of what it learns from: model, arguments, data, and the stages before.
    """

    script: str
    folder: Path
    options: dict
    digest: str

    @property
    def log(self):
        """What the script printed."""
        return self.folder.with_suffix(".log")

    @property
    def finished(self):
        """Whether the folder holds the result of this very training."""
        return (self.folder / "model_index.json").is_file() and self.stored_digest == self.digest

    @property
    def stored_digest(self):
        """What the folder says that it holds; `None` = nothing."""
        path = self.folder / DIGEST
        return path.read_text(encoding="utf-8", errors="replace").strip() if path.is_file() else None


def stages(row, folder, data, known=None):
    """The trainings of a row, one after the other.

    Args:
        row (`Row`): what to train.
        folder (`Path`): of the row.
        data (`Path`): a prepared data set.
        known (`dict`, *optional*): digest -> `Stage` of other rows, to which these are added: what learns the same from
            the same is trained once.

    Returns:
        `list[Stage]`: phase-1, phase-2, ..., and dale if the row asks for it.
    """
    planned = [("train_lctg.py", f"phase-{i}", {**row.arguments, **phase}) for i, phase in enumerate(row.train, 1)]
    if row.dale is not None:
        planned.append(("train_dale.py", "dale", row.dale))
    made, known = [], {} if known is None else known
    digest = _digest([model_of(row, "train_lctg.py"), os.stat(data).st_size])
    for script, name, arguments in planned:
        model = model_of(row, script)
        # LCTG's model is part of the first digest
        digest = _digest([digest, script, arguments, *([model] if model and name == "dale" else [])])
        configured = model and (not made or name == "dale")
        options = {
            "train_data_dir": str(data),
            "output_dir": str(folder / name),
            "pretrained_model_name_or_path": str(made[-1].folder) if made else None,
            "model_config_name_or_path": str(model_file(folder, script)) if configured or not made else None,
            "resume_from_checkpoint": "latest",
            "validation_steps": arguments["max_train_steps"],
            "quiet": True,
            **DEFAULTS,
            **arguments,
        }
        made.append(known.setdefault(digest, Stage(script, folder / name, options, digest)))
    return made


def _digest(state):
    return hashlib.sha256(json.dumps(state, sort_keys=True).encode()).hexdigest()


def model_of(row, script):
    """The sections of a row's model that a script reads."""
    return {name: part for name, part in row.model.items() if (name in OF_DALE) == (script == "train_dale.py")}


def model_file(folder, script):
    """Where the model config of a row stands."""
    return folder / ("dale.json" if script == "train_dale.py" else "model.json")


def check_stages(row, planned, scripts):
    """Lets the scripts check their arguments, and refuses folders that hold something else, before any work.

    Raises:
        ValueError: naming the row's file and what its script says, or the folder.
    """
    for stage in planned:
        message = io.StringIO()
        try:
            with contextlib.redirect_stderr(message):
                _load(scripts / stage.script).parse_args(_words(stage.options))
        except (SystemExit, ValueError) as error:
            said = message.getvalue().strip().splitlines()[-1:] or [str(error)]
            raise ValueError(f"{row.path}: {stage.folder.name} is refused by {stage.script}: {said[0]}") from error
        if stage.folder.exists() and stage.stored_digest is None and any(stage.folder.iterdir()):
            raise ValueError(
                f"{stage.folder} was not made by this command (it has no file {DIGEST}). Move it away, or give another "
                "--output."
            )


def _load(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _words(options):
    """{"seed": 3, "quiet": True, "use_ema": False} -> --seed=3 --quiet --no-use_ema; `None` leaves an option out."""
    words = []
    for name, value in options.items():
        if isinstance(value, bool):
            words.append(f"--{name}" if value else f"--no-{name}")
        elif value is not None:
            words.append(f"--{name}={value}")
    return words


def train(row, planned, scripts, threads):
    """Runs the stages of a row that are not finished; one that was cut off goes on from its last checkpoint.

    A folder that holds a training with other settings is emptied first.

    Args:
        row (`Row`): its model config is written beside the stages.
        planned (`list[Stage]`): from `stages`.
        scripts (`Path`): folder of the training scripts.
        threads (`int`): of each training.

    Raises:
        TrainingFailed: if a script ends with an error.
        ValueError: if a folder that must be emptied is in use by a training that a killed command left behind.
    """
    for stage in planned:
        if stage.finished:
            continue
        stage.folder.mkdir(parents=True, exist_ok=True)
        if stage.stored_digest != stage.digest:
            _empty(stage.folder)
        write_text(stage.folder / DIGEST, stage.digest + "\n")
        text = json.dumps(model_of(row, stage.script), indent=2) + "\n"
        write_text(model_file(stage.folder.parent, stage.script), text)
        code = _launch([str(scripts / stage.script), *_words(stage.options)], stage.log, threads)
        if code:
            lines = "\n".join(stage.log.read_text(encoding="utf-8", errors="replace").splitlines()[-LOG_LINES:])
            raise TrainingFailed(f"{stage.script} ended with exit code {code}; the last lines of {stage.log}:\n{lines}")


def _empty(folder):
    """Removes what another training left; not what says that the folder is ours, or a kill would make it foreign."""
    with locked_folder(folder):
        for path in folder.iterdir():
            if path.is_dir():
                shutil.rmtree(path)
            elif path.name != DIGEST:
                path.unlink()


def _launch(words, log, threads):
    """Exit code of a training in a process of its own, which does not outlive this one."""
    launcher = [*LAUNCHER, "--num_cpu_threads_per_process", str(threads)]
    environment = {**os.environ, "OMP_NUM_THREADS": str(threads)}
    with open(log, "a", encoding="utf-8") as file:
        process = subprocess.Popen(
            [*launcher, *words], stdout=file, stderr=subprocess.STDOUT, env=environment, start_new_session=True
        )
        try:
            return process.wait()
        except BaseException:  # accelerate's child too: two trainings in one folder would spoil it
            os.killpg(process.pid, signal.SIGTERM)
            process.wait()
            raise


def training_facts(planned):
    """What the logs of finished stages say.

    Raises:
        ValueError: if a log does not say so.

    Returns:
        `dict`: "step_seconds" (median over LCTG's intervals between log entries), "training_seconds" of all stages,
        "loss" (LCTG's last velocity loss), and, with a DALE, "dale_step_seconds" and "dale_loss" likewise.
    """
    from tactile_diffusers.training.record import read_log

    seconds, paces, losses = 0.0, {"step_seconds": [], "dale_step_seconds": []}, {}
    for stage in planned:
        entries = read_log(stage.folder)
        timed = [(0, 0.0)] + [(entry["step"], entry["seconds"]) for entry in entries if "seconds" in entry]
        seconds += timed[-1][1]
        of_dale = stage.script == "train_dale.py"
        steps = [(b[1] - a[1]) / (b[0] - a[0]) for a, b in zip(timed, timed[1:], strict=False) if b[0] > a[0]]
        paces["dale_step_seconds" if of_dale else "step_seconds"] += steps
        velocity = [entry["train/velocity"] for entry in entries if "train/velocity" in entry]
        if not (velocity and paces["step_seconds"]):
            raise ValueError(
                f"{stage.folder / 'log.jsonl'} is damaged: it holds no losses, or not how long they took. Delete the "
                f"folder {stage.folder} to train it again."
            )
        losses["dale_loss" if of_dale else "loss"] = velocity[-1]
    medians = {name: sorted(pace)[len(pace) // 2] for name, pace in paces.items() if pace}
    return {**medians, "training_seconds": seconds, **losses}
