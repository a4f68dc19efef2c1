"""A whole trajectory: as the stream would have played it."""

import numpy as np
import pytest

from tactile_diffusers.playback import TextureProfile, TextureStream, play_trajectory, read_trajectory

RATE, SENSOR = 10_000, 125.0


@pytest.fixture
def profile(pink_noise):
    return TextureProfile(pink_noise(16_384, RATE)[0], RATE, 80.0)


@pytest.fixture
def stroke():
    """A finger that rests, slides at 80 mm/s from 0.5 s to 1.5 s, and rests."""
    time = np.arange(250) / SENSOR
    return time, 80 * np.clip(time - 0.5, 0, 1)


def test_it_is_what_a_stream_gives(profile, stroke):
    time, place = stroke
    played = play_trajectory(profile, 0.6, time + 40.0, place, normal_force=0.4)  # times begin anywhere
    stream, parts = TextureStream(profile, 0.6, SENSOR), []
    for begin in range(0, len(played.force), 50):
        due = (time >= begin / RATE - 1e-9) & (time < (begin + 50) / RATE - 1e-9)
        if due.any():
            stream.report(time[due], place[due])
        parts.append(stream.read(50, normal_force=0.4))
    np.testing.assert_allclose(played.force, np.concatenate(parts)[: len(played.force)], atol=1e-6)
    assert played.latency == pytest.approx(stream.latency)
    assert len(played.force) == round((time[-1] + stream.latency) * RATE)


@pytest.mark.parametrize("lost", [4, 10])
def test_dropped_reports_are_bridged(profile, stroke, lost):
    time, place = stroke
    kept = np.delete(np.arange(len(time)), range(90, 90 + lost))  # up to 88 ms without a report
    whole = play_trajectory(profile, 0.6, time, place)
    played = play_trajectory(profile, 0.6, time[kept], place[kept])
    np.testing.assert_allclose(played.force, whole.force, atol=1e-4)  # of another order of sums


def test_it_starts_turns_and_stops(profile, stroke):
    time, place = stroke
    played = play_trajectory(profile, 0.6, time, place)
    assert not played.friction[:4000].any() and np.abs(played.friction[-100:]).max() < 1e-3
    assert played.force[8000:14_000].mean() == pytest.approx(-0.3, abs=0.02)  # 0.6 x 0.5 N, against the motion
    assert abs(played.friction[8000:14_000].mean()) < 0.01 and played.speed[10_000:14_000].mean() == pytest.approx(
        80, rel=0.02
    )
    back = play_trajectory(profile, 0.6, time, -place)
    assert back.force[8000:14_000].mean() == pytest.approx(0.3, abs=0.02)


def test_a_lifted_finger_and_a_plane_are_taken(profile, stroke):
    time, place = stroke
    kept = (time < 0.8) | (time > 1.2)
    # 2.5 s without a report: longer than a stream takes ahead
    lifted = play_trajectory(profile, 0.6, np.where(time > 1.2, time + 2.1, time)[kept], place[kept])
    assert np.isfinite(lifted.force).all() and not lifted.friction[20_000:30_000].any()
    plane = play_trajectory(profile, 0.6, time, np.stack([place, 0.5 * place], 1), sampling_rate=4000)
    assert plane.force.shape == (len(plane.friction), 2) and plane.sampling_rate == 4000


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time": [0.0]}, "at least two reports"),
        ({"time": [0.0, 0.1, 0.05]}, "`time` ascend"),
        ({"position": [0.0, np.nan, 1.0]}, "must be finite"),
        ({"position": [[0.0] * 3] * 3}, "at least two reports"),
        ({"time": [0.0, 0.1, 4000.0]}, "of at most 3600 in s"),
        ({"time": [0.0, 0.1, 0.2]}, "`cutoff` must be below half of the sensor's 10 Hz"),
        ({"normal_force": -1}, "`normal_force` must be"),
        ({"sampling_rate": 1000}, "`sampling_rate` must be"),
    ],
)
def test_impossible_trajectories_are_refused(profile, change, message):
    good = {"time": [0.0, 0.01, 0.02], "position": [0.0, 0.5, 1.0]}
    with pytest.raises(ValueError, match=message):
        play_trajectory(profile, 0.5, **{**good, **change})


def test_files(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time,position\n0,1\n0.01,2.5\n")
    time, place = read_trajectory(path)
    np.testing.assert_array_equal(time, [0, 0.01])
    np.testing.assert_array_equal(place, [1, 2.5])
    path.write_text("time, x, y\n0,1,2\n0.01,2.5,3\n")
    assert read_trajectory(path)[1].shape == (2, 2)
    for text in ("", "t,x\n0,1\n", "time,position\n0,1,2\n", "time,position\n0,one\n"):
        path.write_text(text)
        with pytest.raises(ValueError, match="a.csv cannot be read as a trajectory"):
            read_trajectory(path)
    with pytest.raises(FileNotFoundError):
        read_trajectory(tmp_path / "b.csv")
