"""Time and angle: the only place where t and phi meet.

The angle phi runs from 0 (data) to pi/2 (noise): x = cos(phi) x0 + sin(phi) noise. The timestep that models and
diffusers' schedulers take is t = num_train_timesteps * phi / (pi/2) - 1, a fraction between -1 and the last one.
"""

import math


def to_fraction(timesteps, num_train_timesteps):
    """phi in units of pi/2, from 0 to 1, of timesteps (tensor or number)."""
    return (timesteps + 1) / num_train_timesteps


def to_angle(timesteps, num_train_timesteps):
    """phi in rad of timesteps (tensor or number)."""
    return to_fraction(timesteps, num_train_timesteps) * (math.pi / 2)


def to_timestep(angles, num_train_timesteps):
    """Timesteps of phi in rad (tensor, array or number)."""
    return angles / (math.pi / 2) * num_train_timesteps - 1
