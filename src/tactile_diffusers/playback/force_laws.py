"""How the force of a texture depends on what the finger does: the laws of `TextureStream`, each a small function.

Measure the exponents for a real material, or set 0. The browser demo's JavaScript follows the same laws, and is tested
against a stream.
"""

import numpy as np

from ..signal.constants import (
    ADHESION_EXPONENT,
    CONTACT_STIFFNESS,
    FORCE_EXPONENT,
    REFERENCE_FORCE,
    SLOWEST_SLIDING,
    SPEED_EXPONENT,
    STICKING_FORCE_EXPONENT,
    STICKING_SPEED_EXPONENT,
    STIFFNESS_PER_SPEED,
)

#: Speed below which friction turns smoothly with the direction, mm/s: where a resting finger is loaded, not sliding.
TURNING_SPEED = 5.0
#: Ranges in which the rate of events follows load (N) and speed (relative to the reference); beyond it is held.
LEAST_EVENT_FORCE, LARGEST_EVENT_SPEED = 0.05, 4.0


def load_gain(normal_force, exponent=FORCE_EXPONENT):
    """(Fn / 0.5 N)^a, and 0 without contact, whatever the exponent; `normal_force` in N, numbers or arrays."""
    touching = normal_force > 0
    return touching * (np.where(touching, normal_force, REFERENCE_FORCE) / REFERENCE_FORCE) ** exponent


def speed_gain(speed, reference_speed, exponent=SPEED_EXPONENT):
    """(v / reference speed)^b, held below 10 mm/s; speeds in mm/s."""
    return (np.maximum(speed, SLOWEST_SLIDING) / reference_speed) ** exponent


def event_rate(speed, normal_force, reference_speed):
    """Events per mm over those at the reference: k(v) / k(reference speed) / (Fn / 0.5 N)^(2/3).

    A relaxation oscillation: its period is its drop over stiffness times speed (Wiertlewski 2011), and its drop grows
    as friction does.
    """
    speed = np.clip(speed, SLOWEST_SLIDING, LARGEST_EVENT_SPEED * reference_speed)
    stiffness = np.maximum(1 + STIFFNESS_PER_SPEED / CONTACT_STIFFNESS * (speed - reference_speed), 0.1)
    return stiffness / (np.maximum(normal_force, LEAST_EVENT_FORCE) / REFERENCE_FORCE) ** ADHESION_EXPONENT


def event_gain(speed, normal_force, reference_speed):
    """Level of events over that at the reference: as their drop, (Fn / 0.5 N)^(2/3), and how readily they come."""
    pressed = (normal_force / REFERENCE_FORCE) ** (ADHESION_EXPONENT + STICKING_FORCE_EXPONENT)
    return pressed * speed_gain(speed, reference_speed, STICKING_SPEED_EXPONENT)


def direction_length(speed):
    """Length of the direction of motion: from 0 at rest smoothly to 1 at 5 mm/s."""
    ratio = np.minimum(speed / TURNING_SPEED, 1)
    return 1.5 * ratio - 0.5 * ratio**3
