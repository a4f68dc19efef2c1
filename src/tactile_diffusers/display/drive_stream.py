"""From newtons to drive, block by block: limited inverse of the low-pass, bias, clipping, static curve."""

import math
import warnings
from dataclasses import dataclass

import numpy as np

from ..signal.checks import check_number, check_samples
from ..signal.constants import LARGEST_FORCE_N

#: Up to this finger speed (mm/s) nothing is inverted, above the second all is, with a smooth step in between. A finger
#: that hardly moves sticks and slips; 20 mm/s is the slowest at which the low-pass was measured (arXiv 2505.11162).
INVERSE_FROM, INVERSE_FULL = 10.0, 20.0
#: Share of samples that may clip without a warning, and least time, s, that it is a share of: a few peaks do no harm.
CLIPPED_SHARE, CLIPPED_OF_SECONDS = 0.01, 0.1
_DAMPING = math.sqrt(2)  # Butterworth: as flat as a second order gets


def inverse_coefficients(profile, speed, sampling_rate):
    """Coefficients of the limited inverse of the low-pass at speeds (samples,) in mm/s: p, t and its share, (samples,).

    With a drive that is held for a sample, a first-order low-pass at f_c is y[n] = p y[n-1] + (1 - p) x[n-1],
    p = exp(-2 pi f_c / rate). Its inverse (1 - p/z) / (1 - p) is preceded by a second-order Butterworth low-pass
    (bilinear, t = tan(pi f_2 / rate)), and that is what is left of the display in the end. The gain of both squared is
    at most (1 + u / s^2) / (1 + u^2 / t^4), u = tan^2(pi f / rate), s = sinh(pi f_c / rate): its maximum is G^2 for
    t = s sqrt(2 G sqrt(G^2 - 1)). For 12 dB f_2 is 5.5 f_c; a first-order limit of the same height is left with 4 f_c
    and is 1 dB down an octave earlier.
    """
    cutoff = np.minimum(profile.cutoff(speed), sampling_rate)  # no low-pass is seen beyond, and sinh stays finite
    gain = 10 ** (profile.max_gain_db / 20)
    bandwidth = np.sinh(np.pi * cutoff / sampling_rate) * math.sqrt(2 * gain * math.sqrt(gain**2 - 1))
    place = np.clip((speed - INVERSE_FROM) / (INVERSE_FULL - INVERSE_FROM), 0.0, 1.0)
    share = place**2 * (3 - 2 * place) if profile.max_gain_db else np.zeros_like(place)
    return np.exp(-2 * np.pi * cutoff / sampling_rate), bandwidth, share


@dataclass(frozen=True)
class ClippingReport:
    """How much of a force was beyond the display's range.

    Args:
        samples (`int`): samples converted.
        clipped (`int`): of these, samples whose command was beyond the display's range.
        largest_excess (`float`): by how much at most, N of commanded force.
        fitting_scale (`float`): factor on the force at which nothing would have been clipped, at the same bias; above
            1 = room is left; infinite for silence.
        largest_force (`float`): the largest peak, in N, that this force could have had without clipping:
            `fitting_scale` times its peak. NaN for silence.
    """

    samples: int
    clipped: int
    largest_excess: float
    fitting_scale: float
    largest_force: float

    @property
    def share(self):
        """Share of the samples that were clipped, 0-1."""
        return self.clipped / self.samples if self.samples else 0.0

    def __str__(self):
        return (
            f"{100 * self.share:.3g} % of {self.samples} samples clipped, by at most {1e3 * self.largest_excess:.3g} "
            f"mN; peaks up to {1e3 * self.largest_force:.3g} mN fit (factor {self.fitting_scale:.3g})"
        )


class DriveStream:
    """Converts force to drive block by block; the size of the blocks does not matter. See `DriveProfile.stream`.

    It is causal: a sample of drive depends on the force up to the same sample. The force at the finger lags behind by
    the sample for which a drive is held, and by what is left of the low-pass: for frequencies well below its corner
    f_2, sqrt(2) / (2 pi f_2), a quarter of the lag of the display alone at the default limit.

    Args:
        profile (`DriveProfile`), sampling_rate (`float`, Hz), bias (`float`, N): see `DriveProfile.drive`.
    """

    def __init__(self, profile, sampling_rate, bias):
        self.profile, self.sampling_rate, self.bias = profile, sampling_rate, bias
        self._state, self._speed, self._warned = (0.0, 0.0, 0.0), None, False
        self._samples = self._clipped = 0
        self._lowest = self._highest = self._peak = 0.0

    def push(self, force, speed):
        """Converts the next block: `push(*stream.read_friction(samples))` for one of a [`TextureStream`].

        Warns once when more than 1 % of the samples so far were clipped.

        Args:
            force (`np.ndarray`): (samples,) lateral force about its mean, N; positive = more friction.
            speed (`float` or `np.ndarray`): finger speed, mm/s, at least 0; (samples,), or one number, which is
                reached at the end of the block, linearly from the last speed: no steps, so no clicks.

        Returns:
            `np.ndarray`: (samples,) float64, drive in `profile.drive_unit`, within 0 and `profile.max_drive`.

        Raises:
            ValueError: if `force` is not finite, of another shape or larger than any finger's, or `speed` negative,
                not finite or of another shape; the state is then unchanged.
        """
        force = _check_force(force)
        speed = _check_speed(speed, len(force))
        if speed.ndim == 0:
            last = speed if self._speed is None else self._speed
            speed = speed + (last - speed) * (np.arange(len(force))[::-1] / len(force))
        self._speed = float(speed[-1])
        wanted = self._invert(force, speed)
        low, high = self.profile.force_range
        self._samples += len(wanted)
        self._clipped += int(np.count_nonzero((wanted < low - self.bias) | (wanted > high - self.bias)))
        self._lowest = min(self._lowest, float(wanted.min()))
        self._highest = max(self._highest, float(wanted.max()))
        self._peak = max(self._peak, float(np.abs(force).max()))
        allowed = CLIPPED_SHARE * max(self._samples, CLIPPED_OF_SECONDS * self.sampling_rate)
        if self._clipped > allowed and not self._warned:
            self._warned = True
            warnings.warn(
                f"The display cannot make this force: so far {self.report}. Multiply it by `report.fitting_scale` of "
                "the whole, and give friction about its mean, positive = more, as `TextureStream.read_friction` "
                "does: `read` gives a force against the motion.",
                UserWarning,
                stacklevel=2,
            )
        return self.profile.steady_drive(np.clip(wanted + self.bias, low, high))

    @property
    def report(self):
        """`ClippingReport` on everything since the start."""
        low, high = (limit - self.bias for limit in self.profile.force_range)
        rooms = [room / peak for room, peak in ((low, self._lowest), (high, self._highest)) if peak]
        scale = min(rooms, default=math.inf)
        return ClippingReport(
            samples=self._samples,
            clipped=self._clipped,
            largest_excess=max(low - self._lowest, self._highest - high, 0.0),
            fitting_scale=scale,
            largest_force=scale * self._peak if self._peak else math.nan,
        )

    def _invert(self, force, speed):
        """The steady force to command, (samples,) N, so that `force` arrives behind the low-pass."""
        coefficients = inverse_coefficients(self.profile, speed, self.sampling_rate)
        first, second, reached = self._state
        wanted = []
        # sample by sample, because the coefficients move with the speed; this form of the low-pass (trapezoidal
        # integrators as state) stays stable and free of clicks when they do
        for value, pole, bandwidth, share in zip(force.tolist(), *(c.tolist() for c in coefficients), strict=True):
            slope = (first + bandwidth * (value - second)) / (1 + bandwidth * (bandwidth + _DAMPING))
            target = second + bandwidth * slope
            first, second = 2 * slope - first, 2 * target - second
            wanted.append((1 - share) * value + share * (target - pole * reached) / (1 - pole))
            reached = target
        self._state = (first, second, reached)
        return np.array(wanted)


def _check_force(force):
    if np.ndim(force) == 2:
        raise ValueError(
            f"`force` must have the shape (samples,), got {np.shape(force)}: a display has one drive. Pass one channel "
            "of it, or of a stream with `dimensions=2` the friction along the motion: `force, speed = "
            "stream.read_friction(samples)`."
        )
    force = check_samples("force", force)
    largest = float(np.abs(force).max())
    if largest > LARGEST_FORCE_N:
        raise ValueError(
            f"`force` must be in N, got {largest:.4g}, and no fingertip makes {LARGEST_FORCE_N:.0f} N. "
            "The values are probably in mN: divide by 1000."
        )
    return force


def _check_speed(speed, samples):
    if np.ndim(speed) == 0:
        return np.asarray(check_number("speed", speed, "mm/s", at_least=0))
    speed = check_samples("speed", speed)
    if len(speed) != samples:
        raise ValueError(f"`speed` must be one number or one per sample of `force`, {samples}, got {len(speed)}.")
    if speed.min() < 0:
        place = int(speed.argmin())
        raise ValueError(f"`speed` must be at least 0, got {speed[place]:g} at sample {place}. Pass its magnitude.")
    return speed
