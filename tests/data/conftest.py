"""Small recordings that the tests of the data room share."""

import numpy as np
import pytest

from tactile_diffusers.data import RecordingsWriter, generate_recordings, prepare_recordings
from tactile_diffusers.signal import DEVICE_RATE, RATING_AXES

VELOCITY_RATE = 500


def make_recording(seconds=4.0, normal_force=0.5, speed=80.0, friction=0.6, heading=0.0, seed=0):
    """A steady slide with white noise on the friction: keyword arguments of `add_recording`."""
    rng = np.random.default_rng(seed)
    samples = int(seconds * DEVICE_RATE)
    lateral = friction * normal_force + 0.01 * rng.standard_normal(samples)
    force = np.stack([lateral * np.cos(heading), lateral * np.sin(heading), np.full(samples, normal_force)], axis=-1)
    direction = np.array([np.cos(heading), np.sin(heading)])
    velocity = np.tile(speed * direction, (int(seconds * VELOCITY_RATE), 1))
    return dict(force=force, force_rate=DEVICE_RATE, velocity=velocity, velocity_rate=VELOCITY_RATE)


def write_recordings(path, recordings, ratings=None):
    """Writes {surface: keyword arguments of `add_recording`}; `ratings` is (raters, surfaces, 3)."""
    with RecordingsWriter(path, source="a test", licence="CC0-1.0") as writer:
        for surface, recording in recordings.items():
            writer.add_recording(surface, "explorer", "0", **recording)
        if ratings is not None:
            writer.set_ratings(ratings, [f"r{i}" for i in range(len(ratings))], list(recordings), RATING_AXES)
    return path


@pytest.fixture
def recording_maker():
    return make_recording


@pytest.fixture
def recordings_writer():
    return write_recordings


@pytest.fixture(scope="session")
def virtual_recordings(tmp_path_factory):
    path = tmp_path_factory.mktemp("virtual") / "recordings.h5"
    generate_recordings(path, surfaces=6, seconds=12, explorers=1, seed=3, quiet=True)
    return path


@pytest.fixture(scope="session")
def virtual_prepared(virtual_recordings):
    path = virtual_recordings.with_name("prepared.h5")
    prepare_recordings(virtual_recordings, path, validation=1, test=1, quiet=True)
    return path
