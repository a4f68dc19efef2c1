"""A finger that moves at random over a stream, block by block: what comes late, and the largest step of the force."""

import time

import numpy as np
from scipy import signal
from tqdm.auto import tqdm

from tactile_diffusers.playback.force_laws import SPEED_EXPONENT
from tactile_diffusers.signal import DEVICE_RATE

BLOCK = 32
#: What a block lasts, s.
BUDGET = BLOCK / DEVICE_RATE
#: Reports of the sensor in the timed runs.
SENSOR_HZ = 125.0
#: Random motion: it strokes to and fro at most about this often, over about twice this far.
STROKES_HZ, STROKES_MM = 1.0, 30.0


def motion(minutes, seed):
    """Random motion as a sensor of 125 Hz and 0.1 mm reports it: mm."""
    slow = signal.butter(4, STROKES_HZ, fs=SENSOR_HZ, output="sos")
    moved = signal.sosfilt(slow, np.random.default_rng(seed).standard_normal(round(minutes * 60 * SENSOR_HZ) + 9))
    return np.round(STROKES_MM * moved / moved.std(), 1)


def play(stream, place, blocks, before, quiet, name, in_real_time=False):
    """Reads blocks while a finger moves.

    Args:
        stream (`TextureStream`): that is read.
        place (`np.ndarray`): mm, of the finger, `SENSOR_HZ` times a second.
        blocks (`int`): that are read.
        before (`Callable`): called with the number of each block before it is read.
        quiet (`bool`), name (`str`): of the progress bar.
        in_real_time (`bool`): whether to wait until each block is due.

    Returns:
        `tuple[np.ndarray, int, dict]`: seconds of each block, blocks that come more than one block late, and the
        largest step and whether all is finite.
    """
    times, late, step, last, finite, number = np.empty(blocks), 0, 0.0, 0.0, True, 0
    start = time.perf_counter()
    for index in tqdm(range(blocks), disable=quiet, desc=name, mininterval=5):
        while number / SENSOR_HZ <= stream.time and number < len(place):
            stream.report(number / SENSOR_HZ, place[number])
            number += 1
        before(index)
        if in_real_time:
            time.sleep(max(0.0, start + index * BUDGET - time.perf_counter()))
        begin = time.perf_counter()
        force = stream.read(BLOCK)
        times[index] = time.perf_counter() - begin
        late += time.perf_counter() > start + (index + 2) * BUDGET
        step = max(step, float(np.abs(np.diff(force, prepend=last)).max()))
        last, finite = force[-1], finite and bool(np.isfinite(force).all())
    return times, int(late), {"largest step mN": 1e3 * step, "finite": finite}


def delays(seconds):
    """Median, 99.9th percentile and largest of times in s: ms."""
    found = {"median": np.median(seconds), "99.9th percentile": np.percentile(seconds, 99.9), "largest": seconds.max()}
    return {f"{name} ms": 1e3 * float(value) for name, value in found.items()}


def largest_step(profile, fastest):
    """Of the force, at the fastest speed, with the law of speed: N."""
    position = fastest * np.arange(int(profile.length / fastest * DEVICE_RATE)) / DEVICE_RATE
    read = profile.read(position, np.full(len(position), fastest))
    return float(np.abs(np.diff(read)).max() * (fastest / profile.reference_speed) ** SPEED_EXPONENT)
