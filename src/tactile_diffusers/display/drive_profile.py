"""The calibration of a friction display under one finger: from force to drive."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..io.reading import reading
from ..signal import DEVICE_RATE
from ..signal.checks import check_number, check_rows
from .drive_curves import DRIVE_UNITS, check_kind, check_lookup, friction_change, inverse_table
from .drive_files import read_profile, write_profile
from .drive_stream import DriveStream

#: A limit below this (dB) would remove more of the spectrum than the inverse restores.
LOWEST_MAX_GAIN_DB = 3.0


@dataclass(frozen=True, kw_only=True)
class DriveProfile:
    """A calibrated friction display: lateral force = offset + low-pass(gain * curve(drive)).

    The curve is drive squared (V^2) or its lookup for electroadhesion, and minus the lookup for ultrasonic vibration;
    the low-pass is the first-order response of finger and display (Balasubramanian, Pool, Vardar, arXiv 2505.11162),
    whose corner depends on finger speed and differs much between people. Measure it, for instance with
    `fit_drive_profile`; where it is not known, nothing is inverted. A profile holds at the normal force and the speeds
    of the measurement. For corners at several speeds fit each and join them: `dataclasses.replace(slow,
    cutoffs=slow.cutoffs + fast.cutoffs)`. examples/README.md has an example from the sweep to volts under a finger.

    The drive is the amplitude that was commanded in the calibration: if the device modulates a carrier, calibrate with
    that carrier.

    Args:
        kind (`str`): `"electroadhesion"` (drive in V) or `"ultrasonic"` (relative amplitude, 0-1).
        gain (`float`): N/V^2, or a factor on the lookup (1 = as in the lookup).
        offset (`float`): lateral force without drive, N: the natural friction of finger and display.
        cutoffs (`Sequence[tuple[float, float]]`, *optional*): speed in mm/s and corner of the low-pass in Hz, at one
            or more increasing speeds. Linear between them; held, not extrapolated, outside. `None` = not measured.
        max_drive (`float`): largest drive, V or relative amplitude: the device's limit or the largest one calibrated.
        normal_force (`float`): of the calibration, N.
        lookup (`Sequence[tuple[float, float]]`, *optional*): drive (V, or amplitude 0-1) and how much friction it adds
            or takes away, N, from (0, 0), both increasing. An electroadhesive display may do without.
        max_gain_db (`float`, *optional*, defaults to 12.0): limit of the inverse of the low-pass; 0 = no inverse. At
            12 dB, a factor of 4, the display is flat to within 1 dB up to 3.9 times its corner; textures are 20-40 dB
            weaker at 1 kHz than at 20 Hz, so this much there seldom costs headroom.

    Raises:
        ValueError: if a value is missing, not finite, out of range, or against physics; a table not increasing.
    """

    kind: str
    gain: float
    offset: float
    max_drive: float
    normal_force: float
    cutoffs: tuple | None = None
    lookup: tuple | None = None
    max_gain_db: float = 12.0

    def __post_init__(self):
        check_kind(self.kind)
        unit = self.drive_unit
        checked = {
            "gain": check_number("gain", self.gain, "N/V^2" if self.lookup is None else "1", above=0),
            "offset": check_number("offset", self.offset, "N", at_least=0),
            "cutoffs": None if self.cutoffs is None else check_rows("cutoffs", self.cutoffs, ("speed", "cutoff")),
            "max_drive": check_number("max_drive", self.max_drive, unit, above=0),
            "normal_force": check_number("normal_force", self.normal_force, "N", above=0),
            "lookup": check_lookup(self.kind, self.lookup),
            "max_gain_db": check_number("max_gain_db", self.max_gain_db, "dB", at_least=0),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        self._check_limits()

    def _check_limits(self):
        if self.cutoffs and min(min(row) for row in self.cutoffs) <= 0:
            raise ValueError(f"`cutoffs` must hold speeds and corners above zero, got {self.cutoffs}.")
        if 0 < self.max_gain_db < LOWEST_MAX_GAIN_DB:
            raise ValueError(
                f"`max_gain_db` must be 0 (no inverse) or at least {LOWEST_MAX_GAIN_DB:g} dB, got {self.max_gain_db:g}."
            )
        if self.lookup and self.max_drive > self.lookup[-1][0]:
            raise ValueError(
                f"`max_drive` of {self.max_drive:g} is beyond the lookup, which ends at {self.lookup[-1][0]:g}. "
                "Lower it, or measure that far."
            )
        if self.force_range[0] < -self.offset:
            raise ValueError(
                f"`offset` of {self.offset:.4g} N is less than the {-self.force_range[0]:.4g} N that the drive takes "
                "away. Measure the lateral force with its mean, in N."
            )

    @property
    def drive_unit(self):
        """Unit of the drive: "V", or "1" for relative amplitude."""
        return DRIVE_UNITS[self.kind]

    @cached_property
    def force_range(self):
        """Smallest and largest change of lateral force by a steady drive, N: one of the two is 0."""
        low, high = sorted((0.0, float(self.steady_force(self.max_drive))))
        return low, high

    @cached_property
    def _inverse_table(self):
        return inverse_table(self.lookup)

    def steady_force(self, drive):
        """Change of lateral force by a steady drive, N; the shape of `drive`, float64."""
        return self.gain * friction_change(self.kind, self.lookup, drive)

    def steady_drive(self, force):
        """Steady drive for a change of lateral force within `force_range`, N: the inverse of `steady_force`."""
        change = np.abs(np.asarray(force, dtype=np.float64)) / self.gain
        drive = np.interp(change, *self._inverse_table) if self.lookup else np.sqrt(change)
        return np.minimum(drive, self.max_drive)  # rounding must not exceed the device

    def cutoff(self, speed):
        """Corner of the low-pass in Hz at finger speeds in mm/s; the shape of `speed`; infinite if it is not known."""
        if not self.cutoffs:
            return np.full(np.shape(speed), np.inf)
        speeds, corners = np.transpose(self.cutoffs)
        return np.interp(speed, speeds, corners)

    def drive(self, force, speed, *, sampling_rate=DEVICE_RATE, bias=None):
        """Converts a whole texture to drive.

        A display only adds friction (electroadhesion) or only reduces it (ultrasonic), and a texture swings both ways:
        it is played about a mean change of friction, the bias, which the finger feels. By default that is the middle of
        `force_range`; for a texture's own friction coefficient set `bias = friction_coefficient * normal_force -
        profile.offset`, if that is within `force_range`. Force is neither scaled nor filtered otherwise: multiply it
        before, if `report.fitting_scale` says so.

        Args:
            force (`np.ndarray`): (samples,) lateral force about its mean, N; positive = more friction.
            speed (`float` or `np.ndarray`): finger speed, mm/s, at least 0; one number, such as the texture's
                `reference_speed`, or (samples,). Up to 10 mm/s the low-pass is not inverted, from 20 mm/s it is.
            sampling_rate (`float`, *optional*, defaults to 10000): of force and drive, Hz.
            bias (`float`, *optional*): mean change of friction, N, within `force_range`.

        Returns:
            `tuple[np.ndarray, ClippingReport]`: the drive (samples,) float64 in `drive_unit`, within 0 and
            `max_drive`, and what was clipped.

        Raises:
            ValueError: on a bad argument.
        """
        stream = self.stream(sampling_rate=sampling_rate, bias=bias)
        drive = stream.push(force, speed)
        return drive, stream.report

    def stream(self, *, sampling_rate=DEVICE_RATE, bias=None):
        """A `DriveStream` that converts block by block; `sampling_rate`, `bias` and errors as in `drive`."""
        rate = check_number("sampling_rate", sampling_rate, "Hz", above=0)
        low, high = self.force_range
        bias = (low + high) / 2 if bias is None else check_number("bias", bias, "N")
        if not low <= bias <= high:
            raise ValueError(
                f"`bias` must be within {low:.4g} and {high:.4g} N, the change of friction that this display can make, "
                f"got {bias:.4g}. Leave it out for the middle."
            )
        return DriveStream(self, rate, bias)

    def save(self, path):
        """Writes the profile to a JSON file and its lookup, if any, to a CSV file beside it; see `drive_files`."""
        write_profile(path, self)

    @classmethod
    def load(cls, path):
        """Reads a profile that `save` wrote, or one written by hand.

        Raises:
            FileNotFoundError: if it, or the lookup that it names, does not exist.
            ValueError: if it is truncated, lacks a key, has other units, or holds what no profile can.
        """
        with reading(path, "a drive profile", "Correct it."):
            return cls(**read_profile(path))
