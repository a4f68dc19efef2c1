"""Fresh surfaces of the collection that a virtual data set comes from: the same raters and explorers, new surfaces."""

from numbers import Integral

import numpy as np

from ..data.projection import channels, filtered_with_gaps
from ..data.ratings import pool_ratings
from ..data.recordings import RaterScores, Recording
from ..data.segments import SegmentLimits, find_windows
from ..data.turnarounds import DEFAULT_TURNAROUNDS
from ..signal import BAND_HZ, DEVICE_RATE, RATING_AXES
from ..signal.checks import check_whole_number
from .exploration import VELOCITY_RATE
from .raters import RATERS, draw_raters
from .streams import Stream, stream
from .surface import VirtualSurface

#: Numbers of fresh surfaces start here: no recorded collection is as large.
FIRST_FRESH = 1_000_000


def fresh_ratings(candidates, seed, agreement=1.0, training=None, raters=RATERS, axis_correlation=0.0):
    """Ratings of fresh surfaces, without exploring them: about 0.6 ms a surface.

    Args:
        candidates (`int`): how many; they are the surfaces `FIRST_FRESH`, `FIRST_FRESH + 1`, ...
        seed, agreement (`int`, `float`): of the collection, as in `generate_recordings`.
        training (`Sequence[int]`, *optional*): numbers of the surfaces that give each rater's mean and scale: with the
            training surfaces of a data set, the result is in exactly that data set's units. Defaults to the
            candidates, whose moments are those of the population if they are many.
        raters (`int` or `Sequence[int]`): how many raters, or the numbers of those who are asked.
        axis_correlation (`float`): of the collection. `rater_settings` reads these settings from a file's attributes.

    Returns:
        `np.ndarray`: (candidates, 3) float32, means over raters of their z-scores.

    Raises:
        ValueError: if `candidates` or `raters` are none, or raters cannot be z-scored (see `pool_ratings`).
    """
    candidates = check_whole_number("candidates", candidates)
    reference = [] if training is None else [int(index) for index in training]
    fresh = range(FIRST_FRESH, FIRST_FRESH + candidates)
    asked = np.array(_numbers("raters", raters))
    drawn = draw_raters(seed, asked.max() + 1)
    numbers = [*reference, *fresh]
    surfaces = [VirtualSurface(seed, number) for number in numbers]
    answers = np.stack([one.answers(drawn, agreement, axis_correlation)[asked] for one in surfaces], axis=1)
    names = tuple(str(number) for number in numbers)
    scores = RaterScores(answers, tuple(str(rater) for rater in asked), names, RATING_AXES)
    gives_scale = np.ones(len(numbers), bool) if training is None else np.arange(len(numbers)) < len(reference)
    return pool_ratings(scores, names, gives_scale).mean[len(reference) :]


def fresh_textures(
    index,
    seed,
    explorers=2,
    seconds=12.0,
    limits=None,
    band=BAND_HZ,
    order=4,
    passes=2,
    per_surface=2,
    trial=0,
    turnarounds=DEFAULT_TURNAROUNDS,
):
    """Textures of one surface by the route of a prepared data set, without a file: about 50 ms a recording of 12 s.

    Args:
        index, seed (`int`): surface number `index` of collection `seed`.
        explorers (`int` or `Sequence[int]`): how many, or the numbers of those who explore; each records it once.
        seconds (`float`): of each recording.
        limits (`SegmentLimits`, *optional*): defaults to the paper's.
        band, order, passes: of `signal.band_pass`.
        per_surface (`int`): at most so many textures; they share no sample and come from the explorers in turn.
        trial (`int`): another number gives another exploration.
        turnarounds (`str`): of `prepare_recordings`; a prepared file's attributes have it under this name.

    Returns:
        `tuple[np.ndarray, ...]`: textures (k, samples) in N, friction coefficients, levels (log RMS) and speeds (mm/s)
        (k,), all float32; k is 0 if no window meets the limits.
    """
    limits = limits or SegmentLimits()
    surface, route = VirtualSurface(seed, index), (limits, band, order, passes, turnarounds)
    # which windows are taken is a draw of its own, so that the recordings do not depend on it
    rng = stream(seed, Stream.FRESH_WINDOWS, index, trial)
    found = []
    for number in _numbers("explorers", explorers):
        filtered, windows = _explored(surface, number, seconds, trial, *route)
        chosen = _apart(rng.permutation(len(windows.start)), windows.start, limits.samples(DEVICE_RATE))
        found += [(turn, number, filtered, windows, window) for turn, window in enumerate(chosen)]
    found = sorted(found, key=lambda item: item[:2])[:per_surface]  # every explorer's first, then every one's second
    textures = np.empty((len(found), limits.samples(DEVICE_RATE)), dtype=np.float32)
    facts = np.empty((3, len(found)), dtype=np.float32)
    for row, (_, _, filtered, windows, window) in enumerate(found):
        textures[row] = filtered[windows.start[window] :][: textures.shape[1]]
        facts[:, row] = windows.friction_coefficient[window], windows.level[window], windows.speed[window]
    return textures, *facts


def _numbers(name, value):
    """Numbers of raters or explorers from their count or the numbers themselves."""
    numbers = list(range(value)) if isinstance(value, Integral) else [int(number) for number in value]
    if not numbers or min(numbers) < 0:
        raise ValueError(f"`{name}` must be a count of at least 1 or numbers of at least 0, got {value}.")
    return numbers


def _explored(surface, explorer, seconds, trial, limits, band, order, passes, turnarounds):
    """One recording as `prepare_recordings` sees it: filtered lateral force (n,) and its `Windows`."""
    force, velocity = surface.explore(explorer, seconds, trial)
    recording = Recording(
        surface.name,
        f"explorer-{explorer}",
        str(trial),
        force=force,
        lateral=None,
        rate=DEVICE_RATE,
        velocity=velocity.astype(np.float32),  # as a file holds it
        velocity_rate=float(VELOCITY_RATE),
        unit="N",
    )
    data = channels(recording, turnarounds)
    filtered, valid = filtered_with_gaps(data.lateral, DEVICE_RATE, band, order, passes)
    return filtered, find_windows(data, filtered, valid, DEVICE_RATE, limits)


def _apart(order, start, samples):
    """Members of `order` whose windows share no sample with an earlier member's."""
    chosen = []
    for window in order:
        if all(abs(start[window] - start[other]) >= samples for other in chosen):
            chosen.append(window)
    return chosen
