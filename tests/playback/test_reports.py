"""Reports on another clock, in another unit, of another shape or at another rate."""

import warnings

import numpy as np
import pytest

from tactile_diffusers.playback import FingerPath

RATE, SENSOR = 10_000, 125.0


@pytest.fixture
def path():
    return FingerPath(RATE, SENSOR)


@pytest.mark.parametrize("origin", [1.7e9, 5.0, -5.0])
def test_stamps_of_another_clock_are_refused_and_can_be_converted(path, origin):
    path.advance(800)
    with pytest.raises(ValueError, match=r"(?s)first `time`.*within 1 s of 0\.080 s.*stamp - stream\.time"):
        path.report(origin, 0.0)
    began, converted = path.time, origin - path.time
    for number in range(125):
        path.report(origin + number / SENSOR - converted, 80 * number / SENSOR)
        place, velocity = path.advance(80)
    assert place[-1, 0] == pytest.approx(80 * (path.time - began), abs=0.1)
    assert velocity[-1, 0] == pytest.approx(80, abs=0.1)


def test_milliseconds_are_refused(path):
    path.report(0.0, 0.0)
    path.advance(80)
    before = path.time, path._times.tolist(), path._places.tolist()
    with pytest.raises(ValueError, match=r"at most 1 s ahead of `stream.time`.*got 8\. .*milliseconds by 1000"):
        path.report(8.0, 0.5)
    assert (path.time, path._times.tolist(), path._places.tolist()) == before


@pytest.mark.parametrize("pause", [0.5, 60.0])
def test_a_pause_of_the_finger_is_no_other_clock(path, pause):
    """Blocks are read on; so it is when reports come again on the clock that went on with them."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        path.report([0.0, 0.008], [0.0, 0.5])
        path.advance(round(pause * RATE))
        path.report(path.time, 40.0)
        path.advance(80)
        path.report(path.time, 40.5)


def test_a_recording_may_be_reported_before_it_is_read(path):
    times = np.arange(0, 5, 1 / SENSOR)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        path.report(times, 40 * times)
    with pytest.warns(UserWarning, match="another moment") as caught:  # as of a clock that runs ahead
        for number in range(1, 50):
            path.report(times[-1] + number / SENSOR, 200.0)
    assert len(caught) == 1


def test_late_reports_are_taken(path):
    """A driver may deliver late what it stamped in time; the finger rests until then."""
    path.report(0.0, 0.0)
    path.advance(15_000)
    with pytest.warns(UserWarning, match="reported for 0.01 s while the stream is at 1.50 s"):
        path.report(0.008, 1.0)
    path.report(1.5, 2.0)
    path.report([], [])  # nothing is no report


@pytest.mark.parametrize("observed", [20.0, 1000.0])
def test_another_rate_is_warned_of_once(observed):
    path = FingerPath(RATE, SENSOR)
    with pytest.warns(UserWarning, match=f"is 125 Hz, but reports come at about {observed:.0f} Hz") as seen:
        for number in range(round(3 * observed)):
            path.report(number / observed, 1.0 * number)
            path.advance(round(RATE / observed))
    assert len(seen) == 1


@pytest.mark.parametrize(
    ("dimensions", "time", "position", "message"),
    [
        (1, [0.1, 0.2], [1.0], "equal number"),
        (1, [0.2, 0.1], [1.0, 1.0], "ascend"),
        (1, 0.1, (1.0, 2.0), r"for x and y make it with `dimensions=2`. Got \(1,\) and \(2,\)"),
        (1, [0.1, 0.2], np.ones((2, 2)), "make it with `dimensions=2`"),
        (2, 0.1, 1.0, r"\(n, 2\), x and y in mm; for a line leave `dimensions=2` out. Got \(1,\) and \(\)"),
        (2, [0.1, 0.2], [1.0, 2.0, 3.0, 4.0], "x and y in mm"),
    ],
)
def test_bad_reports_are_refused(dimensions, time, position, message):
    with pytest.raises(ValueError, match=message):
        FingerPath(RATE, SENSOR, dimensions=dimensions).report(time, position)
