"""Force at device rate that follows the finger: `TextureStream`."""

import threading

import numpy as np

from ..signal import BAND_HZ, DEVICE_RATE, REFERENCE_FORCE
from ..signal.checks import check_number, check_whole_number
from .events import EventPlayer
from .finger import CUTOFF_HZ, FingerPath
from .force_laws import FORCE_EXPONENT, SPEED_EXPONENT, direction_length, load_gain, speed_gain

#: Time in which another profile or normal force takes over, s: half of what goes unnoticed as a delay (40 ms, Okamoto
#: et al. 2009).
FADE_SECONDS = 0.02
_AXES = np.stack([(np.cos(angle), np.sin(angle)) for angle in (0, np.pi / 3, 2 * np.pi / 3)])


class TextureStream:
    r"""
    Friction force of a finger that moves over a texture, block by block.

    force = -direction (friction_coefficient x Fn + texture(position) x (Fn / 0.5 N)^a x (v / reference speed)^b)

    `read` returns that force, for a motor; `read_friction` returns what a friction display needs.

    The texture is a profile over position ([`TextureProfile`]): the same place feels the same in both directions, and
    every frequency follows the speed. Direction turns smoothly through 5 mm/s. On a plane (`dimensions=2`) the surface
    is alike in all directions: it consists of the profile along three axes 60 degrees apart, weighted by how the finger
    moves; a stroke between two axes reads both, 13 % more slowly, and of a pure tone, unlike of noise, anything from
    silence to 3 dB more, by its phases there.

    Events of stick-slip (`TextureProfile.events`) are not fixed in space. They go forwards however the finger turns, at
    a rate of the speed times the contact's stiffness over (Fn / 0.5 N)^(2/3), and with laws of level of their own.

    Reports of the finger (`report`), another profile (`replace`) and blocks (`read`) may come from different threads.
    Read as many samples as time passes, whether reports come or not. Reports may come unevenly, their times count. A
    block's length plus a report's lateness should stay below 5 ms; beyond, the finger slows down until its next report.

    Args:
        profile (`TextureProfile`): what is under the finger.
        friction_coefficient (`float`): of the mean friction; 0 = texture alone.
        sensor_rate (`float`): of the finger's reports, Hz.
        sampling_rate (`int`, *optional*, defaults to 10000): of the blocks, Hz.
        force_exponent, speed_exponent (`float`, *optional*, defaults to 0.03 and 0.41): the texture grows with these
            powers of normal force Fn and speed v; 0 = off. Below 10 mm/s the power of speed is held.
        cutoff (`float`, *optional*): of the finger's path, Hz; see [`FingerPath`].
        dimensions (`int`, *optional*, defaults to 1): of positions and forces.

    Attributes:
        latency (`float`): s until a change of the finger's speed is felt; a steady finger is followed without delay.
            1 / sensor_rate + 5 ms + 0.51 / cutoff: 77 ms for 125 Hz and the 8 Hz of the default. A `cutoff` of 16 Hz
            makes it 45 ms, and lets more jitter of a coarse sensor (0.1 mm) through; one of 1 kHz takes off 7 ms.

    Raises:
        ValueError: for a friction coefficient that is negative or not finite, or an impossible rate.
    """

    def __init__(
        self, profile, friction_coefficient, sensor_rate, sampling_rate=DEVICE_RATE, force_exponent=FORCE_EXPONENT,
        speed_exponent=SPEED_EXPONENT, cutoff=CUTOFF_HZ, dimensions=1,
    ):  # fmt: skip
        check_number("sampling_rate", sampling_rate, "Hz", above=2 * BAND_HZ[1])
        self._finger = FingerPath(sampling_rate, sensor_rate, cutoff, dimensions)
        self.sampling_rate = sampling_rate
        self.force_exponent = check_number("force_exponent", force_exponent, "powers of normal force")
        self.speed_exponent = check_number("speed_exponent", speed_exponent, "powers of speed")
        self._lock = threading.Lock()
        # profile, friction coefficient and player of events, those that take over, and for how many samples
        self._surface, self._next, self._faded = self._checked(profile, friction_coefficient), None, 0
        self._fade_samples = round(FADE_SECONDS * sampling_rate)
        # the last force and friction, and what still fades of older ones
        self._last, self._fading = np.zeros(dimensions + 1), np.zeros((0, dimensions + 1))
        self._normal_force = None

    @property
    def profile(self):
        """What is under the finger, or takes over."""
        return (self._next or self._surface)[0]

    @property
    def dimensions(self):
        """Of positions and forces: 1, or 2 on a plane."""
        return self._finger.dimensions

    @property
    def latency(self):
        return self._finger.latency

    @property
    def time(self):
        """Time of the next sample, s: samples read so far / `sampling_rate`."""
        return self._finger.time

    def report(self, time, position):
        """Takes reports of the finger: seconds on the clock of `time`, mm; errors as of `FingerPath.report`."""
        with self._lock:
            self._finger.report(time, position)

    def replace(self, profile, friction_coefficient):
        """Puts another surface under the finger: it takes over within 20 ms from the next block on."""
        surface = self._checked(profile, friction_coefficient)
        with self._lock:
            if self._next is not None and self._faded > self._fade_samples / 2:
                self._surface = self._next  # of two surfaces that still fade into each other the stronger one goes on
            self._next, self._faded = surface, 0

    def read(self, samples, normal_force=REFERENCE_FORCE):
        """The next block of force on the finger.

        Args:
            samples (`int`): of the block, at least 1.
            normal_force (`float` or `np.ndarray`, *optional*): N, (samples,), or one number, which is reached linearly
                within the block, and within 20 ms: no steps, so no clicks. 0 = no contact. Negative counts as 0,
                because a sensor's noise goes below it where nothing presses.

        Returns:
            `np.ndarray`: (samples,), or (samples, 2) on a plane, float32, N, mean friction included. It points against
            the motion: negative while the position grows.

        Raises:
            ValueError: if `samples` is no whole number of at least 1, or `normal_force` not finite or of another shape.
        """
        force = self._block(samples, normal_force)[0][:, :-1]
        return force[:, 0] if self.dimensions == 1 else force

    def read_friction(self, samples, normal_force=REFERENCE_FORCE):
        """The next block as a friction display takes it: `drive = display.push(*stream.read_friction(samples))`.

        Arguments and errors are those of `read`. It moves on like `read`: read each block by one of the two.

        Returns:
            `tuple[np.ndarray, np.ndarray]`: (samples,) float32 each, also on a plane, where a display has one drive,
            too: the friction along the motion about its mean, N, positive = more friction whichever way the finger
            moves; and the finger's speed, mm/s, at least 0. The mean, `friction_coefficient x Fn`, is the display's
            bias: see `DriveProfile.drive`.
        """
        block, speed = self._block(samples, normal_force)
        return block[:, -1], speed

    def read_all(self, samples, normal_force=REFERENCE_FORCE):
        """The next block as both give it: the force of `read`, friction and speed of `read_friction`."""
        block, speed = self._block(samples, normal_force)
        force = block[:, 0] if self.dimensions == 1 else block[:, :-1]
        return force, block[:, -1], speed

    def _block(self, samples, normal_force):
        """Force and, as the last column, friction about its mean: (samples, dimensions + 1); speed (samples,)."""
        check_whole_number("samples", samples)
        with self._lock:
            normal_force = self._smooth_normal_force(normal_force, samples)
            place, velocity = self._finger.advance(samples)
            speed = np.sqrt(np.square(velocity).sum(axis=1))
            friction = self._friction(self._surface, place, velocity, speed, normal_force)
            if self._next is not None:
                share = np.clip((self._faded + 1 + np.arange(samples)) / self._fade_samples, 0, 1)
                share = np.sin(0.5 * np.pi * share) ** 2
                other = self._friction(self._next, place, velocity, speed, normal_force)
                friction = (1 - share) * friction + share * other
                self._faded += samples
                if self._faded >= self._fade_samples:
                    self._surface, self._next = self._next, None
            (total, texture), turned = friction, direction_length(speed)
            direction = velocity * (turned / np.maximum(speed, 1e-12))[:, None]
            block = self._fade_landings(np.column_stack([-direction * total[:, None], turned * texture]))
        return block.astype(np.float32), speed.astype(np.float32)

    def _smooth_normal_force(self, value, samples):
        """N, one or (samples,): a number is reached smoothly."""
        force = np.asarray(value)
        if force.dtype.kind not in "fiu" or force.shape not in ((), (samples,)) or not np.isfinite(force).all():
            raise ValueError(
                f"`normal_force` must be one finite number or one for each sample of the block, ({samples},), in N; "
                f"got {force.dtype} of the shape {force.shape}. 0 = no contact."
            )
        force = np.maximum(force.astype(np.float64), 0)
        before = force.flat[0] if self._normal_force is None else self._normal_force
        self._normal_force = float(force.flat[-1])
        if not force.ndim and before != self._normal_force:
            share = np.minimum((1 + np.arange(samples)) / min(samples, self._fade_samples), 1)
            force = before + (self._normal_force - before) * share
        return force

    def _fade_landings(self, force):
        """Where the finger is put down elsewhere, the force before fades within 20 ms: no step."""
        begin = 0
        for place in [*self._finger.breaks, len(force)]:
            part = force[begin : min(place, begin + len(self._fading))]
            part += self._fading[: len(part)]
            self._fading, begin = self._fading[len(part) :], place
            if place < len(force):
                before = force[place - 1] if place else self._last
                fade = 0.5 + 0.5 * np.cos(np.pi * np.linspace(0, 1, self._fade_samples, endpoint=False))
                self._fading = (before - force[place]) * fade[:, None]
        self._last = force[-1].copy()
        return force

    def _checked(self, profile, friction_coefficient):
        if not callable(getattr(profile, "read", None)):
            raise ValueError(f"`profile` must be a TextureProfile or an EndlessProfile, got {type(profile).__name__}.")
        coefficient = check_number("friction_coefficient", friction_coefficient, "N per N of normal force", at_least=0)
        events = getattr(profile, "events", None)
        for one in (profile, events):  # now, not while a block is due
            if hasattr(one, "prepare"):
                one.prepare()
        return profile, coefficient, None if events is None else EventPlayer(events, self.sampling_rate)

    def _friction(self, surface, place, velocity, speed, normal_force):
        """Magnitude of friction, in all and without its mean: (2, samples), N."""
        profile, friction_coefficient, events = surface
        texture = _read(profile, place, velocity) * load_gain(normal_force, self.force_exponent)
        texture *= speed_gain(speed, profile.reference_speed, self.speed_exponent)
        if events is not None:
            texture += events.advance(speed, normal_force)
        return np.stack([friction_coefficient * normal_force + texture, texture])


def _read(profile, place, velocity):
    """Texture along a line, or on a plane along the axes that the finger follows most."""
    if velocity.shape[1] == 1:
        return profile.read(place[:, 0], velocity[:, 0])
    along = velocity @ _AXES.T
    weight = along**4 / np.maximum(np.linalg.norm(along**4, axis=1, keepdims=True), 1e-12)
    parts = zip(weight.T, (place @ _AXES.T).T, along.T, strict=True)
    # three places of the profile, as far from each other as can be, that do not resemble each other
    return sum(w * profile.read(x + m * profile.length / 3, v) for m, (w, x, v) in enumerate(parts))
