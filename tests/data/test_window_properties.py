"""Windows of random traces under random limits, held against a search that knows nothing of runs and masks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_diffusers.data.segments import Channels, SegmentLimits, find_windows

RATE = 100
LEVELS = [0.0, 0.3, 0.4, 0.5, 0.6, 0.7, np.nan]
trace = st.lists(st.tuples(st.sampled_from(LEVELS), st.integers(1, 25)), min_size=1, max_size=12)


def _drawn(stretches, samples):
    values = np.concatenate([np.full(length, level) for level, length in stretches])
    return np.resize(values, samples)


@st.composite
def limits(draw):
    def span():
        low = draw(st.sampled_from([0.0, 0.3, 0.4, 0.45]))
        return draw(st.sampled_from([None, (low, low + 0.1), (low, 0.6)]))

    return SegmentLimits(
        normal_force=span(),
        speed=span(),
        longest_excursion=draw(st.sampled_from([0.0, 0.01, 0.05, 0.1, 10.0])),
        seconds=draw(st.sampled_from([0.01, 0.04, 0.1, 0.33])),
        overlap=draw(st.sampled_from([0.0, 0.5, 0.5, 0.9, 0.99])),
    )


@st.composite
def recordings(draw):
    samples = draw(st.integers(1, 120))
    normal, speed = (_drawn(draw(trace), samples) if draw(st.integers(0, 4)) else None for _ in range(2))
    marks = st.lists(st.integers(0, samples - 1), max_size=4)
    valid, excluded = np.ones(samples, bool), np.zeros(samples, bool)
    valid[draw(marks)], excluded[draw(marks)] = False, True
    lateral = 0.3 + 0.01 * np.random.default_rng(samples).standard_normal(samples)
    lateral[draw(marks)] = np.nan
    turns = np.array(sorted(set(draw(marks))), dtype=np.int64)
    return Channels(lateral, normal, speed, turns, np.zeros(samples, bool), excluded), valid


def _inside(values, span, i):
    return span is None or values is None or span[0] <= values[i] <= span[1]


def _excused(within, longest):
    """Samples outside of the limits between two inside of them that are at most `longest` apart, one by one."""
    excused, n = list(within), len(within)
    for i in range(n):
        before = max((j for j in range(i) if within[j]), default=None)
        after = min((j for j in range(i + 1, n) if within[j]), default=None)
        if not within[i] and before is not None and after is not None and after - before - 1 <= longest:
            excused[i] = True
    return excused


@settings.get_profile("many")
@given(recording=recordings(), limits=limits())
def test_windows_obey_every_limit_and_none_is_missed(recording, limits):
    data, valid = recording
    n = len(valid)
    found = find_windows(data, np.nan_to_num(data.lateral).astype(np.float32), valid, RATE, limits)
    within = [
        bool(_inside(data.normal, limits.normal_force, i) and _inside(data.speed, limits.speed, i)) for i in range(n)
    ]
    longest = round(limits.longest_excursion * RATE)
    known = [
        not any(v is not None and np.isnan(v[i]) for v in (data.lateral, data.normal, data.speed)) for i in range(n)
    ]
    excused = _excused(within, longest)
    allowed = [excused[i] and known[i] and valid[i] and not data.excluded[i] for i in range(n)]
    window = round(limits.seconds * RATE)
    step = max(1, round(window * (1 - limits.overlap)))

    for start in found.start:
        part = slice(start, start + window)
        assert 0 <= start and start + window <= n and all(allowed[part])
        outside = [i for i in range(start, start + window) if not within[i]]
        assert all(any(within[max(0, i - longest) : i + longest + 1]) for i in outside)
    # greedily from the left: the next window lies a step after the last of its run, or where a run begins
    wanted, next_start = [], 0
    for start in range(n - window + 1):
        if start and not allowed[start - 1]:
            next_start = start
        if all(allowed[start : start + window]) and start >= next_start and (start - next_start) % step == 0:
            wanted.append(start)
    assert found.start.tolist() == wanted
    # none is missed: wherever a window would fit, one lies less than a step before it
    for start in range(n - window + 1):
        if all(allowed[start : start + window]):
            assert any(0 <= start - other < step for other in wanted)
    assert sum(found.seconds.values()) == pytest.approx(n / RATE)
    assert found.skipped == tuple(
        name
        for name, values in (("normal_force", data.normal), ("speed", data.speed))
        if values is None and getattr(limits, name) is not None
    )


@settings.get_profile("many")
@given(recording=recordings(), limits=limits())
def test_what_is_said_of_windows_is_what_is_in_them(recording, limits):
    data, valid = recording
    filtered = np.nan_to_num(
        data.lateral - np.nanmean(data.lateral) if (~np.isnan(data.lateral)).any() else data.lateral
    )
    found = find_windows(data, filtered.astype(np.float32), valid, RATE, limits)
    window = round(limits.seconds * RATE)
    for k, start in enumerate(found.start):
        inside = range(start, start + window)
        assert found.turnarounds[k] == sum(turn in inside for turn in data.turnarounds)
        far = [i for i in inside if all(not turn - 3 <= i < turn + 3 for turn in data.turnarounds)]  # 60 ms
        if data.normal is not None and far and sum(data.normal[i] for i in far):
            friction = sum(data.lateral[i] for i in far) / sum(data.normal[i] for i in far)
            assert found.friction_coefficient[k] == pytest.approx(friction)
        if data.speed is not None:
            assert found.speed[k] == pytest.approx(np.mean([data.speed[i] for i in inside]), abs=1e-12)
        power = np.mean([float(filtered[i]) ** 2 for i in inside])
        assert np.exp(2 * found.level[k]) == pytest.approx(power, rel=1e-4, abs=1e-12)
    assert found.start.dtype == np.int64 and np.isfinite(found.level).all() and np.isfinite(found.level_apart).all()


@pytest.mark.parametrize("seconds", [0.02, 0.33, 1.6384])
@pytest.mark.parametrize("rate", [100, 999, 10_000])
def test_neighbours_overlap_by_half(seconds, rate):
    limits = SegmentLimits(None, None, seconds=seconds)
    window = limits.samples(rate)
    data = Channels(np.ones(9 * window), None, None, np.empty(0, np.int64), *np.zeros((2, 9 * window), bool))
    found = find_windows(data, np.ones(9 * window, np.float32), np.ones(9 * window, bool), rate, limits)
    assert abs(2 * (found.start[1] - found.start[0]) - window) <= 1 and (np.diff(found.start, 2) == 0).all()
    assert found.start[0] == 0 and 9 * window - (found.start[-1] + window) < found.start[1]


@pytest.mark.parametrize("name", ["normal_force", "speed", "longest_excursion", "seconds", "overlap"])
def test_impossible_limits_are_refused_by_name(name):
    bad = {
        "normal_force": [(1, 1), (2, 1), (-1, 1), (np.nan, 1), (0, np.nan), (1,), (0, 1, 2), 5, "ab"],
        "longest_excursion": [-0.1, np.nan, np.inf, "x", None],
        "seconds": [0, -1, np.nan, np.inf, "x", None],
        "overlap": [-0.1, 1, 2, np.nan, "x", None],
    }
    bad["speed"] = bad["normal_force"]
    for value in bad[name]:
        with pytest.raises((ValueError, TypeError), match=f"`{name}`"):
            SegmentLimits(**{name: value})
