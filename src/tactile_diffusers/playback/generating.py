"""Generation in a process of its own, which a stream of short blocks does not share its Python with."""

import itertools
import multiprocessing
import threading

import torch

from .on_time import on_time


class GeneratingProcess:
    """A second process that generates windows for [`EndlessProfile`]s, in place of a pipeline.

    Threads of one Python process take turns: a block that is read while another thread generates may come
    milliseconds late. This process and the reading one share nothing but the finished windows. Making one waits
    until it has started, several seconds in which it imports PyTorch, half a minute on a busy machine: make it when the
    program starts, not when a finger comes. It takes the memory of another pipeline, and, as always in Python, a script
    that does so keeps its own work behind `if __name__ == "__main__":`. Close it, or use it in a `with`.

    Args:
        pipe (`TactileTexturePipeline`): on the CPU, or a device that several processes may use; it is copied.
        threads (`int`, *optional*, defaults to 1): cores that it may use.

    Raises:
        ValueError: if `threads` is not positive.
        RuntimeError: if the process cannot be started.
    """

    def __init__(self, pipe, threads=1):
        if threads < 1:
            raise ValueError(f"`threads` must be at least 1, got {threads}.")
        self.pipe, self._keys, self._busy = pipe, itertools.count(), threading.Lock()
        context = multiprocessing.get_context("spawn")  # a fork of a process with threads may stand still
        self._connection, theirs = context.Pipe()
        interrupts, self._interrupts = context.Pipe(duplex=False)
        arguments = (pipe, theirs, interrupts, threads)
        self._process = context.Process(target=_serve, args=arguments, name="tactile_diffusers", daemon=True)
        self._process.start()
        theirs.close()
        interrupts.close()
        self._receive()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Ends the process."""
        self.interrupt()
        with self._busy:
            self._connection.close()
        self._process.join(timeout=5)
        if self._process.is_alive():
            self._process.terminate()

    def new_key(self):
        """A name for another profile."""
        return next(self._keys)

    def interrupt(self):
        """What is being generated is not needed any more."""
        try:
            self._interrupts.send(None)
        except OSError:  # it has ended: nothing is being generated
            pass

    def generate(self, key, surface, indices, near, ready):
        """Windows of one surface.

        Args:
            key (`int`): of the profile (`new_key`).
            surface (`tuple`): arguments of [`EndlessProfile`] but for the pipeline, the last ones as a dict.
            indices (`list[int]`): of the windows.
            near (`list[int]`): windows near the finger, which are kept.
            ready (`bool`): as for `EndlessProfile.generate`.

        Returns:
            `tuple`: windows (`dict[int, TextureProfile]`; without those that were interrupted), level and friction
            coefficient.

        Raises:
            RuntimeError: if generating has failed, or the process has ended.
        """
        with self._busy:
            try:
                self._connection.send((key, surface, indices, near, ready))
            except OSError as error:
                raise RuntimeError("The generating process has ended.") from error
            return self._receive()

    def _receive(self):
        try:
            failure, made = self._connection.recv()
        except (EOFError, OSError) as error:
            raise RuntimeError(f"The generating process has ended (exit code {self._process.exitcode}).") from error
        if failure is not None:
            raise RuntimeError(f"Generating has failed: {failure}")
        return made


def _serve(pipe, connection, interrupts, threads):
    """What the process does: answers requests until the connection is closed."""
    pipe.set_progress_bar_config(disable=True)
    threading.Thread(target=_watch, args=(pipe, interrupts), daemon=True).start()
    profiles = {}
    with on_time():  # its garbage collector would make the finger wait, too
        torch.set_num_threads(threads)
        connection.send((None, None))
        while True:
            try:
                request = connection.recv()
            except (EOFError, OSError):
                return
            try:
                answer = None, _answer(pipe, profiles, *request)
            except Exception as error:  # of any kind: the other process raises it
                answer = repr(error), None
            connection.send(answer)


def _answer(pipe, profiles, key, surface, indices, near, ready):
    from .endless import EndlessProfile

    if key not in profiles:
        for old in list(profiles)[:-1]:  # the last one is played until this one replaces it
            del profiles[old]
        ratings, seed, fill, options = surface
        profiles[key] = EndlessProfile(pipe, ratings, seed, fill, **options)
    profile = profiles[key]
    profile._recent = dict.fromkeys(near, 0)
    profile.generate(*indices, ready=ready)
    there = {index: profile._windows[index] for index in indices if index in profile._windows}
    return there, profile.level, profile.friction_coefficient


def _watch(pipe, interrupts):
    while True:
        try:
            interrupts.recv()
        except EOFError:
            return
        pipe._interrupt = True
