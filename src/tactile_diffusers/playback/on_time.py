"""Fewer delays by Python itself, for programs that deliver blocks on time: `on_time`."""

import gc
import sys
from contextlib import contextmanager

import torch

#: How often threads take turns, s: Python's own 5 ms are longer than a block of 32 samples lasts.
SWITCH_SECONDS = 5e-4


@contextmanager
def on_time():
    """Lets a stream read short blocks on time while another thread generates. Enter it when the models are loaded.

    - Threads take turns every 0.5 ms, not every 5.
    - The garbage collector ignores the objects that exist already: looking through all objects of the libraries stops
      every thread for 0.1 to 0.2 s.
    - PyTorch leaves one core to the stream.

    These are settings of the whole process. They are restored at the end.
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
