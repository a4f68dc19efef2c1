"""Statistics over many surfaces: their classes, and the levels and spectra of what is recorded on them."""

import numpy as np
from scipy import signal

from tactile_diffusers.signal import BAND_HZ, DEVICE_RATE
from tactile_diffusers.virtual.fresh import FIRST_FRESH, fresh_textures
from tactile_diffusers.virtual.percepts import reference_friction
from tactile_diffusers.virtual.recipe import CLASSES, COMPLIANCE, SOFT_CLASSES, draw_surface
from tactile_diffusers.virtual.streams import Stream, stream

from .law import Check, Law, finish

#: RMS of segments, N: the recipe's sketch of 50 surfaces.
INTENDED_LEVELS = {"mean": 0.0090, "median": 0.0074, "5th percentile": 0.0028, "95th percentile": 0.0210}
#: Lowest and highest mean centroid of a class, Hz: the same sketch.
INTENDED_CENTROIDS = {"lowest": 103.0, "highest": 259.0}


def material_classes(quick=False):
    """Drawn surfaces against the ranges and shares of their classes."""
    count = 2000 if quick else 10_000
    drawn = [_draw(index) for index in range(count)]
    by_class = {material.name: [s for s in drawn if s.material == material.name] for material in CLASSES}
    total = sum(material.count for material in CLASSES)
    share = [len(by_class[material.name]) / count - material.count / total for material in CLASSES]
    gratings = [np.mean([s.grating_level > 0 for s in by_class[m.name]]) - m.grating_probability for m in CLASSES]
    outside = sum(_outside(surface, material) for material in CLASSES for surface in by_class[material.name])
    checks = (
        Check("largest deviation of a class's share", 0.0, float(np.abs(share).max()), 0.03 if quick else 0.015),
        Check(
            "largest deviation of a grating's probability", 0.0, float(np.abs(gratings).max()), 0.1 if quick else 0.05
        ),
        Check("surfaces with a parameter outside its range", 0.0, outside, 0.0),
        Check("largest friction coefficient", 2.79, max(map(reference_friction, drawn)), 0.15),
    )

    def draw(panels):
        for panel, value, name, title in (
            (panels[0], reference_friction, "friction", "friction coefficient; orange: recipe, rigid"),
            (panels[1], lambda surface: surface.slope, "slope", "exponent of the profile; orange: recipe"),
        ):
            ranges = np.array([getattr(material, name) for material in CLASSES])
            panel.vlines(range(1, len(CLASSES) + 1), *ranges.T, color="C1", linewidth=5, alpha=0.6)
            _draw_by_class(panel, [list(map(value, surfaces)) for surfaces in by_class.values()], title)

    source = (
        "published friction of fingers, 0.27-2.79 (Smith & Scott 1996; Buchholz 1988; Savescu 2008); classes: recipe"
    )
    return Law("Classes of material: ranges and shares", source, checks, 2, draw)


def _draw(index):
    """Parameters of surface `index` of collection 0."""
    return draw_surface(stream(0, Stream.SURFACE, index), stream(0, Stream.COMPLIANCE, index))


def _draw_by_class(panel, groups, title, unit="", whiskers=(0, 100)):
    """Boxes, one a class; an empty class is left out."""
    places = [place for place, group in enumerate(groups, start=1) if group]
    panel.boxplot([group for group in groups if group], positions=places, whis=whiskers, showfliers=False)
    panel.set_xticks(range(1, len(CLASSES) + 1), [material.name for material in CLASSES], rotation=60)
    finish(panel, title, "", unit, legend=False)


def _outside(surface, material):
    """Whether any parameter lies outside the range of its class."""
    ranges = {name: getattr(material, name) for name in ("friction", "amplitude", "slope", "stick")}
    ranges |= {"asperity": (0.05, 0.4), "contact_stiffness": (0.6, 0.9), "load_exponent": (-1 / 3, 0)}
    if surface.grating_level:
        ranges |= {"wavelength": material.wavelength, "grating_level": (0.4, 1.6), "harmonic_decay": (1.2, 2.2)}
        ranges |= {"jitter": (0.02, 0.15)}
    soft = surface.grating_level > 0 and material.name in SOFT_CLASSES
    ranges["compliance"] = COMPLIANCE if soft else (0, 0)
    return not all(low <= getattr(surface, name) <= high for name, (low, high) in ranges.items())


def levels(quick=False):
    """RMS of segments in the paper's limits, over surfaces and both explorers."""
    count, seconds = (60, 5.0) if quick else (250, 8.0)
    by_class = {material.name: [] for material in CLASSES}  # RMS and centroid of every segment
    for index in range(FIRST_FRESH, FIRST_FRESH + count):
        # all windows that share no sample, with their turnarounds as in the paper
        textures, _, logs, _ = fresh_textures(index, 0, seconds=seconds, per_surface=100, turnarounds="keep")
        by_class[_draw(index).material] += zip(1e3 * np.exp(logs), map(_centroid, textures), strict=True)
    rms = np.array([level for segments in by_class.values() for level, _ in segments])
    centroids = [np.mean([centroid for _, centroid in segments]) for segments in by_class.values() if segments]
    measured = {"mean": np.mean(rms), "median": np.median(rms)}
    measured |= {f"{percent}th percentile": np.percentile(rms, percent) for percent in (5, 95)}
    extremes = {"lowest": min(centroids), "highest": max(centroids)}
    share = 0.3 if quick else 0.15  # the sketch of 50 surfaces has a standard error of 10 % itself
    checks = (
        *(
            Check(f"RMS, {name}", 1e3 * value, float(measured[name]), share * 1e3 * value, "mN")
            for name, value in INTENDED_LEVELS.items()
        ),
        *(
            Check(f"{name} mean centroid of a class", value, float(extremes[name]), (share + 0.05) * value, "Hz")
            for name, value in INTENDED_CENTROIDS.items()
        ),
    )

    def draw(panels):
        panels[0].hist(rms, np.geomspace(1, 50, 40))
        panels[0].set_xscale("log")
        for name, value in INTENDED_LEVELS.items():
            panels[0].axvline(1e3 * value, color="C1", linewidth=1)
            panels[0].axvline(measured[name], color="black", linestyle=":", linewidth=1)
        finish(
            panels[0], "RMS of segments; orange: intended, dotted: measured", "mN", "segments", False, (1, 3, 10, 30)
        )
        for panel, column, title, unit in ((panels[1], 0, "RMS", "mN"), (panels[2], 1, "spectral centroid", "Hz")):
            groups = [[segment[column] for segment in segments] for segments in by_class.values()]
            _draw_by_class(panel, groups, f"{title} by class", unit, whiskers=(5, 95))

    source = "the paper's RMSE and SNR imply 9.2 mN; percentiles: the recipe's sketch of 50 surfaces"
    return Law("Levels and centroids of segments", source, checks, 3, draw)


def _centroid(texture):
    """Mean frequency of the power in the band, Hz."""
    frequency, power = signal.welch(texture, DEVICE_RATE, nperseg=DEVICE_RATE // 5)
    power = np.where((frequency >= BAND_HZ[0]) & (frequency <= BAND_HZ[1]), power, 0)
    return float(frequency @ power / power.sum())
