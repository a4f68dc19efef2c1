"""Where a finger is at device rate, from a touch sensor that is slow and coarse."""

import warnings
from functools import lru_cache, partial

import numpy as np
from scipy import signal

from ..signal.checks import check_number, check_whole_number
from .force_laws import TURNING_SPEED, direction_length

#: Low-pass of the path, Hz. The jitter that it leaves of a sensor of 125 Hz and 0.1 mm puts 20 dB less energy into the
#: force than the texture has (examples/benchmarks/stream.py); a higher one is quicker and coarser.
CUTOFF_HZ = 8.0
_ORDER = 4
#: Low-pass of the velocity at which the path is led ahead, as a share of the cutoff: at half of it the jitter of a
#: stroke is 4 dB less than with the path's own velocity, and its place off by 2 mm, not 1, where 80 mm of it turn.
_LEAD_SHARE = 0.5
#: Time beyond a sensor's period in which the newest report is expected, s: blocks of up to 50 samples at 10 kHz then
#: give the same path whatever their length.
_MARGIN = 0.005
#: Time in which the velocity takes what a new report allows, s: without it the force would click.
_EASE = 0.002
#: Faster than this between two reports, mm/s, no finger slides: it was lifted and put down elsewhere.
FASTEST = 3000.0
#: After this time without a report, s, the path begins anew where the finger is seen next: it rested or was lifted.
LIFTED_SECONDS = 0.1
#: A report farther from the stream's clock, s, is neither early nor late: it is on another clock, or in another unit.
FAR_SECONDS = 1.0
#: By this factor the reports' rate and `sensor_rate` may differ: sensors skip reports while nothing moves.
RATE_FACTOR = 4.0
#: The rate is estimated over at least this many s, and this many intervals between reports.
WATCHED_SECONDS, LEAST_INTERVALS = 1.0, 8
_CLOCK = (
    "It is s on the stream's clock: 0 at the first sample that is read, and standing still while nothing is read. "
    "Divide milliseconds by 1000. For stamps of another clock set `origin = stamp - stream.time` at the first report, "
    "and again after a pause in reading, and report at `stamp - origin`."
)


class FingerPath:
    """Smooth position and velocity of a finger, block by block, from time-stamped reports of a touch sensor.

    Reports are joined by straight lines, low-passed by a Bessel filter, and led ahead by the delay of both at the
    present, smoothed velocity: a finger of steady speed is followed without delay, a change of speed `latency` later.
    Velocity stays within what was reported over the last `latency`: it neither overshoots where the finger starts nor
    turns before the reports do, 9 to 17 ms after the finger at 125 Hz. Position alone does both, within 0.2 s: until it
    has caught up with a start at full speed, a texture sounds up to 1.6 times too high. Below 2.5 mm/s the finger
    rests, so that a sensor which trembles by 0.1 mm does not turn friction to and fro.

    Before the first report, and when reports stop, the finger rests where it was last seen. After more than 0.1 s
    without a report, or a jump at more than 3 m/s, the path begins anew, at rest, where the finger is then seen.

    Times are on the clock of the blocks, which only reading moves, not the first report.

    Args:
        sampling_rate (`float`): of the blocks, Hz.
        sensor_rate (`float`): of the reports, Hz; between slower ones the finger is taken to rest. A rate four times
            off for a second gives a UserWarning.
        cutoff (`float`, *optional*, defaults to 8.0): Hz. Lower = less jitter, later; see `CUTOFF_HZ`.
        dimensions (`int`, *optional*, defaults to 1): coordinates of a position, 1 or 2.

    Attributes:
        latency (`float`): s, delay of the line and the filter: 1 / sensor_rate + 5 ms + 0.51 / cutoff.
        breaks (`list[int]`): samples of the last block where the path began anew elsewhere.

    Raises:
        ValueError: if a rate or the cutoff is not positive, or the cutoff not below half of the sensor's rate.
    """

    def __init__(self, sampling_rate, sensor_rate, cutoff=CUTOFF_HZ, dimensions=1):
        sampling_rate = check_number("sampling_rate", sampling_rate, "Hz", above=0)
        sensor_rate = check_number("sensor_rate", sensor_rate, "Hz", above=0)
        cutoff = check_number("cutoff", cutoff, "Hz", above=0)
        if cutoff >= sensor_rate / 2:
            raise ValueError(
                f"`cutoff` must be below half of the sensor's {sensor_rate:g} Hz, got {cutoff:g}. Times are in s."
            )
        if dimensions not in (1, 2):
            raise ValueError(f"`dimensions` must be 1 or 2, got {dimensions}.")
        self.sampling_rate, self.sensor_rate, self.dimensions = sampling_rate, sensor_rate, dimensions
        self._wait = 1 / sensor_rate + _MARGIN
        smooth, delay, (b, a) = _filters(cutoff, sampling_rate)
        self.latency = self._wait + delay
        # 1 + latency x low-passed velocity, as one more section: a block is short, and calls cost more than arithmetic
        lead = np.append(a, 0) + self.latency * sampling_rate * np.convolve(b, [1, -1])
        self._sections = np.concatenate([smooth, [[*lead, *a, 0]]])
        self._settled = signal.sosfilt_zi(self._sections)[..., None]
        self._samples = 0
        self._times, self._places = np.empty(0), np.empty((0, dimensions))
        # of the way from the report before to each one: velocity and, as the last column, speed
        self._slopes = np.empty((0, dimensions + 1))
        self._behind = 0.0  # of the reports, s, beyond what is waited for
        self._ease = 1 - np.exp(-1 / (_EASE * sampling_rate))
        self._state = self._last = self._eased = None
        self._landings, self.breaks = [], []
        self._intervals, self._warned = [], set()

    @property
    def time(self):
        """Time of the next sample of a block, s: samples so far / `sampling_rate`."""
        return self._samples / self.sampling_rate

    def report(self, time, position):
        """Takes reports of the sensor.

        Args:
            time (`float` or `np.ndarray`): (n,), s on the clock of the blocks (`time`), ascending. It may pause while
                blocks are read on. To report by a clock of your own, set `origin = now - stream.time` at the first
                report, and again when reading goes on after a pause, and give `now - origin`.
            position (`float` or `np.ndarray`): (n,) or (n, dimensions), mm; of one report also one number, or (2,).

        Raises:
            ValueError: for a time or position that is not finite, of another shape, or not after the last report; for
                a first time that is more than 1 s from `time`, or a later one more than 1 s ahead both of it and of
                the last report. The path is left as it was.
        """
        times, places = _as_reports(time, position, self.dimensions)
        if not len(times):
            return
        now, last = self.time, self._times[-1:]
        if not (np.diff(times, prepend=last) > 0).all():
            raise ValueError(f"`time` must ascend, report after report, got {times} after {last}.")
        # later ones may lag behind (they came late), or follow one another ahead of the clock (a whole recording)
        if not len(last) and abs(times[0] - now) > FAR_SECONDS:
            raise ValueError(
                f"The first `time` must be within {FAR_SECONDS:g} s of {now:.3f} s, got {times[0]:g}. {_CLOCK}"
            )
        if len(last) and times[0] - max(now, last[0]) > FAR_SECONDS:
            raise ValueError(
                f"`time` must be at most {FAR_SECONDS:g} s ahead of `stream.time`, {now:.3f} s, got {times[0]:g}. "
                f"{_CLOCK}"
            )
        self._append(times, places)
        self._behind = max(0.0, now - times[-1] - self._wait)
        self._watch(times, last, now)

    def _append(self, times, places):
        known = np.concatenate([self._times[-1:], times])
        seen = np.concatenate([self._places[-1:], places])
        passed, far = np.diff(known), np.linalg.norm(np.diff(seen, axis=0), axis=1)
        before = np.flatnonzero((far > FASTEST * passed) | ((far > 0) & (passed > LIFTED_SECONDS)))
        landed = before + len(times) - len(passed)  # of the new reports
        self._landings.extend(times[landed].tolist())
        slopes = np.column_stack([np.diff(seen, axis=0), far]) / passed[:, None]
        slopes = np.concatenate([np.zeros((len(times) - len(passed), self.dimensions + 1)), slopes])
        slopes[landed] = 0
        if len(landed):  # until then it rests where it was
            times = np.insert(times, landed, np.nextafter(times[landed], -np.inf))
            places = np.insert(places, landed, seen[before], axis=0)
            slopes = np.insert(slopes, landed, 0, axis=0)
        self._times = np.concatenate([self._times, times])
        self._places = np.concatenate([self._places, places])
        self._slopes = np.concatenate([self._slopes, slopes])

    def _watch(self, times, last, now):
        """Warns, once each, of reports that drift away from the clock, or do not come at the sensor's rate."""
        if abs(times[0] - now) > FAR_SECONDS:
            self._warn(
                "clock",
                f"The finger is reported for {times[0]:.2f} s while the stream is at {now:.2f} s: what is read belongs "
                "to another moment of it. Read as many samples as time passes, or shift the times (a recording that is "
                "read after it was reported needs neither).",
            )
        self._intervals.extend(np.diff(times, prepend=last).tolist())
        if len(self._intervals) < LEAST_INTERVALS or sum(self._intervals) <= WATCHED_SECONDS:
            return
        rate = 1 / float(np.median(self._intervals))  # rests and lifted fingers do not count
        self._intervals = []
        if not 1 / RATE_FACTOR <= rate / self.sensor_rate <= RATE_FACTOR:
            self._warn(
                "rate",
                f"`sensor_rate` is {self.sensor_rate:g} Hz, but reports come at about {rate:.4g} Hz by their times. "
                "With too high a rate the finger is taken to rest between reports, with too low a one it is followed "
                "late. Give the sensor's own rate, and times in s.",
            )

    def _warn(self, kind, message):
        if kind not in self._warned:
            self._warned.add(kind)
            warnings.warn(message, UserWarning, stacklevel=5)  # where `TextureStream.report` is called

    def advance(self, samples):
        """Position and velocity of the next block of `samples`: (samples, dimensions) each, mm and mm/s.

        Raises:
            ValueError: if `samples` is no whole number of at least 1.
        """
        check_whole_number("samples", samples)
        wanted = (self._samples + np.arange(samples)) / self.sampling_rate - self._wait
        self._samples += samples
        if not len(self._times):
            return tuple(np.zeros((2, samples, self.dimensions)))
        seen = wanted - self._behind
        looked = np.stack([wanted, seen - 0.5 * self.latency, seen - self.latency])  # lines: (3, samples, dimensions)
        lines = np.stack([np.interp(looked, self._times, axis) for axis in self._places.T], axis=-1)
        lowest, highest = self._reported(seen, lines)
        landed = [when for when in self._landings if when <= wanted[-1]]
        self._landings = self._landings[len(landed) :]
        self.breaks = sorted({int(np.searchsorted(wanted, when)) for when in landed})
        parts = []
        for begin, end in zip([0, *self.breaks], [*self.breaks, samples], strict=True):
            if begin in self.breaks:
                self._state = None
            if end > begin:
                parts.append(self._smooth(lines[0, begin:end], lowest[begin:end], highest[begin:end]))
        # one report before what is looked at is needed for the line
        old = max(0, np.searchsorted(self._times, looked[-1, -1], side="right") - 1)
        self._times, self._places, self._slopes = self._times[old:], self._places[old:], self._slopes[old:]
        return parts[0] if len(parts) == 1 else tuple(map(np.concatenate, zip(*parts, strict=True)))

    def _reported(self, seen, lines):
        """Lowest and highest velocity and speed of the last `latency`, 0 at rest: (samples, dimensions + 1) each."""
        # after the last report it rests; the second row stands before the first
        slopes = np.concatenate([self._slopes, np.zeros((2, self.dimensions + 1))])
        find = partial(self._times.searchsorted, side="right")
        known = find(seen + (self._wait - _MARGIN))
        within = np.stack([find(seen - self.latency), np.maximum(find(seen) + 1, known)], axis=1).ravel()
        lowest, highest = (extreme.reduceat(slopes, within)[::2] for extreme in (np.minimum, np.maximum))
        # a finger that brakes is expected at rest before it is reported there, but not on its way back
        ahead = slopes + 2 * (slopes - slopes[np.arange(len(slopes)) - 1])
        lowest = np.minimum(lowest, np.maximum(ahead, 0).take(known - 1, axis=0))
        highest = np.maximum(highest, np.minimum(ahead, 0).take(known - 1, axis=0))
        gone = np.sqrt(np.square(np.ptp(lines, axis=0)).sum(axis=1)) / self.latency
        moving = direction_length(np.maximum(2 * gone - TURNING_SPEED, 0))[:, None]
        return lowest * moving, highest * moving

    def _smooth(self, line, lowest, highest):
        """Place and velocity along a line without breaks; led ahead alone, velocity would overshoot and run back."""
        if self._state is None:
            self._state, self._last = self._settled * line[0], line[0]
            self._eased = np.zeros((1, self.dimensions))
        place, self._state = signal.sosfilt(self._sections, line, axis=0, zi=self._state)
        moved = np.diff(place, axis=0, prepend=self._last[None]) * self.sampling_rate
        self._last = place[-1]
        moved = np.minimum(np.maximum(moved, lowest[:, :-1]), highest[:, :-1])
        if self.dimensions > 1:
            speed = np.sqrt(np.square(moved).sum(axis=1))
            moved *= np.minimum(1, highest[:, -1] / np.maximum(speed, 1e-12))[:, None]
        moved, self._eased = signal.lfilter([self._ease], [1, self._ease - 1], moved, axis=0, zi=self._eased)
        return place, moved


@lru_cache(maxsize=8)
def _filters(cutoff, sampling_rate):
    """Sections of the low-pass and its delay, s, and the low-pass of the velocity: 7 ms to design, so kept."""
    smooth = signal.bessel(_ORDER, cutoff, norm="phase", fs=sampling_rate, output="sos")
    low = cutoff / 100
    phase = np.angle(signal.sosfreqz(smooth, worN=[low], fs=sampling_rate)[1][0])
    return smooth, -phase / (2 * np.pi * low), signal.butter(1, _LEAD_SHARE * cutoff, fs=sampling_rate)


def _as_reports(time, position, dimensions):
    """Times (n,), s, and positions (n, dimensions), mm, float64; refuses other shapes and what is not finite."""
    try:
        times = np.atleast_1d(np.asarray(time, dtype=np.float64))
        places = np.asarray(position, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"`time` and `position` must be numbers, got {time!r} and {position!r}.") from error
    row = () if dimensions == 1 else (dimensions,)
    shapes = [(len(times), dimensions), (len(times), *row), *([row] if len(times) == 1 else [])]
    if times.ndim != 1 or places.shape not in shapes:
        form = "(n, 2), x and y in mm; for a line leave `dimensions=2` out"
        if dimensions == 1:
            form = "(n,), mm; for x and y make it with `dimensions=2`"
        raise ValueError(
            f"`time` and `position` must be of equal number, (n,) and {form}. Got {times.shape} and {places.shape}."
        )
    if not (np.isfinite(times).all() and np.isfinite(places).all()):
        raise ValueError("`time` and `position` must be finite: leave out reports without a finger.")
    return times, places.reshape(-1, dimensions)
