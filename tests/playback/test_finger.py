"""The finger's path from slow, coarse reports."""

import numpy as np
import pytest
from scipy import signal

from tactile_diffusers.playback import FingerPath, TextureProfile

RATE = 10_000


def _follow(motion, seconds=3.0, sensor_rate=125.0, resolution=0.1, block=32, **options):
    """Positions and velocities (n,) that a path makes of a motion, reported as a real sensor does."""
    path = FingerPath(RATE, sensor_rate, **options)
    number, made = 0, []
    for _ in range(round(seconds * RATE / block)):
        while number / sensor_rate <= path.time:
            place = motion(number / sensor_rate)
            path.report(number / sensor_rate, np.round(place / resolution) * resolution if resolution else place)
            number += 1
        made.append(np.stack([axis[:, 0] for axis in path.advance(block)]))
    return np.concatenate(made, axis=1)


def _times(made):
    return np.arange(made.shape[1]) / RATE


@pytest.mark.parametrize("speed", [-150.0, 30.0, 80.0])
def test_a_steady_finger_is_followed_without_delay(speed):
    made = _follow(lambda t: speed * t, resolution=0)
    settled = _times(made) > 0.5
    np.testing.assert_allclose(made[0][settled], speed * _times(made)[settled], atol=1e-3)  # mm; the filter's ring
    np.testing.assert_allclose(made[1][settled], speed, rtol=1e-4)


@pytest.mark.parametrize("sensor_rate", [60.0, 125.0, 1000.0])
def test_a_change_of_speed_is_felt_within_the_latency(sensor_rate):
    made = _follow(lambda t: 80 * max(t - 1.0, 0.0), seconds=2, sensor_rate=sensor_rate, resolution=0)
    latency = FingerPath(RATE, sensor_rate).latency
    assert _times(made)[np.argmax(made[1] > 40)] - 1.0 < latency
    assert np.abs(made[1][: RATE - 50]).max() < 1e-6 and 0.05 < latency < 0.1


@pytest.mark.parametrize(
    "motion", [lambda t: 80 * t, lambda t: 30 * t, lambda t: 40 * np.sin(np.pi * t)], ids=["80", "30", "stroke"]
)
def test_coarse_reports_add_20_db_less_than_the_texture(pink_noise, motion):
    made = _follow(motion, seconds=5)
    # no hand moves faster than 15 Hz: what the path has beyond is the sensor's
    sections = signal.butter(4, 15, fs=RATE, output="sos")
    smooth = signal.sosfiltfilt(sections, made[0])
    profile = TextureProfile(pink_noise(16_384, RATE, exponent=0.8)[0], RATE, 80.0)
    kept = slice(8000, -8000)
    felt, wanted = (profile.read(x[kept], np.gradient(x[kept]) * RATE) for x in (made[0], smooth))
    assert 10 * np.log10(np.mean((felt - wanted) ** 2) / np.mean(wanted**2)) < -20


def test_a_finger_that_is_no_longer_reported_comes_to_rest():
    path = FingerPath(RATE, 125)
    path.report(np.arange(50) / 125, 80 * np.arange(50) / 125)
    path.advance(5000)
    place, velocity = path.advance(10_000)
    assert np.abs(velocity[-2000:]).max() < 1e-3 and place[-1] == pytest.approx(80 * 49 / 125, abs=1e-3)


def test_a_first_report_far_away_is_no_jump():
    path = FingerPath(RATE, 125)
    path.advance(64)
    path.report(path.time, 300.0)
    place, velocity = path.advance(32)
    np.testing.assert_allclose(place, 300.0, atol=1e-6)
    assert np.abs(velocity).max() < 0.1  # rounding of 300 mm over 0.1 ms, led ahead


def test_memory_is_bounded():
    path = FingerPath(RATE, 1000)
    for number in range(500):
        path.report(path.time, float(number))
        path.advance(10)
    assert len(path._times) < 100  # those of the last `latency`


@pytest.mark.parametrize(
    ("name", "value"),
    [("sampling_rate", 0), ("sensor_rate", -1), ("cutoff", 62.5), ("cutoff", np.nan), ("dimensions", 3)],
)
def test_bad_settings_are_refused(name, value):
    with pytest.raises(ValueError, match=f"`{name}`"):
        FingerPath(**{"sampling_rate": RATE, "sensor_rate": 125.0, name: value})


class TestLiftedFinger:
    def test_a_jump_is_another_contact_and_no_fast_slide(self):
        path = FingerPath(RATE, 125.0)
        times = np.arange(0, 2, 1 / 125)
        path.report(times, np.where(times < 1, 40 * times, 1000 + 40 * times))
        place, velocity = path.advance(2 * RATE)
        assert np.abs(velocity).max() < 80  # of 40, and the lead's swing at the start; a slide over a metre has 10,000
        assert len(path.breaks) == 1
        landed = path.breaks[0]
        assert place[landed - 1, 0] < 45 and place[landed, 0] == pytest.approx(1040, abs=0.5)
        assert abs(velocity[landed, 0]) < 0.01  # rounding of the filter
        assert place[-1, 0] == pytest.approx(1000 + 40 * (2 - path.latency) + 40 * path.latency, abs=0.5)

    def test_a_pause_ends_where_the_finger_is_seen_next(self):
        path = FingerPath(RATE, 125.0)
        path.report([0.0, 0.008, 0.5, 0.508], [0.0, 0.0, 20.0, 20.0])
        place, velocity = path.advance(RATE)
        assert set(np.abs(np.round(place[:, 0], 6))) == {0.0, 20.0}
        assert np.abs(velocity).max() < 1e-6  # rounding of the filter


#: Speed in mm/s over time in s, with a beginning and an end at rest.
_STOPS = {
    "abrupt": lambda t: 80.0 * ((t > 0.3) & (t < 1)),
    "braking": lambda t: 80.0 * np.clip((t - 0.3) / 0.1, 0, 1) * np.clip((1.1 - t) / 0.1, 0, 1),
    "reach": lambda t: 3750 * (u := np.clip((t - 0.3) / 0.8, 0, 1)) ** 2 * (1 - u) ** 2,  # 100 mm, minimum jerk
}


def _moved(speed, drop=(), **options):
    """True speed and the path's velocity, (n,) each, of a finger of this speed; reports of these numbers are lost."""
    fine = np.arange(0, 3, 1 / RATE)
    true = speed(fine)
    travelled = np.concatenate([[0], np.cumsum(true)[:-1]]) / RATE
    path, made, number = FingerPath(RATE, 125.0, **options), [], 0
    for _ in range(len(fine) // 32):
        while number / 125 <= path.time:
            if number not in drop:
                path.report(number / 125, np.interp(number / 125, fine, travelled))
            number += 1
        made.append(path.advance(32)[1][:, 0])
    made = np.concatenate(made)
    return true[: len(made)], made


class TestVelocityStaysWithinWhatWasReported:
    @pytest.mark.parametrize("cutoff", [8.0, 16.0])
    @pytest.mark.parametrize("stop", list(_STOPS))
    def test_a_finger_that_stops_is_not_pushed_on(self, stop, cutoff):
        true, made = _moved(_STOPS[stop], cutoff=cutoff)
        # friction of 0.6 N turns with the direction: 0.02 N forwards are a velocity of -0.1 mm/s
        assert made.min() > -0.1
        assert made.max() < 1.1 * true.max()
        still = np.flatnonzero(true > 0.1)[-1]
        assert np.abs(made[still + 1000 :]).max() < 0.1  # 0.1 s later it is at rest, and stays there

    def test_a_finger_that_slows_down_is_not_stopped(self):
        true, made = _moved(lambda t: np.where(t < 1, 160.0, 40.0) * (t > 0.2))
        assert 39 < made[8000:].min() and made.max() < 161

    @pytest.mark.parametrize("lost", [5, 8, 10])
    def test_lost_reports_neither_turn_nor_drive_the_finger(self, lost):
        _, made = _moved(lambda t: np.full_like(t, 80.0), drop=range(125, 125 + lost))
        assert -1e-9 < made[5000:].min() and made[5000:].max() < 1.15 * 80

    @pytest.mark.parametrize("shift", [0.0, 0.002, 0.004, 0.006])
    def test_a_reversal_is_felt_within_20_ms(self, shift):
        true, made = _moved(lambda t: -40 * np.pi * np.sin(np.pi * (t + shift)))
        for turn in (10_000, 20_000):
            turn -= round(shift * RATE)
            after = made[turn : turn + 500] * np.sign(true[turn + 50])
            assert np.argmax(after > 0.1) < 200 and after.min() > -5

    @pytest.mark.parametrize(("noise", "most"), [(0.02, 1e-9), (0.05, 0.2)])
    def test_a_sensor_that_trembles_does_not_turn_friction(self, noise, most):
        rng, times = np.random.default_rng(0), np.arange(375) / 125
        path = FingerPath(RATE, 125.0)
        path.report(times, np.round((10 + noise * rng.standard_normal(375)) / 0.05) * 0.05)
        assert np.sqrt(np.mean(path.advance(29_000)[1][3000:] ** 2)) <= most  # mm/s; friction turns through 5

    @pytest.mark.parametrize("degrees", [0, 30, 45, 75])
    def test_a_corner_on_a_plane_is_alike_in_all_directions(self, degrees):
        angle, times = np.radians(degrees), np.arange(375) / 125
        heading = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        path = FingerPath(RATE, 125.0, dimensions=2)
        path.report(times, np.stack([80 * np.minimum(times, 1), 80 * np.clip(times - 1, 0, 1)], axis=1) @ heading)
        velocity = path.advance(29_000)[1]
        assert (velocity @ heading.T).min() > -0.1 and np.linalg.norm(velocity, axis=1).max() < 1.01 * 80

    @pytest.mark.parametrize("late", [0.02, 0.05, 0.15])
    def test_reports_that_come_late_are_followed_late(self, late):
        path, made, number = FingerPath(RATE, 125.0), [], 0
        while path.time < 2:
            while number / 125 + late <= path.time:
                path.report(number / 125, 80 * number / 125)
                number += 1
            made.append(path.advance(32)[1][:, 0])
        made = np.concatenate(made)[6000:]
        assert 70 < made.min() and made.max() < 90
