"""Selection and projection, against slow and obvious references."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_diffusers.data.recordings import Recording
from tactile_diffusers.data.segments import (
    SegmentLimits,
    bridge_gaps,
    channels,
    filtered_with_gaps,
    find_windows,
    select_windows,
    sliding_direction,
)
from tactile_diffusers.signal import BAND_HZ, DEVICE_RATE, SEGMENT_SAMPLES


def slow_selection(in_limits, valid, longest_gap, window, step):
    """The rule in words: bridge short gaps between good samples, drop invalid ones, cut what is long enough."""
    n, usable = len(in_limits), list(in_limits)
    for i in range(n):
        if not in_limits[i]:
            left, right = i, i
            while left >= 0 and not in_limits[left]:
                left -= 1
            while right < n and not in_limits[right]:
                right += 1
            usable[i] = left >= 0 and right < n and right - left - 1 <= longest_gap
    usable = [usable[i] and valid[i] for i in range(n)]
    starts, run_start = [], None
    for i in range(n + 1):
        if i < n and usable[i]:
            run_start = i if run_start is None else run_start
        elif run_start is not None:
            start = run_start
            while start + window <= i:
                starts.append(start)
                start += step
            run_start = None
    return starts


runs = st.lists(st.tuples(st.booleans(), st.integers(1, 12)), min_size=1, max_size=14)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(runs=runs, invalid=st.sets(st.integers(0, 100), max_size=3), gap=st.integers(0, 6), window=st.integers(1, 15))
def test_selection_equals_the_slow_reference(runs, invalid, gap, window):
    in_limits = np.concatenate([np.full(length, value) for value, length in runs])
    valid = np.array([i not in invalid for i in range(len(in_limits))])
    for step in (1, max(1, window // 2)):
        starts, used = select_windows(bridge_gaps(in_limits, gap) & valid, window, step)
        assert starts.tolist() == slow_selection(in_limits, valid, gap, window, step)
        assert all(used[start : start + window].all() for start in starts)


def mask_of(*pieces):
    return np.concatenate([np.full(length, value) for value, length in pieces])


@pytest.mark.parametrize("gap, bridged", [(999, True), (1000, True), (1001, False)])
def test_excursion_of_exactly_a_tenth_of_a_second_is_bridged(gap, bridged):
    mask = mask_of((True, 10_000), (False, gap), (True, 10_000))
    longest = round(SegmentLimits().longest_excursion * DEVICE_RATE)
    starts, _ = select_windows(bridge_gaps(mask, longest), SEGMENT_SAMPLES, SEGMENT_SAMPLES // 2)
    assert starts.tolist() == ([0] if bridged else [])


@pytest.mark.parametrize("length, count", [(SEGMENT_SAMPLES - 1, 0), (SEGMENT_SAMPLES, 1), (SEGMENT_SAMPLES + 1, 1)])
def test_run_of_exactly_one_segment(length, count):
    mask = mask_of((False, 5000), (True, length), (False, 5000))
    starts, _ = select_windows(mask, SEGMENT_SAMPLES, SEGMENT_SAMPLES // 2)
    assert starts.tolist() == [5000] * count


def test_gaps_at_the_ends_stay():
    mask = mask_of((False, 3), (True, 5), (False, 3))
    np.testing.assert_array_equal(bridge_gaps(mask, 10), mask)


def test_windows_overlap_by_half():
    starts, _ = select_windows(np.ones(3 * SEGMENT_SAMPLES, dtype=bool), SEGMENT_SAMPLES, SegmentLimits().step(10_000))
    assert starts.tolist() == [i * SEGMENT_SAMPLES // 2 for i in range(5)]


def recording_of(force, velocity, velocity_rate=500):
    force = np.float32(force)
    return Recording("s", "e", "0", force, None, DEVICE_RATE, np.float32(velocity), velocity_rate, "N")


def windows_of(recording, limits=None):
    data = channels(recording)
    filtered, valid = filtered_with_gaps(data.lateral, recording.rate, BAND_HZ, 4, 2)
    return find_windows(data, filtered, valid, recording.rate, limits or SegmentLimits())


@pytest.mark.parametrize(
    "normal_force, speed, selected",
    [(0.4, 66, True), (0.6, 99, True), (0.4, 99, True), (0.399, 80, False), (0.601, 80, False), (0.5, 65.9, False)],
)
def test_limits_are_inclusive(normal_force, speed, selected):
    force = np.tile([0.3, 0.0, normal_force], (40_000, 1))
    windows = windows_of(recording_of(force, np.tile([speed, 0.0], (2000, 1))))
    assert (len(windows.start) > 0) == selected
    assert sum(windows.seconds.values()) == pytest.approx(4.0)  # every sample has one reason


def circular_stroke(friction=0.7, normal_force=0.5, speed=80.0, radius=12.0, seconds=4.0):
    heading = speed / radius * np.arange(seconds * DEVICE_RATE) / DEVICE_RATE
    lateral = friction * normal_force
    force = np.stack([lateral * np.cos(heading), lateral * np.sin(heading), np.full_like(heading, normal_force)], -1)
    slow = heading[:: DEVICE_RATE // 500]
    return force, speed * np.stack([np.cos(slow), np.sin(slow)], axis=-1)


@pytest.mark.parametrize("sign", [1, -1])
def test_circular_stroke_gives_its_friction_coefficient(sign):
    # 1 %: the low-pass on velocity and linear interpolation of the angle leave far less than this
    force, velocity = circular_stroke()
    force[:, :2] *= sign  # either convention: force of the finger, or reaction of the surface
    recording = recording_of(force, velocity)
    assert channels(recording).flipped == (sign < 0)
    windows = windows_of(recording)
    assert len(windows.start) == 3
    np.testing.assert_allclose(windows.friction_coefficient, 0.7, rtol=0.01)
    np.testing.assert_allclose(windows.speed, 80, rtol=1e-3)
    assert windows.turnarounds.tolist() == [0, 0, 0]


def test_direction_is_held_through_standstill():
    speed = np.concatenate([np.full(500, 80.0), np.zeros(500), np.full(500, 80.0)])
    velocity = speed[:, None] * np.array([np.cos(0.4), np.sin(0.4)])
    velocity[500:1000] += 5 * np.random.default_rng(0).standard_normal((500, 2)) * 0.1  # slower than 10 mm/s
    np.testing.assert_allclose(sliding_direction(velocity, 500), 0.4, atol=0.02)


def test_turnarounds_are_counted():
    velocity = np.tile([80.0, 0.0], (2000, 1))
    velocity[600:1200] *= -1
    force = np.repeat(np.sign(velocity[:, :1]), 20, axis=0) * [0.3, 0.0, 0.0] + [0, 0, 0.5]
    windows = windows_of(recording_of(force, velocity), SegmentLimits(speed=None, normal_force=None))
    # reversals at 1.2 and 2.4 s; windows of 1.64 s start at 0.1, 0.92 and 1.74 s
    assert windows.turnarounds.tolist() == [1, 2, 1]


def test_stretch_of_nan_is_excluded_with_a_margin():
    rng = np.random.default_rng(0)
    force = np.tile([0.3, 0.0, 0.5], (60_000, 1)) + 0.01 * rng.standard_normal((60_000, 3))
    force[30_000:30_500] = np.nan
    windows = windows_of(recording_of(force, np.tile([80.0, 0.0], (3000, 1))))
    margin = 2 * DEVICE_RATE / BAND_HZ[0]
    assert windows.seconds["missing (NaN)"] == pytest.approx(0.05)
    assert len(windows.start) == 4
    for start in windows.start:
        assert start + SEGMENT_SAMPLES <= 30_000 - margin or start >= 30_500 + margin
    assert np.isfinite(windows.level).all() and np.isfinite(windows.friction_coefficient).all()


def test_velocity_that_ends_early_is_missing_data():
    recording = recording_of(np.tile([0.3, 0.0, 0.5], (60_000, 1)), np.tile([80.0, 0.0], (2000, 1)))
    windows = windows_of(recording)
    assert windows.seconds["missing (NaN)"] == pytest.approx(2.0)
    assert (windows.start + SEGMENT_SAMPLES <= 40_000).all() and len(windows.start)


def test_lateral_only_source_skips_limits():
    lateral = np.float32(np.random.default_rng(0).standard_normal(60_000))
    windows = windows_of(Recording("s", "e", "0", None, lateral, DEVICE_RATE, None, None, "1"))
    assert windows.skipped == ("normal_force", "speed")
    assert len(windows.start) and np.isnan(windows.friction_coefficient).all() and np.isnan(windows.speed).all()


def test_force_without_velocity_is_an_error():
    recording = Recording("s", "e", "0", np.zeros((60_000, 3)), None, DEVICE_RATE, None, None, "N")
    with pytest.raises(ValueError, match="s/e/0 has 3-D `force` but no `velocity`.*Store `velocity`"):
        channels(recording)


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"normal_force": (0.6, 0.4)}, "`normal_force`"),
        ({"speed": (-1, 4)}, "`speed`"),
        ({"overlap": 1.0}, "`overlap`"),
        ({"seconds": 0}, "`seconds`"),
        ({"longest_excursion": -0.1}, "`longest_excursion`"),
    ],
)
def test_limits_refuse(arguments, message):
    with pytest.raises(ValueError, match=message):
        SegmentLimits(**arguments)
