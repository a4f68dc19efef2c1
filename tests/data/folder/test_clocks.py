"""Time stamps, a common start and velocity: against signals that are known at every instant."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_diffusers.data.folder.clocks import (
    Timed,
    Unusable,
    on_one_clock,
    on_stamps,
    velocity_from_position,
    whole,
)


def column(values):
    return np.asarray(values, dtype=np.float64)[:, None]


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    rate=st.sampled_from([100.0, 333.0, 1000.0, 10_000.0]),
    start=st.floats(-1e3, 1e6),
    dropped=st.sets(st.integers(1, 398), max_size=60),
    jitter=st.floats(0, 0.2),
    seed=st.integers(0, 100),
)
def test_dropped_samples_become_nan_where_they_were(rate, start, dropped, jitter, seed):
    kept = np.array([i for i in range(400) if i not in dropped])
    late = np.random.default_rng(seed).uniform(-jitter, jitter, len(kept))
    timed = on_stamps(column(kept), start + (kept + late) / rate, rate, "a.csv")
    expected = np.full(400, np.nan)
    expected[kept] = kept
    np.testing.assert_array_equal(timed.values[:, 0], expected)
    assert sum(count for count, _ in timed.counts.values()) == len(dropped)
    assert timed.rate == rate
    assert timed.true_rate == pytest.approx(rate, rel=2e-3)  # 400 stamps with 0.2 samples of jitter
    assert timed.start == pytest.approx(start, abs=0.2 / rate)


@pytest.mark.parametrize("rate", [500.0, 2200.0, 10_000.0])
def test_rate_is_found(rate):
    stamps = np.round(7.5 + np.arange(5000) / rate, 6)  # microseconds
    timed = on_stamps(column(range(5000)), stamps, None, "a.csv")
    assert timed.rate == rate and not timed.counts
    assert whole(333.4) == 333.4 and whole(9999.5) == 10_000  # 0.12 %, 0.005 % from a whole number


def test_a_single_late_stamp_is_no_gap():
    stamps = np.arange(100) / 500
    stamps[40] += 0.8 / 500
    timed = on_stamps(column(range(100)), stamps, None, "a.csv")
    np.testing.assert_array_equal(timed.values[:, 0], range(100))


def test_repeated_and_unreadable_stamps_are_dropped_and_counted():
    stamps = np.arange(100) / 500
    stamps[30] = stamps[29]
    stamps[60] = np.nan
    timed = on_stamps(column(range(100)), stamps, 500.0, "a.csv", lambda row: f"line {row + 2}")
    expected = np.arange(100.0)
    expected[[30, 60]] = np.nan  # their places are gaps now
    np.testing.assert_array_equal(timed.values[:, 0], expected)
    assert timed.counts["with a repeated time stamp, dropped"] == (1, "line 32")
    assert timed.counts["without a readable time stamp"] == (1, "line 62")
    assert timed.counts["dropped (gaps in the time stamps), NaN"] == (2, "after line 31")


STAMPS = np.arange(100) / 500


@pytest.mark.parametrize(
    "stamps, rate, message",
    [
        (np.where(np.arange(100) < 50, STAMPS, STAMPS - 0.1), None, "a.csv, 50: time runs backward by 0.098 s at most"),
        (np.floor(STAMPS * 100) / 100, None, "coarser than the samples. Leave `time` out and give `rate`"),
        (STAMPS, 1000.0, r"`rate` = 1000 Hz, but the time stamps are 500 Hz"),
        (STAMPS, 494.0, "Correct `rate` or the unit of `time`"),  # 1.2 % off
        (np.where(STAMPS > 0.1, STAMPS + 0.25, STAMPS), None, "a.csv: 5.% of the samples are missing at 500 Hz"),
        (np.append(STAMPS[:-1], 1e300), None, "a.csv: 100% of the samples are missing"),
        (np.full(100, np.nan), None, "0 time stamps"),
    ],
)
def test_stamps_that_cannot_be_used_are_named(stamps, rate, message):
    with pytest.raises(Unusable if "missing" in message or "0 time" in message else ValueError, match=message):
        on_stamps(column(STAMPS), stamps, rate, "a.csv")


def clock(start, rate, samples, true_rate=None, offset=0.0, name="a.csv"):
    """A channel whose values are the instants at which they were measured, in s on the clock of the stamps."""
    time = (0.0 if start is None else start) + np.arange(samples) / (true_rate or rate)
    return Timed(column(time + offset), start, rate, true_rate or rate, name, offset)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    starts=st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    offsets=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    rates=st.sampled_from([(10_000.0, 500.0), (1000.0, 1000.0), (500.0, 10_000.0), (2200.0, 100.0)]),
)
def test_channels_start_together(starts, offsets, rates):
    force, motion = (clock(s, r, int(12 * r), offset=o) for s, r, o in zip(starts, rates, offsets, strict=True))
    cropped = on_one_clock(force, motion)
    first = [float(channel.values[0, 0]) for channel in cropped]
    assert abs(first[0] - first[1]) <= 0.5 / max(rates) + 1e-9
    later = max(start + offset for start, offset in zip(starts, offsets, strict=True))
    assert later - 1e-9 - 0.01 / min(rates) <= max(first) <= later + 1.5 / min(rates)
    assert [channel.rate for channel in cropped] == list(rates)


def test_clocks_that_run_apart_are_reconciled():
    # 0.04 % in 100 s: 40 ms, 20 samples of the motion
    force, motion = on_one_clock(clock(0.0, 10_000.0, 10**6, 9999.0), clock(0.0, 500.0, 50_000, 500.2))
    assert force.rate == 10_000 and motion.rate == pytest.approx(500.25, abs=1e-3)
    assert len(motion.counts) == 1
    index = 45_000
    same = round(index / motion.rate * force.rate)  # the place in the force of a sample of the motion
    assert force.values[same, 0] == pytest.approx(motion.values[index, 0], abs=1 / 10_000)
    _, motion = on_one_clock(clock(0.0, 10_000.0, 20_000), clock(0.0, 500.0, 1000, 500.001))
    assert motion.rate == 500 and not motion.counts  # less than a sample apart: the rate stays


def test_velocity_of_a_known_movement():
    """A sine of 1 Hz loses (pi f window)^2 / 10 = 0.25 %; 1 % of the peak speed is asked for, ends included."""
    rate, time = 500.0, np.arange(2000) / 500
    position = 20 * np.stack([np.sin(2 * np.pi * time), np.cos(2 * np.pi * time)], axis=-1)
    speed = 20 * 2 * np.pi * np.stack([np.cos(2 * np.pi * time), -np.sin(2 * np.pi * time)], axis=-1)
    position[700:710, 0] = np.nan
    velocity = velocity_from_position(position, rate)
    assert np.isnan(velocity[700:710, 0]).all() and np.isnan(velocity).sum() == 10
    error = np.abs(velocity - speed)
    assert np.nanmax(error[25:-25]) < 0.01 * 40 * np.pi
    assert np.nanmax(error) < 0.03 * 40 * np.pi  # the ends are extrapolated parabolas
