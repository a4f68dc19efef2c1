"""Checkpoints and results in an output folder: each is whole or absent, even if the process is killed.

Folders are written, and removed, under a name that begins with "unfinished-"; the next start removes what is left.
"""

import os
import re
import shutil
from contextlib import contextmanager, suppress
from pathlib import Path

from safetensors import SafetensorError

#: Folder of the tracker, in the output folder.
LOGS = "logs"
_CHECKPOINT = re.compile(r"checkpoint-(\d+)")
_RESULT = "unfinished-result"
_UNFINISHED = re.compile(rf"unfinished-(removal-of-)?checkpoint-\d+|{_RESULT}")
_INDEX = "model_index.json"  # makes a folder a pipeline


def step_of(checkpoint):
    """The step in the name of a checkpoint folder; `None` for other names."""
    found = _CHECKPOINT.fullmatch(Path(checkpoint).name)
    return int(found[1]) if found else None


def checkpoints(output_dir):
    """The checkpoint folders in `output_dir`, by step. Half-written ones and foreign folders have other names."""
    found = [path for path in Path(output_dir).glob("checkpoint-*") if step_of(path) is not None]
    return sorted(found, key=step_of)


def latest_checkpoint(output_dir):
    """The checkpoint folder of the largest step in `output_dir`, or `None`."""
    return (checkpoints(output_dir) or [None])[-1]


def unfinished_checkpoint(output_dir, step):
    """Where the checkpoint of a step is written before `finish_checkpoint`."""
    return Path(output_dir) / f"unfinished-checkpoint-{step}"


def finish_checkpoint(folder):
    """Renames a written checkpoint to its final name, once it is on disk."""
    final = folder.with_name(folder.name.removeprefix("unfinished-"))
    _flush(folder)
    if final.is_dir():
        remove_checkpoint(final)
    os.replace(folder, final)
    _flush_names(final.parent)


def remove_checkpoint(folder):
    """Removes a checkpoint under another name: what a kill leaves of it must not look like a whole one."""
    aside = folder.with_name(f"unfinished-removal-of-{folder.name}")
    shutil.rmtree(aside, ignore_errors=True)
    os.replace(folder, aside)
    shutil.rmtree(aside, ignore_errors=True)


def clear_run(output_dir):
    """Removes the checkpoints and logs of an earlier training, for a new one."""
    for path in checkpoints(output_dir):
        remove_checkpoint(path)
    shutil.rmtree(Path(output_dir) / LOGS, ignore_errors=True)
    (Path(output_dir) / "log.jsonl").unlink(missing_ok=True)


def clear_unfinished(output_dir):
    """Removes what a killed training left half-written or half-removed, in a folder that this process has locked."""
    for path in Path(output_dir).iterdir():
        if _UNFINISHED.fullmatch(path.name):
            shutil.rmtree(path, ignore_errors=True)
        elif path.match(".*.tmp"):  # of `io.files.write_text`
            path.unlink(missing_ok=True)


@contextmanager
def writing(what, output_dir, temporary=None, finished=False):
    """Turns a failed write into an `OSError` that says what is missing and how to continue; removes `temporary` then.

    Args:
        what (`str`): the block writes.
        output_dir (`str` or `Path`): of the training.
        temporary (`Path`, *optional*): a folder that the block writes.
        finished (`bool`): whether the trained models are in the folder already.

    Raises:
        OSError: if the block raises `OSError`, or what safetensors and torch raise; after the training is finished,
            if it raises anything.
    """
    caught = (Exception,) if finished else (OSError, RuntimeError, SafetensorError)
    try:
        yield
    except caught as error:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)
        free = shutil.disk_usage(output_dir).free / 2**20
        if finished:
            advice = "The training is finished and its models are saved. Make room, then run it again"
        else:
            advice = f"{last_good(output_dir)} Make room, then continue"
        raise OSError(
            f"{what} could not be written to {output_dir}: {error} ({free:.1f} MiB are free there). {advice} with "
            "--resume_from_checkpoint latest."
        ) from error


def last_good(output_dir):
    """A sentence that names the checkpoint to continue from."""
    latest = latest_checkpoint(output_dir)
    return "There is no checkpoint yet." if latest is None else f"The last good checkpoint is {latest}."


def save_result(output_dir, save):
    """Writes the trained models: parts appear when all are whole, one by one, the pipeline's index last.

    Args:
        output_dir (`str` or `Path`): of the training. Other files in it stay.
        save (`Callable`): `save(folder)` writes into an empty folder, given as a `str`.

    Raises:
        OSError: if they cannot be written; what was there before is still there.
    """
    output, temporary = Path(output_dir), Path(output_dir) / _RESULT
    with writing("The trained models", output, temporary):
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir()
        save(str(temporary))
        _flush(temporary)
    # with the index of an earlier result, half-exchanged parts would look like a pipeline
    (output / _INDEX).unlink(missing_ok=True)
    for part in sorted(temporary.iterdir(), key=lambda path: path.name == _INDEX):
        target = output / part.name
        if target.is_dir():
            shutil.rmtree(target)
        os.replace(part, target)
    temporary.rmdir()
    _flush_names(output)


def _flush(folder):
    """Brings a folder's files, and their names, to the disk."""
    for path in folder.rglob("*"):
        if path.is_dir():
            _flush_names(path)
        else:
            with open(path, "rb") as file:
                os.fsync(file.fileno())
    _flush_names(folder)


def _flush_names(folder):
    with suppress(OSError):  # not every system flushes folders
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
