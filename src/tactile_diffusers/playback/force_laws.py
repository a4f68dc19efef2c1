"""How the force of a texture depends on what the finger does: the laws of `TextureStream`, each a small function.

Measure the exponents for a real material, or set 0. The browser demo's JavaScript follows the same laws, and is tested
against a stream.
"""

import numpy as np

from ..signal.constants import FORCE_EXPONENT, REFERENCE_FORCE, SLOWEST_SLIDING, SPEED_EXPONENT

#: Speed below which friction turns smoothly with the direction, mm/s: where a resting finger is loaded, not sliding.
TURNING_SPEED = 5.0


def load_gain(normal_force, exponent=FORCE_EXPONENT):
    """(Fn / 0.5 N)^a; `normal_force` in N, numbers or arrays."""
    return (normal_force / REFERENCE_FORCE) ** exponent


def speed_gain(speed, reference_speed, exponent=SPEED_EXPONENT):
    """(v / reference speed)^b, held below 10 mm/s; speeds in mm/s."""
    return (np.maximum(speed, SLOWEST_SLIDING) / reference_speed) ** exponent


def direction_length(speed):
    """Length of the direction of motion: from 0 at rest smoothly to 1 at 5 mm/s."""
    ratio = np.minimum(speed / TURNING_SPEED, 1)
    return 1.5 * ratio - 0.5 * ratio**3
