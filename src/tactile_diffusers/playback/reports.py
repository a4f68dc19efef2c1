"""Checks of a finger's reports: their shape, the stream's clock, and about the sensor's rate."""

import warnings

import numpy as np

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


def check_reports(time, position, dimensions):
    """Times (n,), s, and positions (n, dimensions), mm, float64.

    Raises:
        ValueError: for another shape, or what is not finite.
    """
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


def check_clock(time, now, last):
    """Refuses a report on another clock.

    The first report must lie near the stream's time. Later ones may lag behind it (they came late), and may be ahead
    if they follow one another (a recording that is reported as a whole and read afterwards).

    Args:
        time, now (`float`): of the report, and of the stream, s.
        last (`np.ndarray`): time of the report before, (1,), s, or (0,).

    Raises:
        ValueError: if it is the first and more than 1 s from `now`, or more than 1 s after `now` and `last`.
    """
    if not len(last) and abs(time - now) > FAR_SECONDS:
        raise ValueError(f"The first `time` must be within {FAR_SECONDS:g} s of {now:.3f} s, got {time:g}. {_CLOCK}")
    if len(last) and time - max(now, last[0]) > FAR_SECONDS:
        raise ValueError(
            f"`time` must be at most {FAR_SECONDS:g} s ahead of `stream.time`, {now:.3f} s, got {time:g}. {_CLOCK}"
        )


class ReportWatch:
    """Warns, once each, of reports that drift away from the stream's clock or do not come at the sensor's rate.

    Args:
        sensor_rate (`float`): of the stream, Hz.
    """

    def __init__(self, sensor_rate):
        self.sensor_rate = sensor_rate
        self._intervals, self._warned = [], set()

    def see(self, times, last, now):
        """Checks reports (n,), s, that follow one at `last` ((1,), or (0,) for the first), at the stream's time `now`.

        Only the first may be far from the clock: a recording may be reported as a whole.
        """
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
