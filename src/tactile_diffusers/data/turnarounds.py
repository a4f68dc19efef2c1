"""Turnarounds: where the finger reverses, and how the swing of lateral force there is removed."""

import numpy as np

from ..signal.masks import interpolated, mask_of_runs, true_runs

#: Treatments of turnarounds: none (the paper), or the force around it is replaced.
TURNAROUNDS = ("keep", "mask")
#: By measurement on 20 virtual surfaces, segments with turnarounds against segments without. KTD: under "keep" 13 if
#: the finger turns in an arc and 381 if it reverses on a line, under "mask" -8 and -8; others without, -15. Lowest of
#: the nine bands: +1.1 and +16.2 dB under "keep", -0.4 and -0.3 dB under "mask".
DEFAULT_TURNAROUNDS = "mask"
#: Around a turnaround lateral force dips for about so long (s); level and friction coefficient are computed without it.
DIP_SECONDS = 0.06
#: "mask" acts on so much around a turnaround (s): the longest excursion of the paper, and measured better than 0.06
#: and 0.08 s, which leave the ends of the dip, and as good as 0.12 s.
MASK_SECONDS = 0.1
#: Mean force on either side of what "mask" replaces is taken over so much (s).
_EDGE_SECONDS = 0.005


def find_turnarounds(angle, rate):
    """Middles (s) of the times in which the sliding direction turns by more than a right angle within 0.1 s.

    `angle` is (m,) rad, unwrapped, at `rate` Hz.
    """
    half = max(1, int(round(0.05 * rate)))
    padded = np.pad(angle, half, mode="edge")
    turning = np.abs(padded[2 * half :] - padded[: -2 * half]) > np.pi / 2
    return (true_runs(turning).sum(axis=1) - 1) / 2 / rate


def around(positions, seconds, rate, samples):
    """(samples,) bool, True for `seconds` around each position (samples)."""
    half = int(round(seconds / 2 * rate))
    return mask_of_runs(np.stack([positions - half, positions + half], axis=-1), samples)


def treat_turnarounds(lateral, positions, rate, turnarounds=DEFAULT_TURNAROUNDS):
    """Applies "keep" or "mask" to lateral force (n,) before it is filtered; `positions` are samples.

    "keep" leaves it as it is (the paper). "mask" replaces 0.1 s around each turnaround (`mask_turnarounds`), and where
    three or more are so close that there is little texture between them, lets no segment hold them.

    Returns:
        `tuple[np.ndarray, np.ndarray]`: lateral force (n,) N, and which samples no segment may hold, (n,) bool.

    Raises:
        ValueError: if `turnarounds` is unknown.
    """
    check_turnarounds(turnarounds)
    if turnarounds == "keep":
        return lateral, np.zeros(len(lateral), dtype=bool)
    near = around(positions, MASK_SECONDS, rate, len(lateral))
    crowded = true_runs(near, shortest=2 * int(round(MASK_SECONDS * rate)) + 1)
    return mask_turnarounds(lateral, near, rate), mask_of_runs(crowded, len(lateral))


def check_turnarounds(turnarounds):
    """Raises ValueError if there is no such option."""
    if turnarounds not in TURNAROUNDS:
        raise ValueError(f"`turnarounds` must be one of {TURNAROUNDS}, got {turnarounds!r}.")


def mask_turnarounds(lateral, replaced, rate):
    """Replaces lateral force by the force before and after, mirrored in time and cross-faded.

    In a turnaround the force dips, or swings by up to twice the friction force if the finger reverses on a line, and
    the band-pass would ring. A straight line instead does not ring, but leaves a silence, which distinguishes segments
    more than the dip did: the texture has to go on. `lateral` is (n,) N, and a NaN stays one; runs of `replaced`, (n,)
    bool, that touch an end of the recording are left as they are.
    """
    missing = np.isnan(lateral)
    filled = interpolated(lateral, missing)
    edge, last = max(1, int(round(_EDGE_SECONDS * rate))), len(lateral) - 1
    for start, stop in true_runs(replaced):
        if start == 0 or stop == len(lateral):
            continue
        steps = np.arange(stop - start)
        part = (steps + 0.5) / len(steps)
        low, high = filled[max(0, start - edge) : start].mean(), filled[stop : stop + edge].mean()
        before = filled[np.maximum(start - 1 - steps, 0)] - low
        after = filled[np.minimum(stop + steps[::-1], last)] - high
        # neighbours are uncorrelated: this fade keeps the power
        texture = np.cos(np.pi / 2 * part) * before + np.sin(np.pi / 2 * part) * after
        filled[start:stop] = low + (high - low) * part + texture
    filled[missing] = np.nan
    return filled
