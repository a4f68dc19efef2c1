"""Force that follows the finger."""

import numpy as np
import pytest

from tactile_diffusers.playback import TextureProfile, TextureStream, force_laws
from tactile_diffusers.signal import band_levels_db
from tactile_diffusers.virtual import laws, recipe

RATE, SENSOR = 10_000, 125.0


def _play(stream, motion, seconds=2.0, block=32, between=None, **options):
    made, number = [], 0
    for _ in range(round(seconds * RATE / block)):
        while number / SENSOR <= stream.time:
            stream.report(number / SENSOR, motion(number / SENSOR))
            number += 1
        if between is not None:
            between(stream.time)
        made.append(stream.read(block, **options))
    return np.concatenate(made)


@pytest.fixture
def profile(pink_noise):
    return TextureProfile(pink_noise(16_384, RATE)[0], RATE, 80.0)


@pytest.fixture
def make_stream(profile):
    return lambda friction=0.0, sensor_rate=SENSOR, **options: TextureStream(profile, friction, sensor_rate, **options)


def test_force_is_the_profile_at_the_finger(make_stream, profile):
    made = _play(make_stream(), lambda t: 80 * t)
    wanted = -profile.read(80 * np.arange(len(made)) / RATE, np.full(len(made), 80.0))
    # the path's ring of 1 um against wavelengths from 80 um on
    np.testing.assert_allclose(made[10_000:], wanted[10_000 : len(made)], atol=0.02 * np.abs(wanted).max())


def test_friction_opposes_motion_and_turns_smoothly(make_stream):
    made = _play(make_stream(friction=0.8), lambda t: 40 * np.cos(np.pi * t), normal_force=0.6)
    forth, back = made[3000:7000].mean(), made[13_000:17_000].mean()
    # moving towards smaller positions first: the force points to larger ones
    assert forth == pytest.approx(0.48, abs=0.02) and back == pytest.approx(-0.48, abs=0.02)
    smooth = _play(make_stream(friction=0.8), lambda t: 40 * np.cos(np.pi * t), normal_force=0.0)
    assert not smooth.any()


@pytest.mark.parametrize("exponent", [0.0, -0.1])
def test_without_contact_there_is_no_force_whatever_the_law_of_load(make_stream, exponent):
    made = _play(make_stream(0.8, force_exponent=exponent), lambda t: 80 * t, seconds=0.5, normal_force=0.0)
    assert not made.any()


def test_the_law_of_normal_force_can_be_switched_off(make_stream):
    def motion(t):
        return 80 * t

    plain, heavy = _play(make_stream(), motion), _play(make_stream(), motion, normal_force=1.0)
    off = _play(make_stream(force_exponent=0.0), motion, normal_force=1.0)
    np.testing.assert_allclose(heavy, 2**force_laws.FORCE_EXPONENT * plain, rtol=1e-5, atol=1e-7)  # float32
    np.testing.assert_array_equal(off, plain)


@pytest.mark.parametrize("speed", [40.0, 160.0])
def test_the_law_of_speed_can_be_switched_off(make_stream, speed):
    law, off = (_play(make_stream(speed_exponent=b), lambda t: speed * t)[10_000:] for b in (0.41, 0.0))
    np.testing.assert_allclose(law, (speed / 80) ** 0.41 * off, rtol=1e-3, atol=1e-6)  # the path's speed is 1e-4 exact


def test_laws_are_those_of_the_virtual_surfaces():
    assert (force_laws.FORCE_EXPONENT, force_laws.SPEED_EXPONENT) == (recipe.LOAD_EXPONENT[0], recipe.SPEED_EXPONENT[0])
    assert force_laws.SLOWEST_SLIDING == laws.SLOWEST_SLIDING


def test_another_surface_takes_over_within_100_ms_and_without_a_step(make_stream, pink_noise):
    other = TextureProfile(pink_noise(16_384, RATE, seed=1)[0], RATE, 80.0)
    replaced, stream = [], make_stream(friction=0.2)

    def change(time):
        if time >= 1.0 and not replaced:
            stream.replace(other, 0.6)
            replaced.append(time)

    made = _play(stream, lambda t: 80 * t, between=change)
    start = round(replaced[0] * RATE)
    wanted = -other.read(80 * np.arange(len(made)) / RATE, np.full(len(made), 80.0)) - 0.3
    np.testing.assert_allclose(made[start + 1000 :], wanted[start + 1000 :], atol=0.02 * np.abs(wanted + 0.3).max())
    usual = np.abs(np.diff(made[5000 : start - 10])).max()
    assert np.abs(np.diff(made[start - 10 : start + 1000])).max() < 2 * usual + 0.2 * np.pi / 2 / 200


@pytest.mark.parametrize("degrees", [0, 30, 75, 150])
def test_a_plane_feels_alike_in_all_directions(make_stream, profile, degrees):
    heading = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    made = _play(make_stream(friction=0.5, dimensions=2), lambda t: 80 * t * heading, seconds=2.5)[5000:]
    along, across = made @ heading, made @ np.array([-heading[1], heading[0]])
    assert along.mean() == pytest.approx(-0.25, abs=2e-3) and np.abs(across).max() < 1e-3
    line = profile.read(80 * np.arange(20_000) / RATE, np.full(20_000, 80.0))
    errors = np.abs(band_levels_db(along - along.mean(), RATE) - band_levels_db(line, RATE))
    assert errors.mean() < 2  # dB; other places of one take, up to 13 % slower


def test_a_point_on_a_plane_feels_the_same_again(make_stream):
    def to_and_fro(t):
        return np.array([30.0, 20.0]) * np.sin(np.pi * t)

    made = _play(make_stream(dimensions=2), to_and_fro, seconds=5)
    np.testing.assert_allclose(made[10_000:20_000], made[30_000:40_000], atol=2e-3 * np.abs(made).max() + 1e-6)


@pytest.mark.parametrize(
    ("friction", "options", "message"),
    [
        (-0.1, {}, "`friction_coefficient`"),
        (None, {}, "`friction_coefficient` must be a finite number of at least 0 .*got None"),
        (0.5, {"sampling_rate": None}, "`sampling_rate` must be a finite number above 2000"),
        (0.5, {"speed_exponent": None}, "`speed_exponent` .*got None"),
    ],
)
def test_bad_settings_are_refused(make_stream, friction, options, message):
    with pytest.raises(ValueError, match=message):
        make_stream(friction, **options)


def test_a_normal_force_is_reached_without_a_step(make_stream):
    stream = make_stream(friction=0.8)
    times = np.arange(0, 1, 1 / SENSOR)
    stream.report(times, 80 * times)
    for _ in range(60):
        stream.read(80)
    for block, ramp in ((80, 80), (5000, 200)):  # 20 ms at most
        made = stream.read(block, normal_force=0)
        assert not made[ramp:].any() and made[0] != 0
        assert np.abs(np.diff(made[: ramp + 1])).max() < 0.1 + 0.4 / ramp  # the texture's own, and a share of the mean
        assert not stream.read(80, normal_force=-0.01).any()  # a sensor's noise: no contact
        stream.read(80)


class TestFrictionForADisplay:
    @staticmethod
    def _two(make_stream, motion, **options):
        streams = [make_stream(**options) for _ in range(2)]
        times, force, friction, speed = np.arange(0, 2, 1 / SENSOR), [], [], []
        places = np.array([motion(t) for t in times])
        for stream in streams:
            stream.report(times, places)
        for _ in range(190):
            force.append(streams[0].read(80, 0.6))
            one, two = streams[1].read_friction(80, 0.6)
            friction.append(one)
            speed.append(two)
        return map(np.concatenate, (force, friction, speed))

    def test_it_is_the_force_against_the_motion_about_its_mean(self, make_stream):
        force, friction, speed = self._two(make_stream, lambda t: 40 * np.cos(np.pi * t), friction=0.8)
        forth = np.arange(len(force)) > 10_000 * (1 + 0.05)  # back at first: the force is positive there
        sliding = speed > 5
        against = np.where(forth, -force, force)
        late = sliding & (np.abs(np.arange(len(force)) - 10_000) > 1500)
        np.testing.assert_allclose(friction[late], against[late] - 0.8 * 0.6, atol=1e-6)  # float32
        assert np.abs(friction[late].mean()) < 0.1 * friction[late].std() and speed.min() >= 0
        assert speed.max() == pytest.approx(40 * np.pi, rel=0.1)  # the lead swings beyond
        assert np.abs(friction[speed < 0.01]).max(initial=0) < 1e-3  # at rest nothing

    @pytest.mark.parametrize("degrees", [30, 75])
    def test_on_a_plane_it_is_the_component_along_the_motion(self, make_stream, degrees):
        heading = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
        options = {"friction": 0.8, "dimensions": 2}
        force, friction, speed = self._two(make_stream, lambda t: 80 * t * heading, **options)
        np.testing.assert_allclose(friction[5000:], -(force @ heading)[5000:] - 0.48, atol=1e-4)
        np.testing.assert_allclose(speed[9000:], 80, rtol=1e-3)


@pytest.mark.parametrize("jumps", [(1.0,), (1.0, 1.01)])
def test_a_jump_of_a_metre_is_felt_without_a_step(make_stream, profile, jumps):
    """Also a second one while the first one fades."""
    own = np.abs(np.diff(profile.read(120 * np.arange(20_000) / RATE, np.full(20_000, 120.0)))).max()
    made = _play(make_stream(friction=0.8), lambda t: 80 * t + 1000 * sum(t > jump for jump in jumps))
    assert np.isfinite(made).all()
    # the mean friction of 0.4 N fades within 200 samples by half a cosine: at most pi / 2 of its share a sample
    fading, turning = len(jumps) * 0.4 / 200 * np.pi / 2, 0.4 * 1.5 / 5 * 80 * 40 / RATE
    assert np.abs(np.diff(made)).max() < own + fading + turning
