"""The recipe of virtual surfaces: material classes, ranges of their parameters, and how one surface is drawn.

Docstrings of this folder cite a source where there is one; "recipe" marks a choice of ours that no source settles.
"""

from dataclasses import dataclass

import numpy as np

#: Raised whenever the same seed gives other data. 2: compliant gratings, exploration that adapts to roughness, fingers
#: of different mechanics, contact stiffness that rises with speed, levels of the size that the paper implies.
RECIPE_VERSION = 2
#: Speed at which every parameter holds; the normal force is `REFERENCE_FORCE`.
REFERENCE_SPEED_MM_S = 80.0


@dataclass(frozen=True)
class MaterialClass:
    """Ranges of one class: `count` of 50 surfaces, friction coefficient at 0.5 N, amplitude (mN rms), spatial slope,
    probability and wavelength (mm) of a grating, stick (0 = steady sliding, 1 = full stick-slip)."""

    name: str
    count: int
    friction: tuple[float, float]
    amplitude: tuple[float, float]
    slope: tuple[float, float]
    grating_probability: float
    wavelength: tuple[float, float]
    stick: tuple[float, float]


#: Friction coefficients bracket those published for fingers (0.27-0.42 on paper, 0.39-0.66 on
#: suede, 0.38 +- 0.13 on aluminium, 0.61 +- 0.10 on sandpaper, up to 2.79 on rosin glass); the classes, their shares
#: and the other ranges are our assumption.
CLASSES = (
    MaterialClass("glass", 5, (0.9, 1.6), (2, 5), (1.0, 1.6), 0.0, (1.0, 1.0), (0.0, 0.5)),
    MaterialClass("metal", 6, (0.5, 1.0), (3, 7), (0.8, 1.4), 0.2, (0.3, 1.0), (0.0, 0.2)),
    MaterialClass("plastic", 8, (0.4, 1.0), (3, 9), (0.7, 1.4), 0.3, (0.4, 2.0), (0.0, 0.3)),
    MaterialClass("wood", 7, (0.4, 0.7), (5, 12), (0.6, 1.2), 0.4, (0.5, 2.5), (0.0, 0.05)),
    MaterialClass("paper", 5, (0.3, 0.55), (3, 8), (0.4, 1.0), 0.0, (1.0, 1.0), (0.0, 0.0)),
    MaterialClass("fabric", 9, (0.3, 0.65), (6, 16), (0.3, 1.0), 0.8, (0.25, 2.5), (0.0, 0.03)),
    MaterialClass("abrasive", 5, (0.6, 1.0), (10, 20), (-0.2, 0.5), 0.0, (1.0, 1.0), (0.0, 0.0)),
    MaterialClass("rubber", 5, (1.0, 2.2), (6, 14), (0.9, 1.7), 0.2, (1.0, 4.0), (0.5, 1.0)),
)


#: Classes whose gratings yield under the finger, and how much (0 = rigid): our assumption.
SOFT_CLASSES = ("fabric", "rubber")
COMPLIANCE = (0.4, 1.0)


@dataclass(frozen=True)
class SurfaceParameters:
    """What defines a virtual surface, apart from the random phases of its profile.

    Attributes:
        material (`str`): class name.
        friction (`float`): friction coefficient at 0.5 N and 80 mm/s on dry-normal skin, before compliance.
        load_exponent (`float`): of the friction coefficient on normal force, -1/3 (smooth) to 0 (rough).
        speed_exponent (`float`): of the friction coefficient on speed.
        amplitude (`float`): mN rms of the friction fluctuation before the common gain.
        slope (`float`): exponent of the profile's power spectrum over spatial frequency.
        asperity (`float`): mm, size below which the profile is smooth to the finger.
        grating_level (`float`): rms of the grating relative to the random profile; 0 = none.
        wavelength (`float`): mm.
        harmonic_decay (`float`): non-integer exponent of the grating's harmonics.
        jitter (`float`): relative standard deviation of the grating's periods.
        stick (`float`): 0-1.
        contact_stiffness (`float`): N/mm, tangential, at 80 mm/s.
        compliance (`float`): of a grating, 0 = rigid to 1.
    """

    material: str
    friction: float
    load_exponent: float
    speed_exponent: float
    amplitude: float
    slope: float
    asperity: float
    grating_level: float
    wavelength: float
    harmonic_decay: float
    jitter: float
    stick: float
    contact_stiffness: float
    compliance: float = 0.0


def load_exponent(slope):
    """Exponent of the friction coefficient on normal force: -1/3 on smooth surfaces to 0 on rough ones.

    The two ends are published; smoothness is read from the profile's slope (flat spectrum = rough), linearly.
    """
    slopes = [bound for material in CLASSES for bound in material.slope]
    return -(slope - min(slopes)) / (max(slopes) - min(slopes)) / 3


def draw_surface(rng, compliance_rng):
    """Draws one surface (recipe): class by its share of 50, every parameter uniform in its range.

    Args:
        rng (`np.random.Generator`): consumed in a fixed order.
        compliance_rng (`np.random.Generator`): of the compliance alone.

    Returns:
        `SurfaceParameters`.
    """
    counts = np.array([material.count for material in CLASSES])
    material = CLASSES[rng.choice(len(CLASSES), p=counts / counts.sum())]
    slope = rng.uniform(*material.slope)
    friction, amplitude = rng.uniform(*material.friction), rng.uniform(*material.amplitude)
    speed_exponent = 0.15 * rng.standard_normal()
    asperity = rng.uniform(0.05, 0.4)
    stick, stiffness = rng.uniform(*material.stick), rng.uniform(0.6, 0.9)
    has_grating = rng.random() < material.grating_probability
    level, wavelength = rng.uniform(0.4, 1.6), rng.uniform(*material.wavelength)
    decay, jitter = rng.uniform(1.2, 2.2), rng.uniform(0.02, 0.15)
    compliance = compliance_rng.uniform(*COMPLIANCE) if has_grating and material.name in SOFT_CLASSES else 0.0
    return SurfaceParameters(
        material=material.name,
        friction=friction,
        load_exponent=load_exponent(slope),
        speed_exponent=speed_exponent,
        amplitude=amplitude,
        slope=slope,
        asperity=asperity,
        grating_level=level if has_grating else 0.0,
        wavelength=wavelength,
        harmonic_decay=decay,
        jitter=jitter,
        stick=stick,
        contact_stiffness=stiffness,
        compliance=compliance,
    )
