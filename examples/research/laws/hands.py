"""The simulator beside measured hands: ratings, waveforms, exponents and friction, over sets of 50 fresh surfaces."""

from dataclasses import dataclass, replace

import numpy as np
from report.fresh import FIRST_FRESH, fresh_textures

from tactile_diffusers.signal import DEVICE_RATE, band_pass, level
from tactile_diffusers.signal.waveform_shape import waveform_shape
from tactile_diffusers.virtual.collection import Collection
from tactile_diffusers.virtual.exploration import EXPLORERS, VELOCITY_RATE, explorer, free_exploration
from tactile_diffusers.virtual.percepts import percept_correlation, percepts
from tactile_diffusers.virtual.raters import IDIOSYNCRASY
from tactile_diffusers.virtual.relief import PERIOD_MM

from .law import exponent, slide
from .measured import QUOTED, correlation, measure_hands, percentiles, rating_statistics, z_scores
from .population import usable_windows


@dataclass(frozen=True)
class Row:
    """One law, measured on hands and in the simulator.

    Attributes:
        law, source (`str`): what is compared, and where the measured value is from.
        measured (`tuple[float, float]`): lowest and highest; alike where it is one number.
        simulator (`tuple[float, float, float]`): median, and the ends of the range that holds 95 % of sets.
        note (`str`): what the reader should know.
        reason (`str`): why the row is known to be outside.
    """

    law: str
    source: str
    measured: tuple[float, float]
    simulator: tuple[float, float, float]
    note: str = ""
    reason: str = ""

    @property
    def inside(self):
        """Whether the simulator's range holds the measured value, or overlaps the measured range."""
        return bool(self.simulator[1] <= self.measured[1] and self.measured[0] <= self.simulator[2])


def over_sets(count, statistics, size, sets):
    """Median and 95 % range of statistics over sets of `size` of `count` surfaces: a dict of triples.

    Args:
        statistics (`callable`): (numbers of surfaces) -> dict of floats.
    """
    rng = np.random.default_rng(0)
    found = [statistics(rng.integers(count, size=size)) for _ in range(sets)]
    return {name: tuple(np.percentile([one[name] for one in found], (50, 2.5, 97.5)).tolist()) for name in found[0]}


def explore_surfaces(count):
    """One segment of each of `count` fresh surfaces, by two fingers in turn, where there is one in 12 s.

    Returns:
        `tuple`: surfaces (k), textures (k, samples) in N, log friction coefficients (k,) and log RMS (k,).
    """
    collection, rows = Collection(seconds=12.0), []
    for index in range(FIRST_FRESH, FIRST_FRESH + count):
        textures, friction, logs, _ = fresh_textures(index, collection, explorers=(index % 2,), per_surface=1)
        rows += [(collection.surface(index), *row) for row in zip(textures, np.log(friction), logs, strict=True)]
    surfaces, *arrays = zip(*rows, strict=True)
    return surfaces, *map(np.array, arrays)


def answers_about(surfaces, **settings):
    """Answers of 19 raters in three trials: (raters, trials, surfaces, 2: rough, slippery)."""
    collection = Collection(seconds=2.0, raters=19, **settings)
    return np.stack([collection.answers(surfaces, trial)[..., [0, 2]] for trial in range(3)], axis=1)


def level_exponents(surfaces):
    """Exponents of the level over the paper's limits of force and of speed, by steady slides: (surfaces, 2)."""

    def over(values, conditions, surface, seed):
        waves = [slide(surface.parameters, v, PERIOD_MM / v, force, seed)[:, 0] for v, force in conditions]
        return exponent(values, np.exp([level(band_pass(wave, DEVICE_RATE)[1000:-1000]) for wave in waves]))

    forces, speeds = (0.4, 0.5, 0.6), (66.0, 80.0, 99.0)
    by_force, by_speed = [(80.0, force) for force in forces], [(speed, 0.5) for speed in speeds]
    return np.array(
        [(over(forces, by_force, one, k), over(speeds, by_speed, one, k)) for k, one in enumerate(surfaces)]
    )


def roughness_over_period(surfaces, periods=(0.5, 1.0, 2.0)):
    """Change of roughness (standard deviations) as a grating's period doubles, of the surfaces that have one."""
    gratings = [surface.parameters for surface in surfaces if surface.parameters.grating_level]
    rough = [[percepts(replace(one, wavelength=period))[0] for period in periods] for one in gratings]
    return np.polyfit(np.log2(periods), np.transpose(rough), 1)[0]


def onset_shares(takes):
    """Shares of the segments of 40 s recordings that hold some of the first 0.3 s, and of the first 3 mm, of motion."""
    early = []
    for who in (0, 1):
        for take in range(takes):
            run = free_exploration(np.random.default_rng([who, take]), EXPLORERS[who], 40.0)
            starts = usable_windows(run)[0]
            begin = np.argmax(run.speed > 0) + 0.3 * VELOCITY_RATE
            travel = np.cumsum(run.speed)[starts] / VELOCITY_RATE
            early += zip(starts < begin, travel < 3.0, strict=True)
    return np.mean(early, axis=0).tolist()


def plain(surface):
    """Whether a surface is neither glass nor rubber, which are smooth and sticky."""
    return surface.parameters.material not in ("glass", "rubber")


def simulate(quick=False):
    """What the rows need from the simulator.

    Args:
        quick (`bool`): fewer surfaces and fewer sets.

    Returns:
        `tuple`: medians and ranges (dict of triples), those of ratings in other worlds by what differs there, and the
        result of `explore_surfaces`.
    """
    explored = explore_surfaces(70 if quick else 600)
    surfaces, textures, friction, logs = explored
    shapes, answers = waveform_shape(textures), answers_about(surfaces)
    plain_ones = np.flatnonzero(list(map(plain, surfaces)))
    worlds = {
        "without glass and rubber": answers[:, :, plain_ones],
        "at `rating_correlation` -0.9": answers_about(surfaces, rating_correlation=(0.4, -0.9, -0.36)),
    }
    rough, slippery = np.moveaxis(z_scores(answers).mean((0, 1)), -1, 0)
    by_force, by_speed = level_exponents(surfaces[: 55 if quick else 200]).T
    moisture = np.array([explorer(index, 0).moisture for index in range(2, 402)])
    loads = [s.parameters.friction_load_exponent for s in surfaces if s.parameters.material in ("metal", "rubber")]
    loads, periods = np.array(loads), roughness_over_period(surfaces)

    def of_segments(chosen):
        return {
            "kurtosis": np.median(shapes["kurtosis"][chosen]),
            "kurtosis_95": np.percentile(shapes["kurtosis"][chosen], 95),
            "crest_factor": np.median(shapes["crest_factor"][chosen]),
            "friction_and_level": correlation(friction[chosen], logs[chosen]),
            "slippery_r2": correlation(slippery[chosen], friction[chosen]) ** 2,
            "rough_r2": correlation(rough[chosen], logs[chosen]) ** 2,
        }

    sets = 40 if quick else 300
    found = {name: np.percentile(shapes[name], (50, 2.5, 97.5)) for name in ("skew", "slope_skew")}
    for values, size, statistics in (
        (surfaces, 50, of_segments),
        (surfaces, 50, lambda chosen: rating_statistics(answers[:, :, chosen])),
        (by_force, 50, lambda chosen: percentiles("force", by_force[chosen])),
        (by_speed, 50, lambda chosen: percentiles("speed", by_speed[chosen])),
        (moisture, 15, lambda chosen: {"fingers": moisture[chosen].std() / moisture[chosen].mean()}),
        (loads, 5, lambda chosen: {"load": loads[chosen].mean()}),
        (periods, 15, lambda chosen: {"period": periods[chosen].mean()}),
    ):
        found |= over_sets(len(values), statistics, size, sets)

    def ratings_in(world):
        return over_sets(world.shape[2], lambda chosen: rating_statistics(world[:, :, chosen]), 50, sets)

    return found, {name: ratings_in(world) for name, world in worlds.items()}, explored


def compare(folder=None, quick=False):
    """Every row, the segments that were explored, and the numbers below the table.

    Args:
        folder (`Path`, *optional*): of measured data; `None`: quoted numbers.
        quick (`bool`): of `simulate`.

    Returns:
        `tuple[list[Row], tuple, dict]`: rows, result of `explore_surfaces`, facts.
    """
    hands = QUOTED if folder is None else measure_hands(folder)
    found, worlds, explored = simulate(quick)

    def row(law, source, name, measured=None, note="", reason=""):
        measured = hands[name] if measured is None else measured
        measured = measured if isinstance(measured, tuple) else (measured, measured)
        return Row(law, source, measured, tuple(map(float, found[name])), note, reason)

    def elsewhere(name):
        return "; ".join(
            "{}: {:.2f} [{:.2f}, {:.2f}]".format(where, *ratings[name]) for where, ratings in worlds.items()
        )

    shapes = "Grigorii 2021, HaTT, Fradin 2023"
    single = "range of single segments"
    sticky = "no measured surface is smooth and sticky as glass and rubber are; the rest is the setting"
    rigid = "a stylus meets neither compliant gratings nor stick-slip, whose level falls with speed"
    rows = [
        row("r(rough, slippery), ratings pooled", "Cleland 2024", "pooled", None, elsewhere("pooled"), sticky),
        row(
            "r(rough, slippery), stylus",
            "Culbertson 2017",
            "pooled",
            -0.91,
            "",
            "another set of surfaces; see the first row",
        ),
        row("r(rough, slippery), 10 textures", "traction", "pooled", -0.58),
        row("r(rough, slippery), within a rater", "Cleland 2024", "within", None, elsewhere("within"), sticky),
        row("inter-rater r, roughness, single answers", "Cleland 2024", "rough_single"),
        row("inter-rater r, slipperiness, single answers", "Cleland 2024", "slippery_single"),
        row("inter-rater r, roughness, means of three", "Cleland 2024", "rough_means"),
        row("inter-rater r, slipperiness, means of three", "Cleland 2024", "slippery_means"),
        row("test-retest r, roughness", "Cleland 2024", "rough_retest"),
        row("test-retest r, slipperiness", "Cleland 2024", "slippery_retest"),
        row("R² of slipperiness with log friction", "Culbertson 2017", "slippery_r2", 0.53),
        row("R² of roughness with level in dB", "Culbertson 2017", "rough_r2", 0.68),
        row("kurtosis, median", shapes, "kurtosis", (hands["stroke_kurtosis"], hands["fabrics_kurtosis"])),
        row(
            "kurtosis, 95th percentile",
            "Fradin 2023",
            "kurtosis_95",
            (hands["fabrics_kurtosis_95"], hands["dots_kurtosis_95"]),
            "without and with raised dots",
        ),
        row("crest factor, median", shapes, "crest_factor", (4.0, hands["fabrics_crest_factor"])),
        row("skew", "Grigorii 2021", "skew", hands["stroke_skew"], single),
        row("skew of the derivative", "Grigorii 2021", "slope_skew", hands["stroke_slope_skew"], single),
        row("level over load, exponent, median", "HaTT", "force_50"),
        row("level over load, exponent, 5th percentile", "HaTT", "force_5"),
        row("level over load, exponent, 95th percentile", "HaTT", "force_95", reason=rigid),
        row("level over speed, exponent, median", "HaTT", "speed_50"),
        row("level over speed, exponent, 5th percentile", "HaTT", "speed_5", reason=rigid),
        row("level over speed, exponent, 95th percentile", "HaTT", "speed_95"),
        row("r(log friction, level)", "HaTT", "friction_and_level"),
        row("friction between fingers, sd / mean", "fingers", "fingers", (0.16, 0.45), "15 fingers a set"),
        row(
            "friction over load, exponent, metal and rubber",
            "Seo 2009",
            "load",
            -0.206,
            "5 surfaces a set",
            "measured at 2 to 40 times the force of segments",
        ),
        row(
            "roughness per doubling of a grating's period, 0.5-2 mm, sd",
            "Drewing 2016",
            "period",
            (0.0, np.inf),
            "15 gratings a set",
            "roughness is vibration here; the spatial code of coarse gratings is missing",
        ),
    ]
    scale = 1 / np.sqrt(1 + IDIOSYNCRASY**2)
    physics = percept_correlation()[0, 2]
    facts = {"percepts": physics, "impressions": physics * scale[0] * scale[2], "pooled": found["pooled"][0]}
    facts["plain_percepts"] = correlation(*np.transpose([one.percepts[[0, 2]] for one in explored[0] if plain(one)]))
    facts["plain_pooled"] = worlds["without glass and rubber"]["pooled"][0]
    facts |= dict(zip(("onset_time", "onset_travel"), onset_shares(10 if quick else 100), strict=True))
    return rows, explored, {name: float(value) for name, value in facts.items()}
