"""Fresh surfaces of the collection that a virtual data set comes from: the same raters and explorers, new surfaces."""

from dataclasses import replace
from numbers import Integral

import numpy as np

from tactile_diffusers.data.projection import channels, filtered_with_gaps
from tactile_diffusers.data.ratings import pool_ratings
from tactile_diffusers.data.recordings import RaterScores, Recording
from tactile_diffusers.data.segments import SegmentLimits, find_windows
from tactile_diffusers.data.turnarounds import DEFAULT_TURNAROUNDS
from tactile_diffusers.signal import BAND_HZ, DEVICE_RATE
from tactile_diffusers.signal.checks import check_whole_number
from tactile_diffusers.virtual.exploration import VELOCITY_RATE
from tactile_diffusers.virtual.streams import Stream, stream

#: Numbers of fresh surfaces start here: no recorded collection is as large.
FIRST_FRESH = 1_000_000


def fresh_ratings(candidates, collection, training=None, raters=None):
    """Ratings of fresh surfaces, without exploring them: about 0.6 ms a surface.

    Args:
        candidates (`int`): how many; they are the surfaces `FIRST_FRESH`, `FIRST_FRESH + 1`, ...
        collection (`Collection`): of which they are; `Collection.from_attributes` reads it from a file's attributes.
        training (`Sequence[int]`, *optional*): numbers of the surfaces that give each rater's mean and scale: with the
            training surfaces of a data set, the result is in exactly that data set's units. Defaults to the
            candidates, whose moments are those of the population if they are many.
        raters (`Sequence[int]`, *optional*): numbers of those who are asked; defaults to all of the collection.

    Returns:
        `np.ndarray`: (candidates, axes) float32, means over raters of their z-scores.

    Raises:
        ValueError: if `candidates` or `raters` are none, or raters cannot be z-scored (see `pool_ratings`).
    """
    candidates = check_whole_number("candidates", candidates)
    reference = [] if training is None else [int(index) for index in training]
    asked = _numbers("raters", collection.raters if raters is None else raters)
    numbers = [*reference, *range(FIRST_FRESH, FIRST_FRESH + candidates)]
    everybody = replace(collection, raters=max(asked) + 1)
    answers = everybody.answers([everybody.surface(number) for number in numbers])[asked]
    names = tuple(str(number) for number in numbers)
    scores = RaterScores(answers, tuple(str(rater) for rater in asked), names, collection.rating_axes)
    gives_scale = np.ones(len(numbers), bool) if training is None else np.arange(len(numbers)) < len(reference)
    return pool_ratings(scores, names, gives_scale).mean[len(reference) :]


def fresh_textures(
    index,
    collection,
    explorers=None,
    seconds=12.0,
    limits=None,
    band=BAND_HZ,
    per_surface=2,
    trial=0,
    turnarounds=DEFAULT_TURNAROUNDS,
):
    """Textures of one surface by the route of a prepared data set, without a file: about 50 ms a recording of 12 s.

    Args:
        index (`int`): number of the surface.
        collection (`Collection`): of which it is.
        explorers (`Sequence[int]`, *optional*): numbers of those who explore, each once; defaults to all of the
            collection.
        seconds (`float`): of each recording.
        limits (`SegmentLimits`, *optional*): defaults to the paper's.
        band: of `signal.band_pass`.
        per_surface (`int`): at most so many textures; they share no sample and come from the explorers in turn.
        trial (`int`): another number gives another exploration.
        turnarounds (`str`): of `prepare_recordings`; a prepared file's attributes have it under this name.

    Returns:
        `tuple[np.ndarray, ...]`: textures (k, samples) in N, friction coefficients, levels (log RMS) and speeds (mm/s)
        (k,), all float32; k is 0 if no window meets the limits.
    """
    limits = limits or SegmentLimits()
    surface, route = collection.surface(index), (limits, band, turnarounds)
    # which windows are taken is a draw of its own, so that the recordings do not depend on it
    rng = stream(collection.seed, Stream.FRESH_WINDOWS, index, trial)
    found = []
    for number in _numbers("explorers", collection.explorers if explorers is None else explorers):
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


def _explored(surface, explorer, seconds, trial, limits, band, turnarounds):
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
    filtered, valid = filtered_with_gaps(data.lateral, DEVICE_RATE, band)
    return filtered, find_windows(data, filtered, valid, DEVICE_RATE, limits)


def _apart(order, start, samples):
    """Members of `order` whose windows share no sample with an earlier member's."""
    chosen = []
    for window in order:
        if all(abs(start[window] - start[other]) >= samples for other in chosen):
            chosen.append(window)
    return chosen
