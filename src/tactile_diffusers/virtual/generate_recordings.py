"""Virtual surfaces, explored and rated, written to `recordings.h5`."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

from tqdm import tqdm

from ..data.recordings import RecordingsWriter
from ..io.files import clear_left_behind
from ..signal import DEVICE_RATE
from ..signal.checks import check_whole_number
from ..signal.constants import VIRTUAL_SOURCE
from .collection import Collection
from .exploration import VELOCITY_RATE

LICENCE = "CC0-1.0"
#: A fork of this process would inherit the threads of torch and BLAS, which is unsafe; spawned workers would each
#: import the package, 6 s and 0.4 GB. The fork server imports it once, and its forks share that memory. Where there is
#: none (Windows), workers are spawned.
START_METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"


def generate_recordings(
    path,
    surfaces,
    seconds,
    quiet=False,
    workers=1,
    **settings,
):
    """Writes recordings and ratings of virtual surfaces: about 2 ms for each second of recording.

    Args:
        path (`str` or `Path`): `recordings.h5` to write; it appears when it is complete.
        surfaces (`int`): number of surfaces.
        seconds (`float`): duration of a recording.
        quiet (`bool`): no progress bar.
        workers (`int`): processes that explore; 1 = this one. The result does not depend on it.
        **settings: further ones of `Collection`, such as `explorers` and `seed`.

    Raises:
        ValueError: if an argument is out of range.
        FileNotFoundError: if the folder of `path` does not exist.
        ChildProcessError: if a worker was killed.
    """
    collection = Collection(seconds, **settings)
    surfaces, workers = check_whole_number("surfaces", surfaces), check_whole_number("workers", workers)
    clear_left_behind(path)
    with RecordingsWriter(path, VIRTUAL_SOURCE, LICENCE, **collection.attributes) as writer:
        known = [collection.surface(index) for index in range(surfaces)]
        tasks = [(collection, index) for index in range(surfaces)]
        explored = run_in_order(explore, tasks, workers)
        bar = tqdm(explored, total=surfaces, desc=VIRTUAL_SOURCE, unit="surface", disable=quiet)
        for surface, recordings in zip(known, bar, strict=True):
            for number, (force, velocity) in enumerate(recordings):
                rates = {"force_rate": DEVICE_RATE, "velocity_rate": VELOCITY_RATE}
                writer.add_recording(surface.name, f"explorer-{number}", "0", force=force, velocity=velocity, **rates)
        raters = [f"rater-{number}" for number in range(collection.raters)]
        writer.set_ratings(
            collection.answers(known), raters, [surface.name for surface in known], collection.rating_axes
        )


def explore(collection, index):
    """Force and velocity of one surface, by all explorers of a collection: a list of pairs."""
    surface = collection.surface(index)
    return [surface.explore(number, collection.seconds) for number in range(collection.explorers)]


def run_in_order(function, tasks, workers):
    """Runs `function` on every task and yields the results in order, two per worker ahead of the reader at most.

    Each worker computes on one thread: nothing here uses BLAS, and scipy's FFT uses one by default.

    Args:
        function (`callable`): picklable, and so are its results.
        tasks (`Sequence[tuple]`): arguments of each call, picklable.
        workers (`int`): processes; 1 = this one.

    Raises:
        ChildProcessError: if a worker was killed.
        Exception: the first that `function` raised.
    """
    if workers == 1:
        yield from (function(*task) for task in tasks)
        return
    context = multiprocessing.get_context(START_METHOD)
    if START_METHOD == "forkserver":
        context.set_forkserver_preload([function.__module__])
    with ProcessPoolExecutor(min(workers, len(tasks)), context, initializer=_begin_worker) as pool:
        waiting = deque()
        try:
            for task in tasks:
                waiting.append(pool.submit(function, *task))
                if len(waiting) > 2 * workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        except BrokenProcessPool as error:
            raise ChildProcessError(
                "a worker process was killed, most likely for want of memory: use fewer `workers` or shorter recordings"
            ) from error
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _begin_worker():
    """An interrupt is the parent's to handle; a worker ends with its parent, even if that was killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent():
    multiprocessing.parent_process().join()
    os._exit(1)
