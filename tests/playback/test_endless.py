"""Textures without end: the same wherever one comes from, without dips at the joints, generated in a thread."""

import threading
import time

import numpy as np
import pytest

from tactile_diffusers import TactileTexturePipeline, bundled_checkpoint
from tactile_diffusers.playback import EndlessProfile, EndlessStream
from tactile_diffusers.signal import rms

SPEED = 80.0
RATINGS = [0.5, 0.0, -0.5]


@pytest.fixture
def pipe(make_pipeline):
    return make_pipeline()


@pytest.fixture
def make_profile(pipe):
    return lambda ratings=RATINGS, **options: EndlessProfile(pipe, ratings, **options)


def _place(profile, windows):
    """mm, of places in windows from the beginning of window 0."""
    return windows * profile.spacing - profile.window_length / 2


def _read(profile, begin, end, samples=400, speed=SPEED):
    return profile.read(_place(profile, np.linspace(begin, end, samples)), np.full(samples, speed))


def _wait_for(condition, seconds=20.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "the thread has not done it in time"
        time.sleep(0.002)


class TestProfile:
    def test_a_window_is_the_same_whatever_was_generated_before(self, make_profile):
        first, second = make_profile(), make_profile()
        first.generate(0, 1, 2, 3)
        second.generate(3)
        np.testing.assert_allclose(_read(first, 3.3, 3.9), _read(second, 3.3, 3.9), atol=1e-4 * 0.01)

    def test_no_two_windows_are_alike(self, make_profile):
        profile = make_profile(fill=False)
        profile.generate(0, 1, -1)
        places = [_read(profile, index + 0.3, index + 0.9) for index in (-1, 0, 1)]
        assert np.abs(np.corrcoef(places)[np.triu_indices(3, 1)]).max() < 0.3

    def test_no_step_where_windows_meet(self, make_profile):
        profile = make_profile()
        profile.generate(0, 1, 2)
        read = _read(profile, 0.5, 2.9, samples=12_000)
        steps = np.abs(np.diff(read))
        inside = np.abs(np.diff(_read(profile, 1.3, 1.99, samples=3450))).max()
        assert steps.max() < 2 * inside

    def test_memory_is_bounded_and_what_was_dropped_comes_back(self, make_profile, monkeypatch):
        monkeypatch.setattr("tactile_diffusers.playback.endless.LARGEST_CACHE", 3)
        monkeypatch.setattr("tactile_diffusers.playback.window_generator.LARGEST_TAKES", 5)
        profile = make_profile()
        profile.generate(0)
        first = _read(profile, 0.3, 0.9)
        for index in range(1, 8):
            profile.generate(index)
            _read(profile, index + 0.3, index + 0.9)
        assert len(profile.windows) == 3 and len(profile._generator._takes) == 5 and 0 not in profile.windows
        profile.generate(0)
        np.testing.assert_allclose(_read(profile, 0.3, 0.9), first, atol=1e-4 * 0.01)

    def test_another_window_stands_in_until_the_finger_has_left(self, make_profile):
        profile = make_profile()
        profile.generate(0)
        own = _read(profile, 0.3, 0.9)
        stand_in = _read(profile, 7.3, 7.9)
        np.testing.assert_allclose(stand_in, own, atol=1e-9)
        assert profile.substituted == 1 and profile.missing()[:2] == [7, 8]
        profile.generate(7)
        np.testing.assert_allclose(_read(profile, 7.3, 7.9), own, atol=1e-9)  # no step under the finger
        for _ in range(100):
            _read(profile, 0.4, 0.5)
        assert np.abs(_read(profile, 7.3, 7.9) - own).max() > 1e-4
        assert profile.substituted == 1

    def test_an_opening_is_the_middle_of_its_window_and_gives_way_to_it(self):
        pipe = TactileTexturePipeline.from_pretrained(bundled_checkpoint())
        pipe.set_progress_bar_config(disable=True)
        profile, whole = (EndlessProfile(pipe, [1.5, 0.0, -1.0]) for _ in range(2))
        assert profile.open(0) and not profile.windows and profile.missing()[0] == 0
        whole.generate(0)
        middle = (0.3, 0.7)  # of the window: between those fifths where it repeats itself
        x = np.linspace(*((place - 0.5) * whole.window_length for place in middle), 4000)
        read, wanted = (one.read(x, np.full(len(x), whole.reference_speed)) for one in (profile, whole))
        # a tenth of the texture, whose decoder sees less at its edges, and whose level is estimated from its bands
        assert rms(read - wanted) < 0.1 * rms(wanted)
        profile.generate(0)
        handed = profile.read(x, np.full(len(x), whole.reference_speed))
        assert rms((handed - wanted)[-400:]) < 0.1 * rms(read - wanted) and profile.substituted == 0
        after = profile.read(x, np.full(len(x), whole.reference_speed))
        np.testing.assert_allclose(after, wanted, atol=1e-4 * rms(wanted))  # to rounding: the takes' batches differ

    def test_reading_may_wait_for_windows(self, make_profile):
        profile, other = make_profile(wait=True), make_profile()
        other.generate(*range(7, 20))
        texture = _read(profile, 7.3, 19.7, samples=2000)  # more windows in one read than are kept
        np.testing.assert_allclose(texture[:300], _read(other, 7.3, 19.7, samples=2000)[:300], atol=1e-4 * 0.01)
        assert profile.substituted == 0 and len(profile.windows) == 12

    def test_waiting_outlasts_an_interrupt(self, make_profile, monkeypatch):
        profile, interrupts = make_profile(wait=True), iter([True, True, False])
        generate = type(profile._generator).generate

        def often_interrupted(generator, *arguments):
            return {} if next(interrupts) else generate(generator, *arguments)

        monkeypatch.setattr(type(profile._generator), "generate", often_interrupted)
        assert np.isfinite(_read(profile, 0.4, 0.9)).all() and list(profile.windows) == [0]

    def test_an_interrupted_pipeline_leaves_nothing_half_made(self, make_profile, monkeypatch):
        profile = make_profile()
        decode = type(profile.pipe).decode

        def interrupted(pipe, *arguments, **options):
            out = decode(pipe, *arguments, **options)
            pipe._interrupt = True
            return out

        monkeypatch.setattr(type(profile.pipe), "decode", interrupted)
        profile.generate(0)
        assert profile.windows == {}
        with pytest.raises(RuntimeError, match="`generate` a window first"):
            _read(profile, 0, 1)

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"ratings": [9.0, 0, 0]}, "`ratings`"),
            ({"ratings": [RATINGS, RATINGS]}, "`ratings` must be those of one texture, got 2"),
            ({"seed": -1}, "`seed` must be a whole number"),
            ({"num_inference_steps": 0}, "`num_inference_steps`"),
            ({"num_latent_inference_steps": 1.5}, "`num_latent_inference_steps`"),
        ],
    )
    def test_bad_input(self, make_profile, make_pipeline, options, message):
        with pytest.raises(ValueError, match=message):
            make_profile(**options)
        with pytest.raises(ValueError, match="`pipe` has no `dale`"):
            EndlessProfile(make_pipeline(dale=False), RATINGS)
        with pytest.raises(ValueError, match="must be an EndlessProfile, got str"):
            EndlessStream("profile", 125.0)


class TestStream:
    @pytest.mark.parametrize("direction", [(40.0,), (30.0, 20.0)])
    def test_follows_the_finger_over_many_windows(self, make_profile, direction):
        profile, forces = make_profile(), []
        with EndlessStream(profile, 125.0, dimensions=len(direction)) as stream:
            # the tiny windows are 12 mm long: 40 mm/s cross three of them in a second
            for number in range(125):
                stream.report(number / 125, np.array(direction) * number / 125)
                forces.append(stream.read(80))
                _wait_for(lambda: not profile.missing() or stream._failure)
        force = np.concatenate(forces).reshape(125 * 80, -1)
        assert force.shape[1] == len(direction) and np.isfinite(force).all() and force.any(0).all()
        assert profile.substituted == stream.substituted <= 3 and len(profile.windows) >= 3

    def test_a_change_of_ratings_from_another_thread(self, make_profile):
        profile = make_profile()
        with EndlessStream(profile, 125.0) as stream:
            stream.report([0.0, 0.008], [0.0, 0.5])
            stream.read(32)
            thread = threading.Thread(target=stream.change, args=([-1.0, 1.0, 1.0],))
            thread.start()
            thread.join()
            _wait_for(lambda: stream.profile is not profile)
            changed = stream.profile
            for _ in range(20):
                stream.read(32)
            assert changed is stream.profile and changed.ratings.tolist() == [[-1.0, 1.0, 1.0]]
            assert changed.friction_coefficient != profile.friction_coefficient
            assert changed.options == profile.options and changed.seed == profile.seed

    def test_a_change_is_in_the_scale_of_the_profile(self, make_pipeline):
        statistics = {"mean": [3.0, 4.0, 5.0], "std": [1.5, 2.0, 1.0]}
        pipe = make_pipeline(dale_config={"rating_statistics": statistics})
        with EndlessStream(EndlessProfile(pipe, [6.0, 4.0, 5.0], rating_scale="raw"), 125.0) as stream:
            assert stream.profile.ratings.tolist() == [[2.0, 0.0, 0.0]]
            stream.change([3.0, 8.0, None])
            _wait_for(lambda: stream.profile.ratings[0, 1] == 2.0)

    def test_impossible_ratings_leave_the_stream_as_it_was(self, make_profile):
        profile = make_profile()
        with EndlessStream(profile, 125.0) as stream:
            with pytest.raises(ValueError, match="`ratings`"):
                stream.change([9.0, 0.0, 0.0])
            stream.read(32)
            assert stream.profile is profile and not stream._changes
        assert not stream._worker.is_alive() and np.isfinite(stream.read(32)).all()  # closed, it can still be read

    def test_a_failure_in_the_thread_is_raised_where_it_is_read(self, make_profile, monkeypatch):
        profile = make_profile()
        with EndlessStream(profile, 125.0) as stream:

            def fail(*_, **__):
                raise OSError("gone")

            monkeypatch.setattr(EndlessProfile, "generate", fail)
            stream.change([0.0, 0.0, 0.0])
            _wait_for(lambda: stream._failure)
            for read in (stream.read, stream.read_friction):
                with pytest.raises(RuntimeError, match="Generating has failed: OSError"):
                    read(32)

    def test_substituted_windows_are_counted_and_warned_of_once(self, make_profile, monkeypatch):
        with EndlessStream(make_profile(), 125.0) as stream:
            monkeypatch.setattr(EndlessProfile, "missing", lambda _: [])  # a thread that is never in time
            with pytest.warns(UserWarning, match=r"another one stands in .*wait=True") as warned:
                for number in range(60):
                    stream.report(number / 125, 100 * number / 125)
                    stream.read(80)
            before = stream.substituted
            stream.change([0.0, 1.0, 0.0])
            _wait_for(lambda: stream.profile.ratings[0, 1] == 1.0)
            assert before >= 2 and stream.substituted == before and len(warned) == 1
            assert warned[0].filename == __file__

    def test_waiting_reads_the_same_at_any_pace(self, make_profile):
        forces = []
        for _ in range(2):
            with EndlessStream(make_profile(wait=True), 125.0) as stream:
                times = np.arange(125) / 125
                stream.report(times, 100 * times)  # 100 mm: eight of the tiny windows
                force = [stream.read(4000)]
                stream.change([0.0, 1.0, 0.0])
                assert stream.profile.ratings.tolist() == [[0.0, 1.0, 0.0]]  # at once
                forces.append(np.concatenate([*force, stream.read(6000)]))
                assert stream.substituted == 0
        np.testing.assert_allclose(*forces, atol=1e-4 * forces[0].std())
