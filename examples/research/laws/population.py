"""Statistics over many surfaces and explorations."""

import numpy as np
from report.fresh import FIRST_FRESH, fresh_textures

from tactile_diffusers.data.segments import SegmentLimits, bridge_gaps, select_windows
from tactile_diffusers.virtual.collection import Collection
from tactile_diffusers.virtual.exploration import (
    EXPLORERS,
    FORCE_BY_ROUGHNESS,
    FORCE_SPREAD_BY_ROUGHNESS,
    SPEED_BY_ROUGHNESS,
    VELOCITY_RATE,
    free_exploration,
)
from tactile_diffusers.virtual.percepts import reference_friction
from tactile_diffusers.virtual.recipe import CLASSES, LOAD_EXPONENT, SPEED_EXPONENT, draw_surface
from tactile_diffusers.virtual.streams import Stream, stream

from .law import Check, Law

#: Mean RMS of segments, mN, that the paper's RMSE and SNR imply; its 50 surfaces leave a standard error of 10 %.
INTENDED_LEVEL = 9.2


def surfaces(quick=False):
    """Shares of classes, friction and exponents of drawn surfaces."""
    count = 2000 if quick else 10_000
    drawn = [draw_surface(stream(0, Stream.SURFACE, index)) for index in range(count)]
    total = sum(material.count for material in CLASSES)
    share = [np.mean([s.material == m.name for s in drawn]) - m.count / total for m in CLASSES]
    friction = list(map(reference_friction, drawn))
    load, speed = (float(np.median([getattr(s, f"{name}_exponent") for s in drawn])) for name in ("load", "speed"))
    checks = (
        Check("largest deviation of a class's share", 0.0, float(np.abs(share).max()), 0.03 if quick else 0.015),
        Check("highest friction coefficient, rubber", 2.79, max(friction), 0.3),
        Check("lowest, 1st percentile, paper", 0.27, float(np.percentile(friction, 1)), 0.05),
        Check("median load exponent of the amplitude", LOAD_EXPONENT[0], load, 0.01),
        Check("median speed exponent of the amplitude", SPEED_EXPONENT[0], speed, 0.02),
    )
    source = "friction of fingers, 0.27-2.79 (Smith & Scott 1996; Buchholz 1988; Savescu 2008); classes: recipe"
    return Law("Surfaces: shares, friction, exponents", source, checks)


def levels(quick=False):
    """RMS of segments in the paper's limits, over surfaces and both explorers."""
    count, seconds = (60, 5.0) if quick else (250, 8.0)
    collection, logs = Collection(seconds), []
    for index in range(FIRST_FRESH, FIRST_FRESH + count):
        # all windows that share no sample, with their turnarounds as in the paper
        logs += fresh_textures(index, collection, seconds=seconds, per_surface=100, turnarounds="keep")[2].tolist()
    rms = float(1e3 * np.mean(np.exp(logs)))
    check = Check("RMS, mean", INTENDED_LEVEL, rms, (0.2 if quick else 0.1) * INTENDED_LEVEL, "mN")
    return Law("Level of segments", "the paper's RMSE and SNR imply 9.2 mN", (check,))


def exploration(quick=False):
    """Speed, force and usable share of both explorers, and how they adapt to roughness."""
    takes, seconds, zs = 12 if quick else 60, 60.0, (-2.0, -1.0, 0.0, 1.0, 2.0)
    # the same draws at every roughness: differences are due to roughness alone
    explored = {
        (who, z): [free_exploration(np.random.default_rng([who, k]), EXPLORERS[who], seconds, z) for k in range(takes)]
        for who in (0, 1)
        for z in zs
    }
    steady = {key: [_steady(run) for run in runs] for key, runs in explored.items()}
    log_speed = {key: np.mean([np.log(speed).mean() for speed, _ in runs]) for key, runs in steady.items()}
    log_force = {key: np.mean([np.log(force).mean() for _, force in runs]) for key, runs in steady.items()}
    log_spread = {key: np.mean([np.log(np.log(force).std()) for _, force in runs]) for key, runs in steady.items()}
    windows = {key: [usable_windows(run) for run in runs] for key, runs in explored.items()}
    usable = {key: float(np.mean([used.mean() for _, used in runs])) for key, runs in windows.items()}

    def slope(values):
        return float(np.mean([np.polyfit(zs, [values[who, z] for z in zs], 1)[0] for who in (0, 1)]))

    checks = (
        *(
            Check(f"median speed of explorer {n}", who.speed, float(np.exp(log_speed[n, 0.0])), 3.0, "mm/s")
            for n, who in enumerate(EXPLORERS)
        ),
        *(
            Check(f"median force of explorer {n}", who.normal_force, float(np.exp(log_force[n, 0.0])), 0.015, "N")
            for n, who in enumerate(EXPLORERS)
        ),
        Check("log speed per sd of roughness", SPEED_BY_ROUGHNESS, slope(log_speed), 0.002),
        Check("log force per sd of roughness", FORCE_BY_ROUGHNESS, slope(log_force), 0.002),
        Check("log spread of force per sd of roughness", FORCE_SPREAD_BY_ROUGHNESS, slope(log_spread), 0.01),
        Check("usable share of the time: about half", 0.5, float(np.mean(list(usable.values()))), 0.15),
        Check("longest turnaround", 0.09, max(map(_longest_turn, explored[0, 0.0])), 0.01, "s"),
    )
    source = "lighter and slower on rough, force varies more on smooth surfaces (Tanaka et al. 2014); sizes: recipe"
    return Law("Exploration, and how it adapts to roughness", source, checks)


def _steady(run):
    """Speed and normal force outside turnarounds and the start."""
    along = np.abs(run.track_speed) > 0.99 * run.speed
    along[: round(0.3 * VELOCITY_RATE)] = False
    return run.speed[along], run.normal_force[along]


def usable_windows(run):
    """Starts (samples) of the segments of an `Exploration`, and the mask of the runs that hold them."""
    limits = SegmentLimits()
    mask = np.ones(len(run.speed), dtype=bool)
    for values, (low, high) in ((run.speed, limits.speed), (run.normal_force, limits.normal_force)):
        mask &= (values >= low) & (values <= high)
    mask = bridge_gaps(mask, round(limits.longest_excursion * VELOCITY_RATE))
    return select_windows(mask, limits.samples(VELOCITY_RATE), limits.step(VELOCITY_RATE))


def _longest_turn(run):
    """Seconds of the longest run in which the motion leaves the track's direction."""
    turning = np.abs(run.track_speed) < (1 - 1e-9) * run.speed
    edges = np.flatnonzero(np.diff(np.concatenate([[0], turning, [0]]).astype(int))).reshape(-1, 2)
    return float(np.diff(edges).max() / VELOCITY_RATE)
