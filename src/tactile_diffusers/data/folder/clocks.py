"""Channels of one recording on one clock: time stamps, a common start and velocity from position."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import signal

from ...signal.masks import interpolated

#: A rate this close (share) to a whole number of Hz is that number.
WHOLE_RATE = 1e-3
#: A declared rate and time stamps may differ by this much (share).
RATE_TOLERANCE = 0.01
#: A step between time stamps of more than so many sample periods means dropped samples, unless the stamps are back on
#: schedule within so many samples: then the one stamp came late (recipe).
LONGEST_STEP, SETTLING = 1.5, 5
#: Time stamps with a larger share of duplicates are coarser than the samples (recipe).
MOST_DUPLICATES = 0.1
#: A recording that lacks a larger share of its samples is left out (recipe). Where the rate is found from the stamps,
#: that many gaps mean that it is not found.
MOST_DROPPED = 0.3
#: Force and motion of a recording that differ more in length do not belong together, or a rate is wrong (recipe).
SHORTEST_SHARE = 0.8
#: A start that is later by less than this share of a sample is no later: time stamps are rounded.
START_TOLERANCE = 0.01


class Unusable(ValueError):
    """One recording cannot be used; the others can."""


@dataclass
class Timed:
    """A channel, uniformly sampled: `values` (samples, columns) float64, NaN = missing.

    `start` is the time of the first sample in s (`None` = no time stamps), `rate` in Hz is whole where it is whole
    within 0.1 %, `true_rate` is that on the clock of the stamps, `offset` in s is added to the start, and `counts` is
    what happened -> (samples, first place). `where` names the file in messages.
    """

    values: np.ndarray
    start: float | None
    rate: float
    true_rate: float
    where: str
    offset: float = 0.0
    counts: dict = field(default_factory=dict)

    @property
    def seconds(self):
        return len(self.values) / self.rate


def whole(rate):
    """`rate` as a whole number of Hz if it is within 0.1 % of one."""
    return float(round(rate)) if abs(rate - round(rate)) <= WHOLE_RATE * rate else float(rate)


def on_stamps(values, stamps, rate, where, place=str):
    """Puts samples (n, columns) with time stamps (n,) in s on a uniform clock: `Timed`.

    Jitter is taken for what it is: samples are uniform. Steps of more than 1.5 sample periods are dropped samples and
    become NaN; a repeated or unreadable (NaN) stamp is dropped with its sample. `rate` in Hz is declared, or `None`;
    `place` turns a row into how messages name it.

    Raises:
        ValueError: if time runs backward, the stamps are coarser than the samples, or the declared rate is more than
            1 % off.
        Unusable: if less than two stamps are left, or too many samples are missing.
    """
    rows, counts = _distinct(stamps, where, place)
    time = stamps[rows]
    index = _places(time, rate, where)
    jumps = np.diff(index) > 1
    if jumps.any():
        dropped = int(index[-1]) + 1 - len(index)
        counts["dropped (gaps in the time stamps), NaN"] = dropped, f"after {place(int(rows[np.argmax(jumps)]))}"
    middle, spread = time.mean(), index - index.mean()
    found = float(spread @ spread / (spread @ (time - middle)))  # all stamps tell the clock, not the first and last
    if rate is not None and abs(found / rate - 1) > RATE_TOLERANCE:
        raise _wrong_rate(where, rate, found)
    uniform = np.full((int(index[-1]) + 1, values.shape[1]), np.nan)
    uniform[index] = values[rows]
    start = float(middle - index.mean() / found)
    return Timed(uniform, start, whole(rate or found), found, where, counts=counts)


def _distinct(stamps, where, place):
    """Rows with a stamp of their own, and what happened to the others."""
    counts, rows = {}, np.flatnonzero(~np.isnan(stamps))
    if len(rows) < len(stamps):
        counts["without a readable time stamp"] = len(stamps) - len(rows), place(int(np.argmax(np.isnan(stamps))))
    if len(rows) < 2:
        raise Unusable(f"{where}: has {len(rows)} time stamps")
    steps = np.diff(stamps[rows])
    if (steps < 0).any():
        row = int(rows[1:][np.argmax(steps < 0)])
        raise ValueError(
            f"{where}, {place(row)}: time runs backward by {-steps.min():.4g} s at most, here to {stamps[row]:.6f} s. "
            "Sort or split the file, or leave `time` out and give `rate`."
        )
    repeated = steps == 0
    if repeated.any():
        row = int(rows[1:][np.argmax(repeated)])
        if repeated.mean() > MOST_DUPLICATES:
            raise ValueError(
                f"{where}, {place(row)}: {repeated.mean():.0%} of the time stamps repeat the one before; they are "
                "coarser than the samples. Leave `time` out and give `rate`."
            )
        counts["with a repeated time stamp, dropped"] = int(repeated.sum()), place(row)
        rows = rows[np.concatenate([[True], ~repeated])]
    return rows, counts


def _places(time, rate, where):
    """Index of each of at least two stamps on the uniform clock: (n,) int64."""
    steps = np.diff(time)
    middle, mean = float(np.median(steps)), float(steps.mean())
    doubt = 4 * float(np.median(np.abs(steps - middle))) / np.sqrt(len(steps))  # of the median, from jitter
    # gaps spoil the mean, coarse stamps the median
    if rate is not None and min(abs(middle - 1 / rate) - doubt, abs(mean - 1 / rate)) > RATE_TOLERANCE / rate:
        raise _wrong_rate(where, rate, 1 / middle)
    period = middle if rate is None else 1 / rate
    late = np.flatnonzero(steps > LONGEST_STEP * period)
    # how late is it around the step? A single stamp that came late is followed by a short step
    first = np.maximum(late - SETTLING, np.concatenate([[0], late[:-1] + 1])[: len(late)])
    last = np.minimum(late + 1 + SETTLING, np.concatenate([late[1:], [len(time) - 1]])[: len(late)])
    missing = np.maximum(np.round((time[last] - time[first]) / period - (last - first)), 0)
    share = missing.sum() / (missing.sum() + len(time))
    if share > MOST_DROPPED:
        raise Unusable(f"{where}: {share:.0%} of the samples are missing at {1 / period:.5g} Hz")
    advance = np.ones(len(steps), dtype=np.int64)
    advance[late] += missing.astype(np.int64)
    return np.concatenate([[0], np.cumsum(advance)])


def _wrong_rate(where, rate, found):
    return ValueError(
        f"{where}: `rate` = {rate:g} Hz, but the time stamps are {found:.6g} Hz. Correct `rate` or the unit of `time`."
    )


def on_one_clock(force, motion):
    """Crops two `Timed` to a common first instant, a sample of the slower one; the other is within half a sample.

    A channel without time stamps starts with the other one, if that has some. Where both have, and their clocks run
    apart by more than a sample of `motion`, time is counted in samples of the force: the rate of `motion` is adapted.

    Raises:
        Unusable: if they do not overlap.
    """
    known = [channel.start for channel in (force, motion) if channel.start is not None] or [0.0]
    starts = [(known[0] if c.start is None else c.start) + c.offset for c in (force, motion)]
    rates = force.true_rate, motion.true_rate
    slow = int(rates[1] <= rates[0])
    first = np.ceil((max(starts) - starts[slow]) * rates[slow] - START_TOLERANCE)
    instant = starts[slow] + first / rates[slow]
    skips = [max(0, int(round((instant - start) * rate))) for start, rate in zip(starts, rates, strict=True)]
    if any(skip >= len(channel.values) for skip, channel in zip(skips, (force, motion), strict=True)):
        channels = zip((force, motion), starts, strict=True)
        spans = [f"{channel.where} {start:.3f} to {start + channel.seconds:.3f} s" for channel, start in channels]
        remedy = "check `time`; if both began together, set `offset`"
        raise Unusable(f"force and motion do not overlap in time: {', '.join(spans)}; {remedy}")
    rate, counts = motion.rate, dict(motion.counts)
    if force.start is not None and motion.start is not None:
        ratio = (motion.true_rate / motion.rate) / (force.true_rate / force.rate)
        drift = abs(ratio - 1) * min(force.seconds, motion.seconds) * rate
        if drift > 1:
            rate *= ratio
            counts["by which the clocks of force and motion run apart, compensated"] = math.ceil(drift), ""
    cropped = replace(motion, values=motion.values[skips[1] :], rate=rate, counts=counts)
    return replace(force, values=force.values[skips[0] :]), cropped


def velocity_from_position(position, rate, window=0.05, order=2):
    """Velocity (m, axes) in mm/s from position in mm; NaN stays NaN, the ends are extrapolated.

    A Savitzky-Golay filter (Anal. Chem. 36, 1964) over `window` s, an odd number of samples of at least order + 1.
    White noise of standard deviation s becomes noise of the velocity of about s * rate * sqrt(12 / n^3) for n samples
    and order 1 or 2; a movement of frequency f loses (pi * f * window)^2 / 10 of its amplitude (0.25 % at 1 Hz and
    50 ms).

    Raises:
        Unusable: if there are fewer samples than one window.
    """
    samples = max(int(round(window * rate)), order + 1) | 1
    if len(position) < samples:
        raise Unusable(f"{len(position)} positions are less than one window of {samples} of the velocity filter")
    missing = np.isnan(position)
    slope = signal.savgol_filter(bridged(position), samples, order, deriv=1, delta=1 / rate, axis=0)
    return np.where(missing, np.nan, slope)


def bridged(values):
    """NaN replaced by linear interpolation along time, held at the ends; a column of NaN becomes 0: (n, columns)."""
    values, missing = np.asarray(values, dtype=np.float64), np.isnan(values)
    columns = zip(values.T, missing.T, strict=True)
    return np.stack([np.zeros(len(c)) if gap.all() else interpolated(c, gap) for c, gap in columns], axis=-1)
