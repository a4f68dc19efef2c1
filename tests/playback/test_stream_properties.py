"""Any finger under a stream: the same force however it is cut into blocks, never beyond the profile, never NaN."""

import threading
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_diffusers.playback import EndlessProfile, EndlessStream, TextureProfile, TextureStream

RATE, SENSOR = 10_000, 125.0


@pytest.fixture(scope="module")
def profiles():
    rng = np.random.default_rng(0)
    return [TextureProfile(0.01 * rng.standard_normal(3000), RATE, speed) for speed in (80.0, 120.0)]


@st.composite
def sessions(draw, dimensions=1):
    """Chunks of (reports, samples to read, event): what arrives, and how much is then read in blocks."""
    time, place, chunks = 0.0, np.zeros(dimensions), []
    for _ in range(draw(st.integers(1, 12))):
        reports = []
        for _ in range(draw(st.integers(0, 4))):
            # a sensor's period, a gap, a finger that was lifted; a stroke, a rest, a jump
            time += draw(st.sampled_from([0.008, 0.008, 0.001, 1e-6, 0.05, 0.3]))
            step = st.one_of(st.just(0.0), st.floats(-2, 2), st.sampled_from([500.0, -1e4, 1e6]))
            place = place + [draw(step) for _ in range(dimensions)]
            reports.append((time, place if dimensions == 2 else place[0]))
        event = draw(st.sampled_from([None, None, "replace"]))
        chunks.append((reports, draw(st.integers(1, 700)), event, draw(st.floats(0, 2))))
    return chunks


def _play(stream, profiles, chunks, cut, disturb=None):
    """Blocks of every chunk as long as `cut(samples)` says."""
    made, number = [], 0
    for reports, samples, event, normal_force in chunks:
        for time, place in reports:
            stream.report(time, place)
        if event is not None:
            number += 1
            stream.replace(profiles[number % 2], 0.3 * number % 1)
        for block in cut(samples):
            if disturb is not None:
                disturb(stream)
            # of every sample: one number is reached within a block, so that blocks would matter
            made.append(stream.read(block, np.full(block, normal_force)))
    return np.concatenate(made)


def _in_blocks(rng):
    def cut(samples):
        while samples:
            block = int(rng.integers(1, min(samples, 90) + 1))
            samples -= block
            yield block

    return cut


@settings.get_profile("few")
@given(
    data=st.data(), dimensions=st.sampled_from([1, 1, 2]), friction=st.sampled_from([0.0, 0.7]), seed=st.integers(0, 99)
)
def test_blocks_do_not_matter_and_force_is_bounded_by_the_profile(profiles, data, dimensions, friction, seed):
    chunks = data.draw(sessions(dimensions))
    options = {"dimensions": dimensions, "sensor_rate": SENSOR, "force_exponent": 0, "speed_exponent": 0}
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        warnings.simplefilter("ignore", UserWarning)  # of clocks and rates: sessions are odd ones
        whole = _play(TextureStream(profiles[0], friction, **options), profiles, chunks, lambda samples: [samples])
        cut = _in_blocks(np.random.default_rng(seed))
        blocks = _play(TextureStream(profiles[0], friction, **options), profiles, chunks, cut)
    shape = (sum(samples for _, samples, _, _ in chunks),) + ((2,) if dimensions == 2 else ())
    assert whole.shape == blocks.shape == shape and whole.dtype == np.float32
    assert np.isfinite(whole).all()
    far = max((np.abs(place).max() for reports, *_ in chunks for _, place in reports), default=0.0)
    np.testing.assert_allclose(blocks, whole, atol=1e-6 + 1e-9 * far)
    # two resolutions that are subtracted, and a cubic between samples; three axes of a plane, whose weights have the
    # norm 1; what fades where a finger lands elsewhere comes on top, once
    largest = 2.5 * max(np.abs(profile._samples).max() for profile in profiles) * (np.sqrt(3) if dimensions == 2 else 1)
    assert np.abs(whole).max() <= 2 * (max(normal_force for *_, normal_force in chunks) + largest)


BAD_REPORTS = [
    *((np.nan, 0.0), (np.inf, 0.0), (1e9, np.nan), (1e9, np.inf), (-1.0, 0.0), ([1e9, 1e9], [0.0, 1.0])),
    *(([1e9, 1e9 + 1], [0.0]), (1e9, [0.0, 1.0, 2.0]), ([[1e9]], 0.0)),
    *(("x", 0.0), (1e9, "x"), (None, 0.0), (1e9, None)),
]
BAD_BLOCKS = [(0, 0.5), (-3, 0.5), (2.5, 0.5), ("x", 0.5), (None, 0.5), (np.nan, 0.5)]
BAD_FORCES = [(32, np.nan), (32, np.inf), (32, "x"), (32, [0.5] * 31), (32, np.zeros((32, 2))), (32, None)]


@pytest.mark.parametrize("dimensions", [1, 2])
def test_bad_calls_are_refused_and_change_nothing(profiles, dimensions):
    def disturb(stream):
        with pytest.raises((ValueError, TypeError)):
            stream.replace(profiles[1], np.nan)
        for time, place in BAD_REPORTS:
            with pytest.raises(ValueError, match="`time`|`position`"):
                stream.report(time, place)
        for name, calls in (("samples", BAD_BLOCKS), ("normal_force", BAD_FORCES)):
            for samples, normal_force in calls:
                with pytest.raises(ValueError, match=f"`{name}`"):
                    stream.read(samples, normal_force)

    place = np.ones(dimensions) if dimensions == 2 else 1.0
    chunks = [([(0.01 + 0.008 * n, 0.5 * n * place)], 80, None, 0.5) for n in range(6)]
    made = [
        _play(TextureStream(profiles[0], 0.5, SENSOR, dimensions=dimensions), profiles, chunks, lambda n: [n], between)
        for between in (None, disturb)
    ]
    np.testing.assert_array_equal(*made)


class _Noise:
    """A source of windows of noise, without a network."""

    ratings, seed, level, friction_coefficient = None, 0, -4.6, 0.4
    reference_speed, spacing, window_length = 80.0, 18.0, 24.0
    lock = threading.RLock()

    def window_generator(self, *_):
        return self

    def generate(self, indices):
        noise = {index: 0.01 * np.random.default_rng(index % 2**32).standard_normal(3000) for index in indices}
        return {index: TextureProfile(n, RATE, 80.0, repeats=False, fill=False) for index, n in noise.items()}

    open = generate

    def interrupt(self):
        pass


@settings.get_profile("few")
@given(places=st.lists(st.floats(-200, 200), min_size=1, max_size=30), speed=st.floats(0, 500))
def test_an_endless_profile_is_finite_wherever_it_is_read(places, speed):
    profile = EndlessProfile(_Noise(), None)
    with pytest.raises(RuntimeError, match="`generate`"):
        profile.read(np.zeros(1), np.zeros(1))
    profile.generate(0)
    places, speeds = np.array(places), np.full(len(places), speed)
    made = profile.read(places, speeds)
    assert made.shape == (len(places),) and np.isfinite(made).all() and np.abs(made).max() < 0.2
    missing = profile.missing()
    assert not set(missing) & set(profile.windows)
    profile._stand_ins.clear()
    profile.generate(*missing[:8])
    assert np.isfinite(profile.read(places, speeds)).all()


@settings.get_profile("few")
@given(data=st.data(), dimensions=st.sampled_from([1, 2]), wait=st.booleans())
def test_an_endless_stream_is_finite_under_any_finger(data, dimensions, wait):
    chunks = data.draw(sessions(dimensions))
    with EndlessStream(EndlessProfile(_Noise(), None, wait=wait), SENSOR, dimensions=dimensions) as stream:
        made = []
        for reports, samples, _, normal_force in chunks:
            for time, place in reports:
                stream.report(time, place)
            made.append(stream.read(samples, normal_force))
    made = np.concatenate(made)
    assert np.isfinite(made).all() and np.abs(made).max() < 20
