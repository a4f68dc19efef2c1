"""The laws of finger friction: what it depends on, each a small pure function with its source.

Forces are in N, speeds in mm/s, numbers or arrays. "Recipe" marks a size of ours that no source settles.
"""

import numpy as np

from ..signal.constants import REFERENCE_FORCE, SLOWEST_SLIDING, STIFFNESS_PER_SPEED
from .recipe import REFERENCE_SPEED_MM_S

#: Common gain that brings band-passed segments to the RMS that the paper's RMSE and SNR imply: mean 0.0090 N over many
#: surfaces (examples/research/validate_virtual.py measures it).
COMMON_GAIN = 1.12
#: A grating of compliance 1 has a quarter more friction, which rises with this power of speed, and a background whose
#: amplitude falls with this power (recipe; their signs: Brewer, Meyer 2014). A quarter keeps the stickiest rubber
#: within the published coefficients, up to 2.79.
COMPLIANT_FRICTION = 0.25
COMPLIANT_SPEED_EXPONENT = 0.3
COMPLIANT_BACKGROUND_EXPONENT = -0.8
#: Cutoff of the finger's first-order low-pass per mm/s of speed (arXiv 2505.11162), and its upper end (Hz).
CUTOFF_PER_SPEED = 13.8
HIGHEST_CUTOFF = 1500.0
#: Share of the contact that sticks and slips together (recipe).
SLIPPING_SHARE = 0.05
HIGHEST_STICK_SLIP_HZ = 2000.0
#: How much more readily a contact sticks and slips when moist, pressed and slow: shift of the gate, in its standard
#: deviations, per unit of log moisture, log force and log speed (recipe; the signs: adhesion grows with moisture and
#: load, and fast sliding is steady).
STICKS_WHEN_MOIST, STICKS_WHEN_PRESSED, STICKS_WHEN_FAST = 1.0, 0.5, -0.5
#: Static over sliding friction when the finger begins to move, and the travel (mm) after which it has gone (recipe).
FIRST_SLIP, FIRST_SLIP_TRAVEL = 0.2, 1.0


def relative_speed(speed):
    """v / 80 mm/s, held below 10 mm/s."""
    return np.maximum(speed, SLOWEST_SLIDING) / REFERENCE_SPEED_MM_S


def friction_coefficient(surface, normal_force, speed, moisture=1.0):
    """mu0 moisture (Fn / 0.5 N)^a (v / 80 mm/s)^b with the exponents of friction, times a compliant grating's factor.

    The coefficient falls with load by about -1/3 on smooth surfaces and is constant on rough ones; its dependence on
    speed has either sign (recipe).
    """
    load = (normal_force / REFERENCE_FORCE) ** surface.friction_load_exponent
    rigid = surface.friction * moisture * load * relative_speed(speed) ** surface.friction_speed_exponent
    return rigid * compliant_friction(surface, speed)


def compliant_friction(surface, speed):
    """Factor of a compliant grating on the friction coefficient: higher, and rising with speed (Brewer, Meyer 2014).

    (1 + 0.25 c) (v / 80 mm/s)^(0.3 c); sizes are a recipe.
    """
    more = 1 + COMPLIANT_FRICTION * surface.compliance
    return more * relative_speed(speed) ** (COMPLIANT_SPEED_EXPONENT * surface.compliance)


def compliant_background(surface, speed):
    """Factor of a compliant grating on the amplitude of the background between its lines (Brewer, Meyer 2014).

    The background's 1/f noise falls with speed: (v / 80 mm/s)^(-0.8 c), beside the amplitude's own exponent; the size
    is a recipe.
    """
    return relative_speed(speed) ** (COMPLIANT_BACKGROUND_EXPONENT * surface.compliance)


def texture_amplitude(surface, normal_force, speed, gain=1.0):
    """rms of the friction fluctuation in N: common gain times g gain (Fn / 0.5 N)^a (v / 80 mm/s)^b, per surface.

    Measured exponents (`recipe.LOAD_EXPONENT`, `recipe.SPEED_EXPONENT`) are a stylus's; a finger's are not published.
    """
    load = (normal_force / REFERENCE_FORCE) ** surface.load_exponent
    return COMMON_GAIN * 1e-3 * surface.amplitude * gain * load * relative_speed(speed) ** surface.speed_exponent


def finger_cutoff(speed, cutoff=1.0):
    """Cutoff of the finger in Hz: proportional to speed, 13.8 Hz per mm/s (arXiv 2505.11162), at most 1.5 kHz.

    Args:
        cutoff (`float`): the explorer's factor on it.
    """
    return cutoff * np.minimum(CUTOFF_PER_SPEED * speed, HIGHEST_CUTOFF)


def contact_stiffness(surface, speed):
    """Tangential stiffness of the contact in N/mm: rises by 4.04 N/m per mm/s (arXiv 2505.11162).

    0.6-0.9 N/mm at 80 mm/s, in the recipe; the published intercept is not known to us.
    """
    return surface.contact_stiffness + STIFFNESS_PER_SPEED * (np.maximum(speed, SLOWEST_SLIDING) - REFERENCE_SPEED_MM_S)


def stick_slip_rate(surface, sliding_friction, speed):
    """Frequency of the relaxation oscillator in Hz.

    The patch that sticks carries `SLIPPING_SHARE` of the friction and of the contact's stiffness k; it is charged at
    k v and drops by the excess of its static over its sliding friction, stick mu Fn, so that a period lasts
    stick mu Fn / (k v): rapid relaxation oscillations (Wiertlewski 2011); k 0.6-0.9 N/mm and 5 % are a recipe.
    """
    travel = np.maximum(surface.stick * sliding_friction, 1e-6) / contact_stiffness(surface, speed)
    return np.minimum(speed / travel, HIGHEST_STICK_SLIP_HZ)


def stick_slip_drop(surface, sliding_friction):
    """Size of a drop in N: 5 % stick mu Fn (recipe)."""
    return SLIPPING_SHARE * surface.stick * sliding_friction


def stick_slip_readiness(normal_force, speed, moisture=1.0):
    """Shift of the gate that lets stick-slip come and go: more when moist and pressed, less when fast (recipe)."""
    return (
        STICKS_WHEN_MOIST * np.log(moisture)
        + STICKS_WHEN_PRESSED * np.log(normal_force / REFERENCE_FORCE)
        + STICKS_WHEN_FAST * np.log(relative_speed(speed))
    )


def first_slip(travelled):
    """Factor on the sliding friction after `travelled` mm from rest: 1.2, falling to 1 within some millimetres."""
    return 1 + FIRST_SLIP * np.exp(-travelled / FIRST_SLIP_TRAVEL)
