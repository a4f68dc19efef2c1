"""Virtual surfaces, explored and rated, written to `recordings.h5`: in parallel, and resumable.

Every surface is explored into a small file of its own, in a folder beside the result, and renamed when it is whole; at
the end they are copied into one file. Whatever is killed, and when, what is done stays done and no file is half
written.
"""

import json
import os
import shutil
from pathlib import Path

from tqdm import tqdm

from ..data.recordings import RecordingsFile, RecordingsWriter
from ..io.files import write_text
from ..io.locks import locked_folder
from ..io.reading import read_json
from ..signal import DEVICE_RATE, RATING_AXES
from .collection import Collection, truth_fields
from .exploration import VELOCITY_RATE
from .raters import RATERS
from .workers import run_in_processes

SOURCE, LICENCE = "virtual surfaces", "CC0-1.0"
SETTINGS_FILE = "collection.json"
MERGED_FILE = "merged.h5"


def generate_recordings(
    path,
    surfaces,
    seconds,
    explorers=2,
    seed=0,
    agreement=1.0,
    quiet=False,
    *,
    raters=RATERS,
    rater_moisture=0.0,
    axis_correlation=0.0,
    duration_spread=0.0,
    workers=1,
):
    """Writes recordings, ratings and truth of virtual surfaces.

    An interrupted call leaves the folder `<path>.partial`; the same call goes on from there, also with other `surfaces`
    or `workers`. The result is the same bit for bit; one that is there already is left as it is. Disk: twice the
    result, while it is put together. Memory: about 1 MB per worker and second of recording, beside the interpreter.

    Args:
        path (`str` or `Path`): `recordings.h5` to write; one call at a time.
        surfaces (`int`): number of surfaces.
        seconds, explorers, seed, agreement, raters, rater_moisture, axis_correlation, duration_spread: of `Collection`.
        quiet (`bool`): no progress bar.
        workers (`int`): processes that explore; 1 = this one.

    Raises:
        ValueError: if an argument is out of range, or the folder holds surfaces of other settings, or is in use.
        FileNotFoundError: if the folder of `path` does not exist.
        ChildProcessError: if a worker was killed.
    """
    settings = seconds, explorers, seed, agreement, raters, rater_moisture, axis_correlation, duration_spread
    collection = Collection(*settings)
    for name, value in (("surfaces", surfaces), ("workers", workers)):
        if not value >= 1 or value % 1:
            raise ValueError(f"`{name}` must be a whole number of at least 1, got {value}.")
    path, surfaces, workers = Path(os.path.realpath(path)), int(surfaces), int(workers)  # of a link, what it points to
    if _is_done(path, collection, surfaces):
        parts = _parts_of(path)
        if parts.is_dir():
            with locked_folder(parts):
                _remove(parts)
        return
    parts = _parts_of(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"The folder {path.parent} of {path.name} does not exist: create it first.")
    parts.mkdir(exist_ok=True)
    with locked_folder(parts):
        _check_parts(parts, collection)
        _generate(path, parts, collection, surfaces, quiet, workers)


def _generate(path, parts, collection, surfaces, quiet, workers):
    missing = [index for index in range(surfaces) if not _is_whole(_part(parts, index))]
    tasks = [(parts, collection, index) for index in missing]
    with tqdm(total=surfaces, initial=surfaces - len(tasks), desc=SOURCE, unit="surface", disable=quiet) as bar:
        try:
            for _ in _explore(tasks, workers):
                bar.update()
        except ChildProcessError as error:
            raise ChildProcessError(
                f"{error}. The surfaces that are done are kept in {parts}: call again, with fewer `workers` or shorter "
                "recordings."
            ) from error
    _merge(parts, collection, surfaces)
    os.replace(parts / MERGED_FILE, path)
    _remove(parts)


def _explore(tasks, workers):
    if workers > 1 and len(tasks) > 1:
        yield from run_in_processes(write_part, tasks, workers)
    else:
        for task in tasks:
            yield write_part(*task)


def _check_parts(parts, collection):
    """Checks the folder of finished surfaces against the settings of the collection, and cleans it."""
    settings, wanted = parts / SETTINGS_FILE, collection.attributes
    if not settings.is_file():
        write_text(settings, json.dumps(wanted, indent=1) + "\n")
    stored = read_json(settings, "settings of virtual surfaces", f"Delete the folder {parts}.")
    others = [name for name in {**stored, **wanted} if stored.get(name) != wanted.get(name)]
    if others:
        differences = ", ".join(f"{name} {stored.get(name)}, not {wanted.get(name)}" for name in others)
        raise ValueError(
            f"{parts} holds surfaces of other settings, by its {SETTINGS_FILE} ({differences}). Finish them with those "
            "settings, or delete the folder."
        )
    for left_behind in parts.glob(".*.tmp"):  # by a call that was killed
        left_behind.unlink(missing_ok=True)


def _parts_of(path):
    return path.with_name(path.name + ".partial")


def _is_done(path, collection, surfaces):
    """Whether the result is there: who calls again may have been killed in what came after, hours later."""
    try:
        with RecordingsFile(path) as done:
            told, count = done.attributes, len(done.surfaces)
    except (FileNotFoundError, ValueError):
        return False
    same = all(told.get(name) == value for name, value in collection.attributes.items())
    return same and count == surfaces


def _part(parts, index):
    return parts / f"{index}.h5"


def _is_whole(part):
    """Whether a surface is done. A file that a power cut truncated is not."""
    try:
        RecordingsFile(part).close()
    except (FileNotFoundError, ValueError):
        return False
    return True


def write_part(parts, collection, index):
    """Explores one surface by all explorers into a file of its own."""
    surface, seconds = collection.surface(index), collection.duration(index)
    with RecordingsWriter(_part(parts, index), SOURCE, LICENCE) as writer:
        for number in range(collection.explorers):
            force, velocity = surface.explore(number, seconds)
            rates = {"force_rate": DEVICE_RATE, "velocity_rate": VELOCITY_RATE}
            writer.add_recording(surface.name, f"explorer-{number}", "0", force=force, velocity=velocity, **rates)


def _merge(parts, collection, surfaces):
    """Puts finished surfaces, ratings and truth into one file of the same folder, so that a kill litters no other."""
    known = [collection.surface(index) for index in range(surfaces)]
    names = [surface.name for surface in known]
    with RecordingsWriter(parts / MERGED_FILE, SOURCE, LICENCE, **collection.attributes) as writer:
        for index in range(surfaces):
            with RecordingsFile(_part(parts, index)) as part:
                writer.copy_recordings(part)
        raters = [f"rater-{number}" for number in range(collection.raters)]
        writer.set_ratings(collection.answers(known), raters, names, RATING_AXES)
        writer.set_truth(names, truth_fields(known))


def _remove(parts):
    """Deletes the folder, settings last: without them, what is left would pass for surfaces of the next call."""
    for part in parts.glob("*.h5"):
        part.unlink()
    shutil.rmtree(parts)
