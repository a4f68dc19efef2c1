"""What every check of a law shares: the numbers compared, and a finger that slides steadily."""

from dataclasses import dataclass

import numpy as np

from tactile_diffusers.virtual.exploration import steady_exploration
from tactile_diffusers.virtual.friction import contact_force
from tactile_diffusers.virtual.recipe import SurfaceParameters
from tactile_diffusers.virtual.relief import profile_tables

SPEEDS = (30.0, 45.0, 66.0, 80.0, 99.0, 120.0)
FORCES = (0.2, 0.3, 0.4, 0.5, 0.6, 0.9)
#: A rigid surface without grating, impulses and stick-slip, from which checks make their own; so strong that noise
#: which does not come from the surface does not matter.
PLAIN = SurfaceParameters(
    material="plastic",
    friction=0.5,
    friction_load_exponent=0.0,
    friction_speed_exponent=0.0,
    amplitude=60.0,
    load_exponent=0.0,
    speed_exponent=0.0,
    slope=1.0,
    asperity=0.05,
    grating_level=0.0,
    wavelength=1.25,
    harmonic_decay=1.7,
    jitter=0.0,
    stick=0.0,
    contact_stiffness=0.75,
)


@dataclass(frozen=True)
class Check:
    """One number: intended and measured; `ok` if they differ by no more than `tolerance` (absolute)."""

    quantity: str
    intended: float
    measured: float
    tolerance: float
    unit: str = ""

    @property
    def ok(self):
        return bool(abs(self.measured - self.intended) <= self.tolerance)


@dataclass(frozen=True)
class Law:
    """A law as it was measured.

    Attributes:
        title (`str`): the law.
        source (`str`): where it is from.
        checks (`tuple[Check, ...]`): intended against measured.
    """

    title: str
    source: str
    checks: tuple[Check, ...]

    @property
    def ok(self):
        return all(check.ok for check in self.checks)


def slide(surface, speed, seconds, normal_force=0.5, seed=0, **finger):
    """Contact force (n, 3) of a steady slide along x over a surface drawn from `seed`.

    Args:
        surface (`SurfaceParameters`): the surface.
        speed, seconds, normal_force (`float`): mm/s, s, N.
        seed (`int`): of profile and noise.
        **finger: moisture, gain, cutoff of `contact_force`.
    """
    tables = profile_tables(surface, np.random.default_rng([0, seed]))
    exploration = steady_exploration(speed, normal_force, seconds)
    return contact_force(np.random.default_rng([1, seed]), surface, tables, exploration, **finger)


def exponent(x, y):
    """Slope of log y over log x, by least squares."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])
