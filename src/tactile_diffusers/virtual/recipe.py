"""The recipe of virtual surfaces: material classes, ranges of their parameters, and how one surface is drawn.

Docstrings of this folder cite a source where there is one; "recipe" marks a choice of ours that no source settles.
"""

from dataclasses import dataclass

import numpy as np

from ..signal import constants

#: Raised whenever the same seed gives other data. 3: correlated percepts, impulses, polarity, measured exponents of
#: load and speed, onset (`examples/results/laws/hands.md` has the measurements).
RECIPE_VERSION = 3
#: Speed at which every parameter holds; the normal force is `REFERENCE_FORCE`.
REFERENCE_SPEED_MM_S = 80.0


@dataclass(frozen=True)
class MaterialClass:
    """Ranges of one class.

    Attributes:
        name (`str`): of the class.
        count (`int`): surfaces among 50.
        adhesion (`tuple[float, float]`): friction coefficient at 0.5 N without relief.
        amplitude (`tuple[float, float]`): mN rms.
        slope (`tuple[float, float]`): of the spectrum over spatial frequency.
        grating_probability (`float`): 0-1.
        wavelength (`tuple[float, float]`): mm.
        stick (`tuple[float, float]`): excess of static over sliding friction, 0 = steady sliding.
        intermittency (`tuple[float, float]`): standard deviation of the profile's log envelope.
        catches (`float`): most catches per mm; most surfaces of a class have far fewer.
    """

    name: str
    count: int
    adhesion: tuple[float, float]
    amplitude: tuple[float, float]
    slope: tuple[float, float]
    grating_probability: float
    wavelength: tuple[float, float]
    stick: tuple[float, float]
    intermittency: tuple[float, float]
    catches: float


#: Friction coefficients bracket those published for fingers (0.27-0.42 on paper, 0.39-0.66 on suede, 0.38 +- 0.13 on
#: aluminium, 0.61 +- 0.10 on sandpaper, up to 2.79 on rosin glass); the classes, their shares and the other ranges are
#: our assumption.
CLASSES = (
    MaterialClass("glass", 4, (0.5, 1.2), (2, 5), (1.0, 1.6), 0.0, (1.0, 1.0), (0.0, 0.5), (0.0, 0.15), 0.01),
    MaterialClass("metal", 6, (0.25, 0.6), (3, 7), (0.8, 1.4), 0.2, (0.3, 1.0), (0.0, 0.2), (0.0, 0.25), 0.03),
    MaterialClass("plastic", 9, (0.2, 0.6), (3, 9), (0.7, 1.4), 0.3, (0.4, 2.0), (0.0, 0.3), (0.0, 0.35), 0.05),
    MaterialClass("wood", 7, (0.2, 0.5), (5, 12), (0.6, 1.2), 0.4, (0.5, 2.5), (0.0, 0.05), (0.1, 0.45), 0.2),
    MaterialClass("paper", 5, (0.15, 0.4), (3, 8), (0.4, 1.0), 0.0, (1.0, 1.0), (0.0, 0.0), (0.0, 0.25), 0.05),
    MaterialClass("fabric", 10, (0.2, 0.5), (6, 16), (0.3, 1.0), 0.8, (0.25, 2.5), (0.0, 0.03), (0.1, 0.45), 0.2),
    MaterialClass("abrasive", 6, (0.4, 0.7), (10, 20), (-0.2, 0.5), 0.0, (1.0, 1.0), (0.0, 0.0), (0.0, 0.35), 0.1),
    MaterialClass("rubber", 3, (0.7, 1.8), (6, 14), (0.9, 1.7), 0.2, (1.0, 4.0), (0.5, 1.0), (0.0, 0.4), 0.05),
)
#: Classes whose gratings yield under the finger, and how much (0 = rigid): our assumption.
SOFT_CLASSES = ("fabric", "rubber")
COMPLIANCE = (0.4, 1.0)
#: Relief catches the skin: the friction coefficient rises by this much per mN rms of amplitude, grating included
#: (the sign of a deformation term beside adhesion; its size, a recipe, gives r(log friction, level) = 0.5 as HaTT has).
RELIEF_FRICTION = 0.025
#: Exponents of the texture's amplitude on normal force and speed: median, standard deviation and least and greatest
#: over surfaces (the medians are `signal.constants`'; 5-95 % of HaTT's surfaces are -0.08 to 0.19 and 0.14 to 0.82).
LOAD_EXPONENT = (constants.FORCE_EXPONENT, 0.08, -0.15, 0.30)
SPEED_EXPONENT = (constants.SPEED_EXPONENT, 0.21, 0.0, 1.0)


@dataclass(frozen=True)
class SurfaceParameters:
    """What defines a virtual surface, apart from the random phases of its profile.

    Attributes:
        material (`str`): class name.
        friction (`float`): friction coefficient at 0.5 N and 80 mm/s on dry-normal skin, before compliance.
        friction_load_exponent (`float`): of the friction coefficient on normal force, -1/3 (smooth) to 0 (rough).
        friction_speed_exponent (`float`): of the friction coefficient on speed.
        amplitude (`float`): mN rms of the friction fluctuation before the common gain.
        load_exponent, speed_exponent (`float`): of the amplitude on normal force and speed.
        slope (`float`): exponent of the profile's power spectrum over spatial frequency.
        asperity (`float`): mm, size below which the profile is smooth to the finger.
        grating_level (`float`): rms of the grating relative to the random profile; 0 = none.
        wavelength (`float`): mm.
        harmonic_decay (`float`): non-integer exponent of the grating's harmonics.
        jitter (`float`): relative standard deviation of the grating's periods.
        stick (`float`): 0-1, excess of static over sliding friction.
        contact_stiffness (`float`): N/mm, tangential, at 80 mm/s.
        compliance (`float`): of a grating, 0 = rigid to 1.
        intermittency (`float`): standard deviation of the log envelope of the profile over position; 0 = Gaussian.
        catches (`float`): isolated catches (threads, pores, knots, edges) per mm.
        catch_height (`float`): median height of a catch relative to the rms of the random profile.
        catch_length (`float`): mm over which a catch loads.
    """

    material: str
    friction: float
    friction_load_exponent: float
    friction_speed_exponent: float
    amplitude: float
    load_exponent: float
    speed_exponent: float
    slope: float
    asperity: float
    grating_level: float
    wavelength: float
    harmonic_decay: float
    jitter: float
    stick: float
    contact_stiffness: float
    compliance: float = 0.0
    intermittency: float = 0.0
    catches: float = 0.0
    catch_height: float = 0.0
    catch_length: float = 0.5


def friction_load_exponent(slope):
    """Exponent of the friction coefficient on normal force: -1/3 on smooth surfaces to 0 on rough ones.

    The two ends are published; smoothness is read from the profile's slope (flat spectrum = rough), linearly.
    """
    slopes = [bound for material in CLASSES for bound in material.slope]
    return -(slope - min(slopes)) / (max(slopes) - min(slopes)) / 3


def draw_surface(rng, impulsiveness=1.0):
    """Draws one surface (recipe): class by its share of 50, most parameters uniform in their ranges.

    Args:
        rng (`np.random.Generator`): consumed in a fixed order, whatever the impulsiveness.
        impulsiveness (`float`): factor on intermittency and on the number of catches; 0 = a Gaussian profile.

    Returns:
        `SurfaceParameters`.
    """
    counts = np.array([material.count for material in CLASSES])
    material = CLASSES[rng.choice(len(CLASSES), p=counts / counts.sum())]
    slope, amplitude = rng.uniform(*material.slope), rng.uniform(*material.amplitude)
    has_grating = rng.random() < material.grating_probability
    level = rng.uniform(0.4, 1.6) * has_grating
    compliance = rng.uniform(*COMPLIANCE) * (has_grating and material.name in SOFT_CLASSES)
    return SurfaceParameters(
        material=material.name,
        friction=rng.uniform(*material.adhesion) + RELIEF_FRICTION * amplitude * np.hypot(1, level),
        friction_load_exponent=friction_load_exponent(slope),
        friction_speed_exponent=0.15 * rng.standard_normal(),
        amplitude=amplitude,
        load_exponent=_normal(rng, *LOAD_EXPONENT),
        speed_exponent=_normal(rng, *SPEED_EXPONENT),
        slope=slope,
        asperity=rng.uniform(0.05, 0.4),
        grating_level=level,
        wavelength=rng.uniform(*material.wavelength),
        harmonic_decay=rng.uniform(1.2, 2.2),
        jitter=rng.uniform(0.02, 0.15),
        stick=rng.uniform(*material.stick),
        contact_stiffness=rng.uniform(0.6, 0.9),
        compliance=compliance,
        intermittency=impulsiveness * rng.uniform(*material.intermittency),
        catches=impulsiveness * material.catches * rng.uniform() ** 4,
        catch_height=rng.uniform(3.0, 7.0),
        catch_length=rng.uniform(0.3, 1.0),
    )


def _normal(rng, middle, deviation, least, greatest):
    """A normal draw, held between two ends."""
    return float(np.clip(middle + deviation * rng.standard_normal(), least, greatest))
