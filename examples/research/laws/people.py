"""Statistics over raters, explorations and explorers."""

from dataclasses import replace

import numpy as np

from tactile_diffusers.data.ratings import axis_correlation, pool_ratings, rating_reliability
from tactile_diffusers.data.recordings import RaterScores
from tactile_diffusers.data.segments import SegmentLimits, bridge_gaps, select_windows
from tactile_diffusers.signal import RATING_AXES
from tactile_diffusers.virtual.collection import Collection
from tactile_diffusers.virtual.exploration import (
    EXPLORERS,
    FARTHEST,
    FORCE_BY_ROUGHNESS,
    FORCE_SPREAD_BY_ROUGHNESS,
    POPULATION_SPREAD,
    SPEED_BY_ROUGHNESS,
    VELOCITY_RATE,
    explorer,
    free_exploration,
)

from .law import Check, Law, finish

#: What the recipe's raters are meant to give: roughness, bumpiness, slipperiness.
INTENDED_CORRELATION = (0.63, 0.48, 0.39)
INTENDED_ALPHA = (0.95, 0.92, 0.88)
INTENDED_ROUGH_BUMPY = 0.40


def raters(quick=False):
    """Agreement between raters, correlation between axes, and the settings that change them."""
    count = 300 if quick else 1000
    collection = Collection(seconds=2.0)
    surfaces = [collection.surface(index) for index in range(count)]

    def rated(**settings):
        answers = replace(collection, **settings).answers(surfaces)
        names = tuple(surface.name for surface in surfaces)
        return RaterScores(answers, tuple(map(str, range(len(answers)))), names, RATING_AXES)

    def correlations(scores):
        return axis_correlation(pool_ratings(scores, scores.surfaces, np.ones(count, dtype=bool)).mean)

    scores = rated()
    found, between = rating_reliability(scores), correlations(scores)
    agreements, halos = (0.3, 0.5, 1.0, 2.0, 5.0), (0.0, 0.2, 0.4, 0.6)
    by_agreement = [rating_reliability(rated(agreement=a)).mean_correlation for a in agreements]
    by_halo = [correlations(rated(axis_correlation=c, agreement=100.0))[np.triu_indices(3, 1)] for c in halos]
    noise = 0.08 if quick else 0.05  # standard error over 1000 (300) surfaces: 0.015 (0.03)
    checks = (
        *(
            Check(f"inter-rater r, {axis}", *pair, noise)
            for axis, *pair in _rows(INTENDED_CORRELATION, found.mean_correlation)
        ),
        *(Check(f"alpha, {axis}", *pair, 0.03) for axis, *pair in _rows(INTENDED_ALPHA, found.alpha)),
        Check(
            "r(roughness, bumpiness) of pooled ratings",
            INTENDED_ROUGH_BUMPY,
            float(between[0, 1]),
            0.1 if quick else 0.06,
        ),
        # the scale's ends and whole numbers take a little
        Check("weakest correlation of axes at axis_correlation 0.6", 0.6, float(by_halo[-1].min()), 0.08),
    )

    def draw(panels):
        for number, axis in enumerate(RATING_AXES):
            values = [row[number] for row in by_agreement]
            panels[0].semilogx(agreements, values, "o-", color=f"C{number}", markersize=3, label=axis)
            panels[0].plot(1.0, INTENDED_CORRELATION[number], "k_", markersize=14)
        finish(panels[0], "inter-rater r; bars: intended", "agreement", "", ticks=agreements)
        for number, (i, j) in enumerate(zip(*np.triu_indices(3, 1), strict=True)):
            label = f"{RATING_AXES[i]}, {RATING_AXES[j]}"
            panels[1].plot(halos, [row[number] for row in by_halo], "o-", markersize=3, label=label)
        panels[1].plot(halos, halos, color="black", linewidth=0.8, label="least intended")
        finish(panels[1], "correlation of axes, raters agree", "axis_correlation", "")

    return Law("Raters: agreement, and the settings that change it", "recipe", checks, 2, draw)


def _rows(intended, measured):
    return zip(RATING_AXES, intended, map(float, measured), strict=True)


def exploration(quick=False):
    """Speed, force and usable share of both explorers, and how they adapt to roughness."""
    takes, seconds, zs = 12 if quick else 60, 60.0, (-2.0, -1.0, 0.0, 1.0, 2.0)
    # the same draws at every roughness: differences are due to roughness alone
    explored = {
        (who, z): [free_exploration(np.random.default_rng([who, k]), EXPLORERS[who], seconds, z) for k in range(takes)]
        for who in (0, 1)
        for z in zs
    }
    log_speed = {key: np.mean([np.log(_steady(e)[0]).mean() for e in runs]) for key, runs in explored.items()}
    log_force = {key: np.mean([np.log(_steady(e)[1]).mean() for e in runs]) for key, runs in explored.items()}
    log_spread = {key: np.mean([np.log(np.log(_steady(e)[1]).std()) for e in runs]) for key, runs in explored.items()}
    usable = {key: float(np.mean([_usable(e) for e in runs])) for key, runs in explored.items()}

    def slope(values):
        return float(np.mean([np.polyfit(zs, [values[who, z] for z in zs], 1)[0] for who in (0, 1)]))

    turning = max(_longest_turn(e) for e in explored[0, 0.0])
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
        Check("longest turnaround", 0.09, turning, 0.01, "s"),
    )

    def draw(panels):
        for who in (0, 1):
            label, colour = f"explorer {who}", f"C{who}"
            panels[0].plot(zs, [np.exp(log_speed[who, z]) for z in zs], "o", color=colour, markersize=4, label=label)
            panels[0].plot(
                zs, EXPLORERS[who].speed * np.exp(SPEED_BY_ROUGHNESS * np.array(zs)), color=colour, linewidth=1
            )
            panels[1].plot(zs, [np.exp(log_force[who, z]) for z in zs], "o", color=colour, markersize=4, label=label)
            panels[1].plot(
                zs, EXPLORERS[who].normal_force * np.exp(FORCE_BY_ROUGHNESS * np.array(zs)), color=colour, linewidth=1
            )
            panels[2].plot(zs, [np.exp(log_spread[who, z]) for z in zs], "o-", color=colour, markersize=4, label=label)
            panels[3].plot(zs, [usable[who, z] for z in zs], "o-", color=colour, markersize=4, label=label)
        finish(panels[0], "median speed; line: intended", "roughness, sd", "mm/s")
        finish(panels[1], "median force; line: intended", "roughness, sd", "N")
        finish(panels[2], "relative spread of force", "roughness, sd", "")
        finish(panels[3], "usable share of the time", "roughness, sd", "")
        panels[3].set_ylim(0, 1)

    source = "lighter and slower on rough, force varies more on smooth surfaces (Tanaka et al. 2014); sizes: recipe"
    return Law("Exploration, and how it adapts to roughness", source, checks, 4, draw)


def _steady(exploration):
    """Speed and normal force outside turnarounds."""
    along = np.abs(exploration.track_speed) > 0.99 * exploration.speed
    return exploration.speed[along], exploration.normal_force[along]


def _usable(exploration):
    """Share of the time in runs of at least a segment inside the paper's limits."""
    limits = SegmentLimits()
    mask = np.ones(len(exploration.speed), dtype=bool)
    for values, (low, high) in ((exploration.speed, limits.speed), (exploration.normal_force, limits.normal_force)):
        mask &= (values >= low) & (values <= high)
    mask = bridge_gaps(mask, round(limits.longest_excursion * VELOCITY_RATE))
    return select_windows(mask, limits.samples(VELOCITY_RATE), limits.step(VELOCITY_RATE))[1].mean()


def _longest_turn(exploration):
    """Seconds of the longest run in which the motion leaves the track's direction."""
    turning = np.abs(exploration.track_speed) < (1 - 1e-9) * exploration.speed
    edges = np.flatnonzero(np.diff(np.concatenate([[0], turning, [0]]).astype(int))).reshape(-1, 2)
    return float(np.diff(edges).max() / VELOCITY_RATE)


def further_explorers(quick=False):
    """Fingers beside the recipe's two."""
    count = 200 if quick else 1000
    people = [explorer(index, 0) for index in range(2, 2 + count)]
    logs = {name: np.log([getattr(who, name) for who in people]) for name in vars(POPULATION_SPREAD)}
    middle = {name: np.mean([np.log(getattr(who, name)) for who in EXPLORERS]) for name in logs}
    ends = np.random.default_rng(0).standard_normal(100_000).clip(-FARTHEST, FARTHEST)
    held = float(ends.std())  # what is left of a spread whose ends are held
    pair = [who.moisture for who in EXPLORERS]
    moisture = np.exp(logs["moisture"])
    # standard errors of a spread and of a mean over 1000 (200) people: 2 % (5 %) of it, 3 % (7 %)
    close = 0.15 if quick else 0.08
    checks = (
        *(
            Check(f"spread of log {name}", spread * held, float(logs[name].std()), close * spread)
            for name, spread in vars(POPULATION_SPREAD).items()
        ),
        *(
            Check(f"middle of log {name}", float(middle[name]), float(logs[name].mean()), 2 * close * spread)
            for name, spread in vars(POPULATION_SPREAD).items()
        ),
        Check(
            "share of fingers outside the two in moisture",
            0.56,
            float(np.mean((moisture < min(pair)) | (moisture > max(pair)))),
            0.1,
        ),
    )

    def draw(panels):
        units = {"speed": "mean speed, mm/s", "normal_force": "mean force, N"}
        units |= {name: f"factor on {name}" for name in ("moisture", "cutoff")}
        for panel, names in zip(panels, (("moisture", "cutoff"), ("speed", "normal_force")), strict=True):
            for group, marker, label in ((people, "C0.", "further"), (EXPLORERS, "C1s", "the two")):
                panel.plot(
                    *([getattr(who, name) for who in group] for name in names), marker, markersize=3, label=label
                )
            finish(panel, "explorers", *(units[name] for name in names))

    source = "spread between people of skin friction and finger mechanics (arXiv 2505.11162 and others); sizes: recipe"
    return Law("Explorers: fingers beside the two of the recipe", source, checks, 2, draw)
