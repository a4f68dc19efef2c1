"""Force at device rate that follows the finger: `TextureStream`."""

import threading

import numpy as np

from ..signal import BAND_HZ, DEVICE_RATE
from .finger import CUTOFF_HZ, FingerPath

#: Speed below which friction turns smoothly with the direction, mm/s: where a resting finger is loaded, not sliding.
TURNING_SPEED = 5.0
#: Speed below which the power of speed, which is meant for sliding, is held, mm/s.
SLOWEST_SLIDING = 10.0
#: Normal force at which textures are recorded, N: the middle of the paper's limits (section 2.1).
REFERENCE_FORCE = 0.5
#: Exponents a, b of a texture's amplitude on normal force and speed, of virtual surfaces (`data.virtual.laws`).
#: Measure them for a real material, or set 0.
FORCE_EXPONENT, SPEED_EXPONENT = 0.8, 0.3
#: Time in which another profile takes over, s: half of what goes unnoticed as a delay (40 ms, Okamoto et al. 2009).
FADE_SECONDS = 0.02
_AXES = np.stack([(np.cos(angle), np.sin(angle)) for angle in (0, np.pi / 3, 2 * np.pi / 3)])


class TextureStream:
    r"""
    Friction force of a finger that moves over a texture, block by block.

    force = -direction (friction_coefficient x Fn + texture(position) x (Fn / 0.5 N)^a x (v / reference speed)^b)

    The texture is a profile over position ([`TextureProfile`]): the same place feels the same in both directions and
    whenever it is passed again, and every frequency follows the speed. Direction turns smoothly through 5 mm/s. The
    profile repeats after `profile.length` mm. On a plane (`dimensions=2`) the surface is alike in all directions: it
    is made of the profile along three axes 60 degrees apart, weighted by how the finger moves; a stroke between two
    axes reads both, 13 % more slowly.

    Reports of the finger (`report`), another profile (`replace`) and blocks (`read`) may come from different threads.

    Args:
        profile (`TextureProfile`): what is under the finger.
        friction_coefficient (`float`): of the mean friction; 0 = texture alone.
        sensor_rate (`float`): of the finger's reports, Hz.
        sampling_rate (`int`, *optional*, defaults to 10000): of the blocks, Hz.
        force_exponent, speed_exponent (`float`, *optional*, defaults to 0.8 and 0.3): the texture grows with these
            powers of normal force Fn and speed v; 0 = off. Below 10 mm/s the power of speed is held.
        cutoff (`float`, *optional*): of the finger's path, Hz; see [`FingerPath`].
        dimensions (`int`, *optional*, defaults to 1): of positions and forces.

    Attributes:
        latency (`float`): s until a change of the finger's speed is felt; a steady finger is followed without delay.

    Raises:
        ValueError: for a friction coefficient that is negative or not finite, or an impossible rate.
    """

    def __init__(
        self,
        profile,
        friction_coefficient,
        sensor_rate,
        sampling_rate=DEVICE_RATE,
        force_exponent=FORCE_EXPONENT,
        speed_exponent=SPEED_EXPONENT,
        cutoff=CUTOFF_HZ,
        dimensions=1,
    ):
        if sampling_rate <= 2 * BAND_HZ[1]:
            raise ValueError(f"`sampling_rate` must be above {2 * BAND_HZ[1]:g} Hz, got {sampling_rate:g}.")
        self._finger = FingerPath(sampling_rate, sensor_rate, cutoff, dimensions)
        self.sampling_rate = sampling_rate
        self.force_exponent, self.speed_exponent = float(force_exponent), float(speed_exponent)
        self._lock = threading.Lock()
        self._surface = _checked(profile, friction_coefficient)
        self._next, self._faded = None, 0
        self._felt, self._left = 0.0, np.zeros((0, dimensions))  # the last force, and what still fades of an older one

    @property
    def latency(self):
        return self._finger.latency

    @property
    def time(self):
        """Time of the next sample, s."""
        return self._finger.time

    def report(self, time, position):
        """Takes reports of the finger: seconds on the clock of `time`, mm. See `FingerPath.report`."""
        with self._lock:
            self._finger.report(time, position)

    def replace(self, profile, friction_coefficient):
        """Puts another surface under the finger: it takes over within 20 ms from the next block on.

        Raises:
            ValueError: for a friction coefficient that is negative or not finite.
        """
        surface = _checked(profile, friction_coefficient)
        with self._lock:
            if (
                self._next is not None
            ):  # a replacement that is still fading in is finished at once where it is heard least
                self._surface = self._next if self._faded > self._fade_samples / 2 else self._surface
            self._next, self._faded = surface, 0

    @property
    def _fade_samples(self):
        return round(FADE_SECONDS * self.sampling_rate)

    def read(self, samples, normal_force=REFERENCE_FORCE):
        """The next block of force.

        Args:
            samples (`int`): of the block, at least 1.
            normal_force (`float` or `np.ndarray`, *optional*): N, one or (samples,); negative counts as 0.

        Returns:
            `np.ndarray`: (samples,), or (samples, 2) on a plane, float32, N, against the direction of motion.

        Raises:
            ValueError: if `samples` is below 1 or `normal_force` is not finite.
        """
        normal_force = np.maximum(np.asarray(normal_force, dtype=np.float64), 0)
        if not np.isfinite(normal_force).all():
            raise ValueError("`normal_force` must be finite; 0 = no contact.")
        with self._lock:
            place, velocity = self._finger.advance(samples)
            speed = np.sqrt(np.square(velocity).sum(axis=1))
            force = self._force(self._surface, place, velocity, speed, normal_force)
            if self._next is not None:
                share = np.clip((self._faded + 1 + np.arange(samples)) / self._fade_samples, 0, 1)
                share = np.sin(0.5 * np.pi * share) ** 2
                force = (1 - share) * force + share * self._force(self._next, place, velocity, speed, normal_force)
                self._faded += samples
                if self._faded >= self._fade_samples:
                    self._surface, self._next = self._next, None
            force = self._joined(-_direction(velocity, speed) * force[:, None]).astype(np.float32)
        return force[:, 0] if self._finger.dimensions == 1 else force

    def _joined(self, force):
        """Where the finger is put down elsewhere, what it felt before fades within 20 ms: no step."""
        begin = 0
        for place in [*self._finger.breaks, len(force)]:
            part = force[begin : min(place, begin + len(self._left))]
            part += self._left[: len(part)]
            self._left, begin = self._left[len(part) :], place
            if place < len(force):
                before = force[place - 1] if place else self._felt
                fade = 0.5 + 0.5 * np.cos(np.pi * np.linspace(0, 1, self._fade_samples, endpoint=False))
                self._left = (before - force[place]) * fade[:, None]
        self._felt = force[-1].copy()
        return force

    def _force(self, surface, place, velocity, speed, normal_force):
        """Magnitude of friction: (samples,), N."""
        profile, friction_coefficient = surface
        pressed = (normal_force / REFERENCE_FORCE) ** self.force_exponent
        moved = (np.maximum(speed, SLOWEST_SLIDING) / profile.reference_speed) ** self.speed_exponent
        return friction_coefficient * normal_force + _read(profile, place, velocity) * pressed * moved


def _read(profile, place, velocity):
    """Texture along a line, or on a plane along the axes that the finger follows most."""
    if velocity.shape[1] == 1:
        return profile.read(place[:, 0], velocity[:, 0])
    along = velocity @ _AXES.T
    weight = along**4 / np.maximum(np.linalg.norm(along**4, axis=1, keepdims=True), 1e-12)
    parts = zip(weight.T, (place @ _AXES.T).T, along.T, strict=True)
    # three places of the profile, as far from each other as can be, that do not resemble each other
    return sum(w * profile.read(x + m * profile.length / 3, v) for m, (w, x, v) in enumerate(parts))


def _checked(profile, friction_coefficient):
    if not callable(getattr(profile, "read", None)):
        raise ValueError(f"`profile` must be a TextureProfile or an EndlessProfile, got {type(profile).__name__}.")
    if not (np.isfinite(friction_coefficient) and friction_coefficient >= 0):
        raise ValueError(f"`friction_coefficient` must be at least 0, got {friction_coefficient}; 0 = texture alone.")
    return profile, float(friction_coefficient)


def _direction(velocity, speed):
    """Unit vectors (samples, dimensions), or shorter: smooth through rest, and of length 1 from `TURNING_SPEED` on."""
    ratio = np.minimum(speed / TURNING_SPEED, 1)
    return velocity * ((1.5 * ratio - 0.5 * ratio**3) / np.maximum(speed, 1e-12))[:, None]
