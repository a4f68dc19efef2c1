"""Selection and projection, against slow and obvious references."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tactile_diffusers.data.projection import channels, filtered_with_gaps, sliding_direction
from tactile_diffusers.data.recordings import Recording
from tactile_diffusers.data.segments import SegmentLimits, find_windows
from tactile_diffusers.data.turnarounds import (
    find_turnarounds,
    mask_turnarounds,
)
from tactile_diffusers.signal import BAND_HZ, DEVICE_RATE, SEGMENT_SAMPLES


def slow_bridged(in_limits, longest_gap):
    """Short gaps between good samples are good."""
    n, usable = len(in_limits), list(in_limits)
    for i in range(n):
        if not in_limits[i]:
            left, right = i, i
            while left >= 0 and not in_limits[left]:
                left -= 1
            while right < n and not in_limits[right]:
                right += 1
            usable[i] = left >= 0 and right < n and right - left - 1 <= longest_gap
    return usable


def slow_selection(in_limits, valid, longest_gap, window, step):
    """The rule in words: bridge short gaps between good samples, drop invalid ones, cut what is long enough."""
    n, bridged = len(in_limits), slow_bridged(in_limits, longest_gap)
    usable = [bridged[i] and valid[i] for i in range(n)]
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


def recording_of(force, velocity, velocity_rate=500, lateral=None):
    force, lateral, velocity = (None if x is None else np.float32(x) for x in (force, lateral, velocity))
    return Recording("s", "e", "0", force, lateral, DEVICE_RATE, velocity, velocity_rate, "N")


def windows_of(recording, limits=None):
    data = channels(recording)
    filtered, valid = filtered_with_gaps(data.lateral, recording.rate, BAND_HZ)
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


# The whole selection on random recordings at 100 Hz: 0.1 s are 10 samples, a segment 16, the filter margin 10.
SLOW_RATE, SLOW_BAND, SLOW_LIMITS = 100, (20.0, 40.0), SegmentLimits(seconds=0.16, overlap=0.5)
MARGIN, LONGEST, WINDOW, STEP = 10, 10, 16, 8
#: Force and speed on, inside and outside of the limits; None = not measured.
conditions = st.tuples(
    st.sampled_from([0.4, 0.6, 0.45, 0.55, 0.399, 0.601, None]),
    st.sampled_from([66.0, 99.0, 80.0, 80.0, 65.9, 99.1, None]),
)
stretch = st.tuples(conditions, st.sampled_from([1, 2, 9, 10, 11, 15, 16, 17, 24, 40, 80]), st.booleans())


def random_recording(stretches):
    """Stretches of (normal force, speed), a length and whether the finger slides backwards."""
    rng = np.random.default_rng(0)
    samples = sum(length for _, length, _ in stretches)
    force, velocity, start = 0.02 * rng.standard_normal((samples, 3)), np.zeros((samples, 2)), 0
    for (normal, speed), length, backwards in stretches:
        part = slice(start, start + length)
        sign = -1 if backwards else 1
        velocity[part, 0] = np.nan if speed is None else sign * speed
        force[part, 0] += 0.3 * sign
        if normal is None:
            force[part] = np.nan
        else:  # every second sample is a little nearer to 0.5 N, so that no stretch looks saturated
            force[part, 2] = normal + 1e-4 * np.sign(0.5 - normal) * (np.arange(start, start + length) % 2)
        start += length
    return Recording("s", "e", "0", force, None, SLOW_RATE, velocity, SLOW_RATE, "N")


def slow_mended(values, longest):
    """Straight lines across gaps (rows with NaN) of at most `longest` samples between two others, sample by sample."""
    mended, known = values.astype(float), [i for i in range(len(values)) if not np.isnan(values[i]).any()]
    for left, right in zip(known, known[1:], strict=False):
        for i in range(left + 1, right if right - left - 1 <= longest else 0):
            mended[i] = values[left] + (values[right] - values[left]) * ((i - left) / (right - left))
    return mended


def slow_windows(recording):
    """The rule in words, sample by sample: window starts, and the reason of each sample."""
    n, normal, speed = recording.samples, np.abs(recording.force[:, 2]), np.abs(recording.velocity[:, 0])
    known = [not np.isnan(normal[i] + speed[i]) for i in range(n)]
    force_ok = [bool(0.4 <= value <= 0.6) for value in normal]
    speed_ok = [bool(66 <= value <= 99) for value in speed]
    inside = [a and b for a, b in zip(force_ok, speed_ok, strict=True)]
    gaps = np.isnan(recording.force[:, 0])
    valid = [MARGIN <= i < n - MARGIN and not gaps[max(0, i - MARGIN) : i + MARGIN + 1].any() for i in range(n)]
    starts = slow_selection(inside, [a and b for a, b in zip(valid, known, strict=True)], LONGEST, WINDOW, STEP)
    bridged = slow_bridged(inside, LONGEST)
    usable = [bridged[i] and valid[i] and known[i] for i in range(n)]
    reasons = []
    for i in range(n):
        left, right = i, i
        while left > 0 and usable[i] and usable[left - 1]:
            left -= 1
        while right < n - 1 and usable[i] and usable[right + 1]:
            right += 1
        if not known[i]:
            reasons.append("missing (NaN)")
        elif not valid[i]:
            reasons.append("filter margin")
        elif not usable[i]:
            reasons.append("speed outside limits" if force_ok[i] else "normal_force outside limits")
        else:
            reasons.append("used" if right - left + 1 >= WINDOW else "run shorter than a segment")
    return starts, reasons


@settings(max_examples=200, deadline=None, derandomize=True)
@given(stretches=st.lists(stretch, min_size=1, max_size=12))
def test_windows_of_random_recordings_equal_the_slow_reference(stretches):
    recording = random_recording(stretches)
    assume(recording.samples >= WINDOW and not np.isnan(recording.force).all())  # others are refused when they are read
    data = channels(recording, "keep")
    filtered, valid = filtered_with_gaps(data.lateral, SLOW_RATE, SLOW_BAND)
    windows = find_windows(data, filtered, valid, SLOW_RATE, SLOW_LIMITS)
    # 1 ms of force are less than a sample, 0.05 s of motion five
    recording = replace(recording, force=slow_mended(recording.force, 1), velocity=slow_mended(recording.velocity, 5))
    starts, reasons = slow_windows(recording)
    assert windows.start.tolist() == starts
    counted = {reason: reasons.count(reason) / SLOW_RATE for reason in windows.seconds}
    assert windows.seconds == pytest.approx(counted) and sum(counted.values()) == pytest.approx(
        len(reasons) / SLOW_RATE
    )
    far = np.ones(len(reasons), dtype=bool)
    for middle in data.turnarounds:
        far[max(0, middle - 3) : middle + 3] = False  # 60 ms
    for k, start in enumerate(starts):
        part, inside = slice(start, start + WINDOW), (data.turnarounds >= start) & (data.turnarounds < start + WINDOW)
        assert windows.turnarounds[k] == inside.sum()
        assert windows.speed[k] == pytest.approx(np.mean(data.speed[part]))
        assert windows.level[k] == pytest.approx(0.5 * np.log(np.mean(filtered[part].astype(float) ** 2)))
        kept = np.flatnonzero(far[part]) + start
        if len(kept):
            friction = np.mean(data.lateral[kept]) / np.mean(data.normal[kept])
            assert windows.friction_coefficient[k] == pytest.approx(friction)
            assert windows.level_between_turnarounds[k] == pytest.approx(
                0.5 * np.log(np.mean(filtered[kept].astype(float) ** 2))
            )


def circular_stroke(friction=0.7, normal_force=0.5, speed=80.0, radius=12.0, seconds=4.0):
    heading = speed / radius * np.arange(seconds * DEVICE_RATE) / DEVICE_RATE
    lateral = friction * normal_force
    force = np.stack([lateral * np.cos(heading), lateral * np.sin(heading), np.full_like(heading, normal_force)], -1)
    slow = heading[:: DEVICE_RATE // 500]
    return force, speed * np.stack([np.cos(slow), np.sin(slow)], axis=-1)


@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize("radius", [8.0, 12.0, -12.0, 25.0, 1000.0])  # negative = the other way round
@pytest.mark.parametrize("sign", [1, -1])
def test_circular_stroke_gives_its_friction_coefficient(sign, radius, noise):
    # 1 %: the low-pass on velocity and linear interpolation of the angle leave far less than this. Noise: 10 mN on each
    # axis of the force, as strong as a texture, and 2 mm/s on each of the velocity
    rng = np.random.default_rng(0)
    force, velocity = circular_stroke(radius=radius)
    force[:, :2] *= sign  # either convention: force of the finger, or reaction of the surface
    force += noise * 0.010 * rng.standard_normal(force.shape)
    velocity += noise * 2.0 * rng.standard_normal(velocity.shape)
    recording = recording_of(force, velocity)
    assert channels(recording).flipped == (sign < 0)
    windows = windows_of(recording)
    assert len(windows.start) == 3
    np.testing.assert_allclose(windows.friction_coefficient, 0.7, rtol=0.01)
    np.testing.assert_allclose(windows.speed, 80, rtol=5e-3)
    assert windows.turnarounds.tolist() == [0, 0, 0]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("fixed_axis", [True, False])
def test_lateral_force_opposes_the_motion_whatever_the_source(sign, fixed_axis):
    # a stage goes to and fro under a sensor with a fixed axis, or the source has projected the force already
    time = np.arange(6 * DEVICE_RATE) / DEVICE_RATE
    stroke = np.where(np.sin(np.pi * time) < 0, -1.0, 1.0)
    sawtooth = 0.01 * (time * 40 % 1 - 0.5)  # loads slowly, lets go at once
    opposing = 0.3 + sawtooth
    velocity = 80 * stroke[:: DEVICE_RATE // 500, None] * np.array([np.cos(0.4), np.sin(0.4)])
    recorded = sign * opposing * (stroke if fixed_axis else 1)
    recording = recording_of(None, velocity, lateral=recorded)
    data = channels(recording, "keep")
    apart = np.abs(np.sin(np.pi * time)) > 0.3  # the direction is low-passed around a reversal
    np.testing.assert_allclose(data.lateral[apart], opposing[apart], atol=1e-6)  # float32
    assert data.flipped == (sign < 0 or fixed_axis)


def test_the_sign_of_a_force_without_mean_stays():
    lateral = 0.01 * np.random.default_rng(0).standard_normal(3 * DEVICE_RATE) - 0.001
    data = channels(recording_of(None, None, lateral=lateral), "keep")
    np.testing.assert_allclose(data.lateral, lateral, atol=1e-8)
    assert not data.flipped


def test_direction_is_held_through_standstill():
    speed = np.concatenate([np.full(500, 80.0), np.zeros(500), np.full(500, 80.0)])
    velocity = speed[:, None] * np.array([np.cos(0.4), np.sin(0.4)])
    velocity[500:1000] += 5 * np.random.default_rng(0).standard_normal((500, 2)) * 0.1  # slower than 10 mm/s
    np.testing.assert_allclose(sliding_direction(velocity, 500), 0.4, atol=0.02)


def back_and_forth(reversals, seconds=6.0, noise=0.005, seed=0):
    """Strokes on a line whose velocity passes through zero within 0.1 s: a recording, friction coefficient 0.6.

    The lateral force follows the finger at once, as a contact without shear would.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(int(seconds * 500)) / 500
    along = np.prod([np.clip((at - time) / 0.05, -1, 1) for at in reversals], axis=0)
    device = np.interp(np.arange(int(seconds * DEVICE_RATE)) / DEVICE_RATE, time, along)
    force = np.sign(device)[:, None] * [0.3, 0.0, 0.0] + [0, 0, 0.5]
    return recording_of(force + noise * rng.standard_normal(force.shape), 80 * along[:, None] * [1.0, 0.0])


def test_turnarounds_are_counted_where_they_are():
    recording = back_and_forth([1.2, 2.4], seconds=4.0)
    # direction is held until 10 mm/s in the new one: 6 ms late, and the velocity has 2 ms
    np.testing.assert_allclose(channels(recording).turnarounds / DEVICE_RATE, [1.2, 2.4], atol=0.010)
    windows = windows_of(recording, SegmentLimits(speed=None, normal_force=None))
    # windows of 1.64 s start at 0.1, 0.92 and 1.74 s
    assert windows.turnarounds.tolist() == [1, 2, 1]


def test_a_quick_turn_by_less_than_a_right_angle_is_none():
    time = np.arange(1000) / 500
    for turn, count in ((0.45 * np.pi, 0), (0.55 * np.pi, 1), (np.pi, 1)):
        angle = turn * np.clip((time - 1) / 0.08, 0, 1)
        assert len(find_turnarounds(angle, 500)) == count


@pytest.mark.parametrize("turnarounds", ["keep", "mask"])
def test_what_each_option_leaves_of_a_reversal(turnarounds):
    recording = back_and_forth([3.0])
    data = channels(recording, turnarounds)
    filtered, valid = filtered_with_gaps(data.lateral, DEVICE_RATE, BAND_HZ)
    windows = find_windows(data, filtered, valid, DEVICE_RATE, SegmentLimits())
    steady, swing = 0.005 * np.sqrt(2 * 980 / DEVICE_RATE), np.abs(filtered[29_000:31_000]).max()
    near = (windows.start < 30_000 + 500) & (windows.start + SEGMENT_SAMPLES > 30_000 - 500)
    if turnarounds == "keep":
        assert swing > 0.15 and near.any()  # half of the step of 2 mu Fn
        assert (windows.level - windows.level_between_turnarounds)[near].min() > 1
    else:
        assert swing < 6 * steady
    if turnarounds == "mask":
        # the texture goes on: no silence, no swing. 20 % is three standard deviations of a level over 0.1 s
        assert near.any() and windows.seconds["turnaround"] == 0
        inside = filtered[data.turnarounds[0] - 500 :][:1000]
        assert np.std(inside) == pytest.approx(np.std(filtered[10_000:20_000]), rel=0.2)
        np.testing.assert_allclose(windows.level, np.log(steady), atol=0.1)
    np.testing.assert_allclose(windows.friction_coefficient, 0.6, rtol=0.01)


def test_mask_joins_what_it_replaces_without_a_step():
    wave = 0.3 + 0.01 * np.sin(2 * np.pi * 47 * np.arange(20_000) / DEVICE_RATE)
    replaced = np.zeros(20_000, dtype=bool)
    replaced[9_300:10_300] = True
    masked = mask_turnarounds(wave + replaced * 0.5, replaced, DEVICE_RATE)
    # a fade over 0.1 s adds little to the slope of the sine: no step anywhere, its ends included
    assert np.abs(np.diff(masked)).max() < 1.5 * np.abs(np.diff(wave)).max()
    np.testing.assert_array_equal(masked[~replaced], wave[~replaced])


def test_scribbling_is_no_texture():
    # reversals every 80 ms: between them there is nothing to go on from
    recording = back_and_forth([3.0, 3.08, 3.16, 3.24])
    data = channels(recording, "mask")
    assert data.excluded[30_500:31_500].all() and not data.excluded[:29_000].any() and not data.excluded[33_500:].any()


def test_a_step_at_a_gap_leaves_little_in_segments():
    # 0.5 N, twice the friction force of a finger, at a gap of any length: less than 1 mN at the edge of what is valid
    # (0.2 %; the margin of two periods of 20 Hz lets the ring fall so far), and 0.1 mN RMS over a segment of 9 mN
    for gap in (1, 100, 1000):
        lateral = np.where(np.arange(60_000) < 30_000, 0.0, 0.5)
        lateral[30_000 - gap : 30_000] = np.nan
        filtered, valid = filtered_with_gaps(lateral, DEVICE_RATE, BAND_HZ)
        assert np.abs(filtered).max() > 0.005 and np.abs(filtered[valid]).max() < 1e-3
        first = np.flatnonzero(valid[30_000:])[0] + 30_000
        assert np.sqrt(np.mean(filtered[first : first + SEGMENT_SAMPLES] ** 2)) < 1e-4
        assert np.abs(filtered[valid][:1000]).max() < 1e-6  # and nothing at the ends of the recording


def test_short_gaps_are_bridged_and_longer_ones_name_what_they_cost():
    rng = np.random.default_rng(0)
    whole = np.tile([0.3, 0.0, 0.5], (100_000, 1)) + 0.01 * rng.standard_normal((100_000, 3))
    velocity = np.tile([80.0, 0.0], (5000, 1))
    for longest, lost in ((10, 0), (11, 9.0)):  # 1 ms, every second
        force, holes = whole.copy(), velocity.copy()
        for second in range(1, 10):
            force[10_000 * second : 10_000 * second + longest, 1] = np.nan
            holes[500 * second + 100 : 500 * second + 125] = np.nan  # 0.05 s
        recording = recording_of(force, holes)
        windows = windows_of(recording)
        assert channels(recording).bridged == (0 if lost else 90, 225)
        assert len(windows.start) == (0 if lost else len(windows_of(recording_of(whole, velocity)).start))
        assert windows.lost.get("missing samples", 0) == pytest.approx(lost, abs=0.3)
    assert windows_of(recording_of(whole, velocity)).lost == {"ends of recordings": pytest.approx(0.2)}


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


@pytest.mark.parametrize("name", ["normal_force", "speed", "longest_excursion", "seconds", "overlap"])
def test_impossible_limits_are_refused_by_name(name):
    ranges = [(1, 1), (2, 1), (-1, 1), (np.nan, 1), (0, np.nan), (1,), (0, 1, 2), 5, "ab"]
    bad = {
        "normal_force": ranges,
        "speed": ranges,
        "longest_excursion": [-0.1, np.nan, np.inf, "x", None],
        "seconds": [0, -1, 1e-5, np.nan, np.inf, "x", None],
        "overlap": [-0.1, 1, 2, np.nan, "x", None],
    }
    for value in bad[name]:
        with pytest.raises(ValueError, match=f"`{name}`"):
            SegmentLimits(**{name: value})


def test_limits_of_numpy_are_plain_numbers():
    """They are stored in the prepared file as JSON, at the end of a long preparation."""
    ours = SegmentLimits(np.array([0.4, 0.6]), (np.int64(66), 99), np.float32(0.25), np.float64(1.5), 0)
    assert json.dumps(asdict(ours)) == json.dumps(asdict(SegmentLimits((0.4, 0.6), (66.0, 99.0), 0.25, 1.5, 0.0)))


def test_without_a_normal_force_in_newtons_limits_are_skipped():
    rng = np.random.default_rng(0)
    lateral = np.float32(rng.standard_normal(60_000))
    counts = recording_of(rng.standard_normal((40_000, 3)) + [300.0, 0.0, 500.0], np.tile([80.0, 0.0], (2000, 1)))
    counts.unit = "1"
    only = Recording("s", "e", "0", None, lateral, DEVICE_RATE, None, None, "1")
    for recording, skipped in ((counts, ("normal_force",)), (only, ("normal_force", "speed"))):
        windows = windows_of(recording)
        assert windows.skipped == skipped and len(windows.start) and np.isnan(windows.friction_coefficient).all()


def test_unusable_recordings_are_refused():
    steady = np.tile([80.0, 0.0], (2000, 1))
    alone = Recording("s", "e", "0", np.ones((60_000, 3)), None, DEVICE_RATE, None, None, "N")
    with pytest.raises(ValueError, match="s/e/0 has 3-D `force` but no `velocity`.*Store `velocity`"):
        channels(alone)
    with pytest.raises(ValueError, match="the sensor was dead"):
        channels(recording_of(np.zeros((40_000, 3)), steady))
    with pytest.raises(ValueError, match="`turnarounds` must be one of"):
        channels(back_and_forth([3.0]), "drop")
