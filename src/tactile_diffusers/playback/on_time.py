"""Python's own delays, for programs that deliver blocks on time: `on_time`."""

import gc
import sys
from contextlib import contextmanager

import torch

#: How often threads take turns, s: Python's own 5 ms are longer than a block of 32 samples lasts.
SWITCH_SECONDS = 5e-4


@contextmanager
def on_time():
    """Within it, Python disturbs a stream that reads short blocks while another thread generates as little as it can.

    - Threads take turns every 0.5 ms, not every 5.
    - The garbage collector leaves alone what is there already: looking through all objects of the libraries holds every
      thread up for 0.1 to 0.2 s.
    - PyTorch leaves one core to the stream.

    All of this is the whole process's, and as it was afterwards. Enter it when models are loaded.
    """
    interval, threads = sys.getswitchinterval(), torch.get_num_threads()
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(SWITCH_SECONDS)
    torch.set_num_threads(max(1, threads - 1))
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        sys.setswitchinterval(interval)
        gc.unfreeze()
