"""Explorers, and how they explore: wandering speed and force, loops, and strokes with turnarounds."""

from dataclasses import dataclass

import numpy as np
from scipy import signal

from .streams import Stream, stream

#: Rate at which finger velocity is recorded, Hz; also the rate of everything that the hand controls.
VELOCITY_RATE = 500
#: Ranges of how long the finger rests on the surface before it moves, and of how long it takes to reach its speed, s.
REST, START = (0.02, 0.06), (0.08, 0.2)
#: Nothing that the hand does on purpose is faster (Hz): wandering is smoothed by this much.
HAND_BANDWIDTH = 6.0


#: Ranges over recordings of the relative spread of speed and normal force, and of their time constants in s.
#: Chosen so that, as in the paper's recordings, the finger wanders in and out of the limits and about half of the time
#: is usable (0.5 segments per second; spreads of 0.14-0.25 and 0.11-0.22 would give a third of it).
SPEED_SPREAD, SPEED_TAU = (0.10, 0.16), (1.5, 2.5)
FORCE_SPREAD, FORCE_TAU = (0.08, 0.14), (1.0, 1.5)
#: Change of the log mean speed, log mean force and log spread of the force per standard deviation of roughness: people
#: touch rough surfaces more lightly and slowly and vary the force more on smooth ones (Tanaka et al. 2014). The sizes
#: are a recipe, so small that 0.4 (smooth) to 0.7 (rough) of the time stay usable.
SPEED_BY_ROUGHNESS, FORCE_BY_ROUGHNESS, FORCE_SPREAD_BY_ROUGHNESS = -0.02, -0.02, -0.10
#: Roughness beyond so many standard deviations changes the exploration no further.
ROUGHEST = 2.0


@dataclass(frozen=True)
class Explorer:
    """A hand and its finger.

    Attributes:
        speed (`float`): mean, mm/s.
        normal_force (`float`): mean, N.
        moisture (`float`): factor on the friction coefficient.
        gain (`float`): factor on the amplitude of textures.
        cutoff (`float`): factor on the cutoff of the finger's low-pass.
    """

    speed: float
    normal_force: float
    moisture: float
    gain: float
    cutoff: float = 1.0


#: The two explorers of the recipe.
EXPLORERS = (Explorer(78.0, 0.52, 1.0, 1.0), Explorer(90.0, 0.47, 0.75, 0.8))
#: Standard deviations, in logarithms, of the population that further explorers come from (recipe). Its middle is the
#: geometric mean of the two, who lie within one standard deviation on either side: 0.9, 0.8, 0.6, 0.6 and 0. Skin
#: friction on one material differs by 15-45 % between people (aluminium 0.38 +- 0.13, sandpaper 0.61 +- 0.10, wet glass
#: 0.78 +- 0.35); finger mechanics differ much too (arXiv 2505.11162). Speeds and forces stay near the limits of usable
#: segments, as if explorers had been instructed.
POPULATION_SPREAD = Explorer(speed=0.08, normal_force=0.06, moisture=0.25, gain=0.2, cutoff=0.25)
#: Draws beyond so many standard deviations are held there.
FARTHEST = 2.0


def explorer(index, seed):
    """Explorer number `index` of a collection: the two of the recipe first, then fingers drawn from the population.

    Number 2 and up are unseen fingers to a model that learned from the first two: moister or drier, and of other
    mechanics, than both in about half of the draws.

    Args:
        index (`int`): 0, 1, ...
        seed (`int`): of the collection.

    Returns:
        `Explorer`
    """
    if index < len(EXPLORERS):
        return EXPLORERS[index]
    middle = np.exp(np.mean([np.log(list(vars(who).values())) for who in EXPLORERS], axis=0))
    spread = list(vars(POPULATION_SPREAD).values())
    draw = np.clip(stream(seed, Stream.EXPLORER, index).standard_normal(len(spread)), -FARTHEST, FARTHEST)
    return Explorer(*(middle * np.exp(draw * spread)).tolist())


@dataclass
class Exploration:
    """Speed, force and heading of the hand, at `VELOCITY_RATE`.

    Attributes:
        speed (`np.ndarray`): (m,) mm/s, never negative.
        normal_force (`np.ndarray`): (m,) N.
        heading (`np.ndarray`): (m,) rad, sliding direction in the plane.
        track_speed (`np.ndarray`): (m,) mm/s, signed speed along the track whose profile the finger follows.
    """

    speed: np.ndarray
    normal_force: np.ndarray
    heading: np.ndarray
    track_speed: np.ndarray

    @property
    def velocity(self):
        """(m, 2) mm/s in the plane."""
        return self.speed[:, None] * np.stack([np.cos(self.heading), np.sin(self.heading)], axis=-1)


def steady_exploration(speed, normal_force, seconds):
    """A straight slide at constant speed (mm/s) and normal force (N): for tests and for replay at other speeds."""
    ones = np.ones(int(round(seconds * VELOCITY_RATE)))
    return Exploration(speed * ones, normal_force * ones, 0.0 * ones, speed * ones)


def ornstein_uhlenbeck(rng, samples, tau, rate):
    """Stationary Ornstein-Uhlenbeck process of unit variance with time constant `tau` s: (samples,)."""
    decay = np.exp(-1 / (tau * rate))
    start = rng.standard_normal()
    noise = np.sqrt(1 - decay**2) * rng.standard_normal(samples)
    return signal.lfilter([1.0], [1.0, -decay], noise, zi=[decay * start])[0]


def wandering(rng, samples, mean, deviation, tau):
    """Exponential of a smoothed Ornstein-Uhlenbeck process: (samples,), positive, around `mean` (recipe)."""
    sections = signal.butter(2, HAND_BANDWIDTH, fs=VELOCITY_RATE, output="sos")
    walk = signal.sosfiltfilt(sections, ornstein_uhlenbeck(rng, samples, tau, VELOCITY_RATE))
    return mean * np.exp(deviation * walk)


def free_exploration(rng, who, seconds, roughness=0.0):
    """Free exploration from rest: bouts of loops and of strokes with turnarounds shorter than 0.1 s.

    Args:
        rng (`np.random.Generator`): the trial.
        who (`Explorer`): the explorer.
        seconds (`float`): duration.
        roughness (`float`): of the surface, in standard deviations over surfaces: the exploration adapts to it.

    Returns:
        `Exploration`.
    """
    samples = int(round(seconds * VELOCITY_RATE))
    by_roughness = np.clip(roughness, -ROUGHEST, ROUGHEST)
    mean_speed = who.speed * np.exp(SPEED_BY_ROUGHNESS * by_roughness)
    mean_force = who.normal_force * np.exp(FORCE_BY_ROUGHNESS * by_roughness)
    speed = wandering(rng, samples, mean_speed, rng.uniform(*SPEED_SPREAD), rng.uniform(*SPEED_TAU))
    spread = rng.uniform(*FORCE_SPREAD) * np.exp(FORCE_SPREAD_BY_ROUGHNESS * by_roughness)
    normal_force = wandering(rng, samples, mean_force, spread, rng.uniform(*FORCE_TAU))
    turning, slowing, along = _plan(rng, samples, speed)
    speed = speed * slowing * _start(rng, samples)
    heading = rng.uniform(0, 2 * np.pi) + np.cumsum(turning) / VELOCITY_RATE
    return Exploration(speed, normal_force, heading, speed * along)


def _start(rng, samples):
    """Factor on the speed of a finger that rests, then starts to move: (samples,)."""
    rest, start = rng.uniform(*REST), rng.uniform(*START)
    part = np.clip((np.arange(samples) / VELOCITY_RATE - rest) / start, 0, 1)
    return part**2 * (3 - 2 * part)


def _plan(rng, samples, speed):
    """Turning rate (rad/s), slowing (factor on speed) and along (cosine between motion and track), each (samples,)."""
    turning, slowing, along = np.zeros(samples), np.ones(samples), np.ones(samples)
    sense, start = 1.0, 0
    while start < samples:
        if rng.random() < 0.5:
            stop = start + int(rng.uniform(2.0, 6.0) * VELOCITY_RATE)
            radius = rng.uniform(8.0, 25.0) * rng.choice([-1, 1])
            ramp = np.clip(np.minimum(np.arange(start, stop) - start, stop - 1 - np.arange(start, stop)) / 50, 0, 1)
            piece = slice(start, min(stop, samples))
            turning[piece] = (speed[piece] / radius) * ramp[: piece.stop - start]
            along[piece] = sense
            start = stop
            continue
        for _ in range(rng.integers(2, 7)):
            stop = start + int(rng.uniform(40.0, 110.0) / speed[min(start, samples - 1)] * VELOCITY_RATE)
            along[start:stop] = sense
            start = _turn_around(rng, stop, sense, turning, slowing, along)
            sense = -sense
    return turning, slowing, along


def _turn_around(rng, start, sense, turning, slowing, along):
    """Writes one turnaround: the finger slows down, turns by half a circle and speeds up again; returns its end."""
    length = int(rng.uniform(0.080, 0.096) * VELOCITY_RATE)
    slowest, side = rng.uniform(0.4, 0.8), rng.choice([-1, 1])
    part = (np.arange(length) + 0.5) / length
    turned = np.pi * part**3 * (10 - 15 * part + 6 * part**2)
    stop = min(start + length, len(turning))
    here = slice(start, stop)
    count = max(stop - start, 0)
    turning[here] = (side * np.diff(turned, prepend=0.0) * VELOCITY_RATE)[:count]
    slowing[here] = (1 - (1 - slowest) * np.sin(np.pi * part) ** 2)[:count]
    along[here] = (sense * np.cos(turned))[:count]
    return start + length
