"""Work in parallel processes that neither outlive a killed parent nor leave it waiting for a killed child."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

#: A fork of this process would inherit the threads of torch and BLAS, which is unsafe; spawned workers would each
#: import the package, 6 s and 0.4 GB. The fork server imports it once, and its forks share that memory. Where there is
#: none (Windows), workers are spawned.
START_METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"


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
