"""The part of a model card that tells of trainings: commands, losses, time and machine."""

import shlex
import shutil
from pathlib import Path

from ..io.files import atomic_path
from ..io.reading import reading
from .record import read_log, read_losses, read_record

#: Arguments of a training that say nothing about its result.
_SILENT = {
    *("quiet", "resume_from_checkpoint", "overwrite_output_dir", "checkpoints_total_limit"),
    *("logging_dir", "tracker_project_name"),
    *("cache_dir", "push_to_hub", "hub_model_id", "hub_private_repo"),
}

RUN = """### {title}

```bash
accelerate launch {script}{arguments}
```
{defaults}
{segments} segments, {steps} optimiser steps, {time} on {machine}{processes}; {versions}.
{losses}"""


def describe_run(run, folder, number):
    """One training as Markdown, from `training.json` and `log.jsonl`.

    Args:
        run (`Path`): its output folder.
        folder (`Path`): of the card; the loss curve is copied into it.
        number (`int`): of the training, for the name of that copy.

    Returns:
        `str`

    Raises:
        ValueError: if `training.json` is damaged or lacks something.
    """
    with reading(run / "training.json", "the record of a training", "Copy it again from where it was written."):
        text = _run_in_words(run)
    return "\n\n".join(filter(None, [text, _picture(run, folder, number)]))


def _run_in_words(run):
    record, losses, log = read_record(run), read_losses(run), read_log(run)
    validations = [entry for entry in log if any(key.startswith("validation/") for key in entry)]
    told = [f"Last training loss {losses[-1]['train/loss']:.4f}"] if losses else []
    if validations:
        found = [(k.split("/")[1], v) for k, v in validations[-1].items() if k.startswith("validation/")]
        told.append("last validation: " + ", ".join(f"{name} {value:.3f}" for name, value in found))
    processes = record.get("processes", 1)
    return RUN.format(
        title=run.resolve().name,
        script=record["script"],
        arguments="".join(f" \\\n    {word}" for word in _words(_told(record))),
        defaults="\nWhat is not named has its default.\n" if "changed" in record else "",
        segments=record["segments"],
        steps=record["steps"],
        time=_time(losses[-1]["seconds"]) if losses and "seconds" in losses[-1] else "an unknown time",
        machine=record["machine"],
        processes=f", {processes} processes" if processes > 1 else "",
        versions=", ".join(f"{name} {version}" for name, version in record["versions"].items()),
        losses="; ".join(told) + "." if told else "",
    ).strip()


def _time(seconds):
    return f"{seconds:.0f} s" if seconds < 120 else f"{seconds / 60:.0f} minutes"


def _told(record):
    """Arguments of a training that tell what was done: those that are not the defaults, where that was recorded."""
    if "changed" in record:
        return record["changed"]
    return {name: value for name, value in record["arguments"].items() if value is not False}  # what is off is default


def _words(arguments):
    """Arguments of a command, without those that say nothing about the result, and without this machine's folders."""
    for name, value in arguments.items():
        # without a tracker the command runs anywhere; which one there was says nothing
        if name in _SILENT or (name == "report_to" and value != "none"):
            continue
        if isinstance(value, bool):
            yield f"--{name}" if value else f"--no-{name}"
            continue
        values = value if isinstance(value, list | tuple) else [value]
        yield " ".join([f"--{name}", *(shlex.quote(Path(str(v)).name if "/" in str(v) else str(v)) for v in values)])


def _picture(run, folder, number):
    """The loss curve of a training as Markdown; empty if there is none."""
    curve, name = run / "loss.png", f"loss_{number}.png"
    if not curve.is_file():
        return ""
    if run.resolve() == folder.resolve():
        name = curve.name  # it is there already
    else:
        with atomic_path(folder / name) as temporary:
            shutil.copyfile(curve, temporary)
    return f"![loss of {run.resolve().name}]({name})"
