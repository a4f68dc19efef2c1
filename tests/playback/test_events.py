"""Stick-slip under a moving finger: its own rate and level, slow side first, and nothing where there is none."""

import numpy as np
import pytest

from tactile_diffusers.playback import TextureProfile, TextureStream, force_laws
from tactile_diffusers.playback.events import EventPlayer, separate_events
from tactile_diffusers.signal import band_pass, rms
from tactile_diffusers.signal.waveform_shape import waveform_shape
from tactile_diffusers.virtual import laws

RATE, SPEED, SAMPLES, EVENTS_HZ = 10_000, 80.0, 16_384, 150.0


def _train(seed=0, samples=SAMPLES):
    """A sawtooth that rises for 85 % of its jittered periods, on and off every 0.2 s: N, filtered as recordings are."""
    rng, rise = np.random.default_rng(seed), 0.85
    ends = np.cumsum(np.exp(0.15 * rng.standard_normal(2 * int(samples / RATE * EVENTS_HZ))) / EVENTS_HZ)
    times = np.arange(samples) / RATE
    period = np.searchsorted(ends, times)
    begins = np.append(0, ends)[period]
    phase = (times - begins) / (ends[period] - begins)
    on = 0.5 + 0.5 * np.tanh(6 * np.sin(2 * np.pi * times / 0.4))
    return band_pass(0.02 * on * (np.minimum(phase / rise, (1 - phase) / (1 - rise)) - 0.5), RATE)


@pytest.fixture(scope="module")
def train():
    return _train()


@pytest.fixture
def sticky(train, pink_noise):
    rest = band_pass(pink_noise(SAMPLES, RATE, band=(5.0, 2000.0), seed=3)[0], RATE)
    return train + 0.4 * rms(train) / rms(rest) * rest


def _rate(wave):
    """Falls a second: peaks of the smoothed, negative derivative at least half as high as high ones, while it is on."""
    from scipy import ndimage, signal

    fall = -np.diff(ndimage.gaussian_filter1d(wave, 4))
    peaks, _ = signal.find_peaks(fall, height=0.35 * np.quantile(fall, 0.995))
    return 1 / np.median(np.diff(peaks) / RATE)


def _play(train, speed, normal_force=0.5, blocks=None, fill=True):
    profile = TextureProfile(train, RATE, SPEED, fill=fill, separate=False)
    player = EventPlayer(profile, RATE)
    blocks = blocks or [50] * 300
    return np.concatenate([player.advance(np.full(n, float(speed)), normal_force) for n in blocks])


@pytest.mark.parametrize(("speed", "force"), [(40.0, 0.5), (80.0, 0.5), (160.0, 0.5), (80.0, 0.25), (80.0, 1.0)])
def test_a_train_follows_its_laws_and_keeps_its_slow_side_first(train, speed, force):
    played = _play(train, speed, force)
    stiffness = (0.75 + 4.04e-3 * (speed - 80)) / 0.75
    rate = EVENTS_HZ * speed / 80 * stiffness * (0.5 / force) ** (2 / 3)
    assert _rate(played) == pytest.approx(rate, rel=0.12)  # the median of jittered periods
    assert waveform_shape(played)["slope_skew"] < -0.8
    level = (force / 0.5) ** (2 / 3 + 0.2) * (speed / 80) ** -0.2
    assert rms(played) == pytest.approx(level * rms(_play(train, 80.0)), rel=0.2)  # part of the train passes


def test_events_go_forwards_however_the_finger_turns(sticky):
    def played(motion):
        stream = TextureStream(TextureProfile(sticky, RATE, SPEED), 0.0, 1000.0)
        times = np.arange(0, 4, 1e-3)
        stream.report(times, motion(times))
        return np.concatenate([stream.read_friction(50)[0] for _ in range(780)])[2000:]

    for motion in (lambda t: 80 * t, lambda t: -80 * t, lambda t: 30 * np.sin(np.pi * t)):
        assert waveform_shape(played(motion))["slope_skew"] < -0.6
    in_place = TextureProfile(sticky, RATE, SPEED, separate=False)
    back = in_place.read(-80 * np.arange(SAMPLES) / RATE, np.full(SAMPLES, 80.0))
    assert waveform_shape(back)["slope_skew"] > 0.6  # read over places, it would be turned round


def test_parts_are_the_train_and_the_rest(sticky, train):
    events, rest = separate_events(sticky, RATE)
    assert np.corrcoef(events, train)[0, 1] > 0.85 and abs(np.corrcoef(rest, train)[0, 1]) < 0.75
    assert 10 * np.log10((rms(events) ** 2 + rms(rest) ** 2) / rms(sticky) ** 2) == pytest.approx(0, abs=0.5)  # dB


def test_a_texture_without_events_runs_nothing_for_events(pink_noise, monkeypatch):
    def _fail(*_):
        raise AssertionError("there are no events")

    monkeypatch.setattr(EventPlayer, "__init__", _fail)
    monkeypatch.setattr(EventPlayer, "advance", _fail)
    noise, line = pink_noise(SAMPLES, RATE)[0], np.sin(2 * np.pi * 0.02 * np.arange(SAMPLES))
    for texture in (noise, line, np.zeros(SAMPLES), -_train()):  # the last one lets go slowly
        profile, plain = (TextureProfile(texture, RATE, SPEED, separate=separate) for separate in (True, False))
        assert profile.events is None
        made = []
        for each in (profile, plain):
            stream = TextureStream(each, 0.5, 125.0)
            stream.report(np.arange(5) / 125, np.arange(5) * 0.64)
            made.append(np.concatenate([stream.read(50, 0.7) for _ in range(8)]))
        np.testing.assert_array_equal(*made)


def test_blocks_join_without_a_step_and_streams_are_deterministic(sticky, train):
    long, short = (_play(train, 120.0, 0.8, [n] * (6000 // n)) for n in (2000, 40))
    np.testing.assert_allclose(long, short, atol=1e-9)
    profile = TextureProfile(sticky, RATE, SPEED)
    assert profile.events is not None

    def play(block):
        stream = TextureStream(profile, 0.6, 125.0)
        assert stream.latency == pytest.approx(1 / 125 + 5e-3 + 0.51 / 8, abs=2e-3)  # nothing is looked ahead for
        times = np.arange(0, 1, 1 / 125)
        stream.report(times, 100 * times)
        return np.concatenate([stream.read(block, np.full(block, 0.7)) for _ in range(9600 // block)])

    np.testing.assert_array_equal(play(32), play(32))
    np.testing.assert_allclose(play(32), play(48), atol=2e-6)


def test_force_and_speed_change_events_without_clicks(train):
    player = EventPlayer(TextureProfile(train, RATE, SPEED, separate=False), RATE)
    made, force = [], 0.5 + 0.4 * np.sin(np.linspace(0, 20, 12_000))
    speed = 80 + 70 * np.sin(np.linspace(0, 9, 12_000))
    for begin in range(0, 12_000, 40):
        made.append(player.advance(speed[begin : begin + 40], force[begin : begin + 40]))
    steps = np.abs(np.diff(np.concatenate(made)))
    at_joints, inside = steps[39::40], np.delete(steps, np.s_[39::40])
    assert at_joints.max() <= 1.2 * inside.max()
    lifted = player.advance(np.full(50, 80.0), 0.0)
    assert not lifted.any()


def test_laws_are_those_of_the_virtual_surfaces():
    assert force_laws.STIFFNESS_PER_SPEED == laws.STIFFNESS_PER_SPEED
    assert force_laws.event_rate(80.0, 0.5, 80.0) == force_laws.event_gain(80.0, 0.5, 80.0) == 1
    # the share of time above the gate's middle, at a readiness of half a log force or speed, halved or doubled
    from scipy.stats import norm

    for factor in (0.5, 2.0):
        pressed = np.sqrt(norm.cdf(laws.STICKS_WHEN_PRESSED * np.log(factor)) / 0.5)
        fast = np.sqrt(norm.cdf(laws.STICKS_WHEN_FAST * np.log(factor)) / 0.5)
        assert factor**force_laws.STICKING_FORCE_EXPONENT == pytest.approx(pressed, rel=0.03)
        assert factor**force_laws.STICKING_SPEED_EXPONENT == pytest.approx(fast, rel=0.03)


def test_speeds_and_forces_beyond_the_laws_are_held():
    speed, force = np.array([0.0, 1.0, 10.0, 320.0, 3000.0]), np.array([0.0, 0.01, 0.05])
    rates = force_laws.event_rate(speed, 0.5, 80.0)
    assert rates[0] == rates[1] == rates[2] > 0 and rates[3] == rates[4]
    assert len(set(force_laws.event_rate(80.0, force, 80.0))) == 1 and force_laws.event_gain(80.0, 0.0, 80.0) == 0
