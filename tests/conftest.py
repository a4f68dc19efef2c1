"""What the tests of several rooms share: tiny models with random weights, made-up textures, a recorder of warnings."""

import json
import logging
import math
import os
import select
import signal
import subprocess
import sys
import warnings
from contextlib import contextmanager
from pathlib import Path

if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # processes share the cores already
os.environ.setdefault("HF_HUB_OFFLINE", "1")  # before huggingface_hub is imported: no test needs the network

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, settings

from tactile_diffusers import DALEModel, LCTGModel, TactileFeatureExtractor, TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.data import RecordingsWriter, SegmentLimits, prepare_recordings
from tactile_diffusers.signal import DEVICE_RATE, RATING_AXES
from tactile_diffusers.virtual import generate_recordings

# How many examples a property is tried on: "few" where one takes long, "many" where it does not. The same ones in every
# run; FUZZ=50 tries fifty times as many, others each time.
_FACTOR = int(os.environ.get("FUZZ", "1"))
for _name, _examples in (("few", 25), ("many", 100)):
    settings.register_profile(
        _name,
        max_examples=_examples * _FACTOR,
        derandomize=_FACTOR == 1,
        database=None,
        deadline=None,
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow, HealthCheck.data_too_large],
    )

_VELOCITY_RATE = 500
LCTG = {
    "feature_channels": 24,
    "feature_hop": 8,
    "latent_channels": 4,
    "latent_hop": 16,
    "encoder_width": 12,
    "widths": [8, 12, 16],
    "patch_size": 4,
    "embedding_dim": 16,
    "segment_samples": 512,
    "detail_channels": 0,
    "level_bands": 0,
    "envelope_channels": 0,
}
DALE = {
    "in_channels": 6,
    "latent_frames": 32,
    "widths": [32, 32],
    "embedding_dim": 16,
    "rating_dim": 16,
    "cross_attention": True,
    "latent_mean": [0.1, -0.1, 0.2, 0.0],
    "latent_std": [0.5, 0.4, 0.3, 0.6],
    "level_channels": 0,
    "envelope_channels": 0,
    "patch_size": 1,
}
EXTRACTOR = {
    "num_filters": 24,
    "level_bands": 0,
    "envelope_samples": 0,
    "detail_samples": 0,
    "hop_length": 8,
    "window_lengths": [64, 256],
    "preemphasis_frequencies": [20.0, 100.0, 400.0, 1000.0],
    "preemphasis_db": [0.0, 8.0, 15.0, 22.0],
}


def _randomized(module, seed=0):
    """Gives every parameter a random value of a size that keeps signals near 1.

    New models are zero at the output (and new blocks are the identity): without this, no test of outputs could fail.
    """
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for parameter in module.parameters():
            fan_in = parameter[0].numel() if parameter.ndim > 1 else 25
            parameter.copy_(torch.randn(parameter.shape, generator=generator) / math.sqrt(fan_in))
    return module


def _make_lctg(seed=0, **changes):
    return _randomized(LCTGModel(**{**LCTG, **changes}), seed).eval()


def _make_dale(seed=1, **changes):
    return _randomized(DALEModel(**{**DALE, **changes}), seed).eval()


def _make_extractor(**changes):
    return TactileFeatureExtractor(**{**EXTRACTOR, **changes})


def _make_pipeline(dale=True, seed=0, dale_config=None, lctg_config=None):
    pipe = TactileTexturePipeline(
        lctg=_make_lctg(seed, **(lctg_config or {})),
        feature_extractor=_make_extractor(),
        scheduler=VDDIMScheduler(),
        dale=_make_dale(seed + 1, **(dale_config or {})) if dale else None,
        dale_scheduler=VDDIMScheduler() if dale else None,
    )
    pipe.set_progress_bar_config(disable=True)
    return pipe


def _pink_noise(samples, sampling_rate, count=1, seed=0, exponent=1.0, band=(25.0, 900.0), rms=0.01):
    """(count, samples) noise whose amplitude falls as f**-exponent inside `band`: zero mean, RMS `rms` in N."""
    rng = np.random.default_rng(seed)
    length = 2 * samples  # twice as long as needed, so that what is returned is not periodic
    frequencies = np.fft.rfftfreq(length, 1 / sampling_rate)
    inside = (frequencies >= band[0]) & (frequencies <= band[1])
    gains = np.where(inside, np.maximum(frequencies, band[0]) ** -exponent, 0.0)
    spectrum = gains * rng.normal(size=(count, len(frequencies), 2)).view(np.complex128)[..., 0]
    noise = np.fft.irfft(spectrum, n=length, axis=-1)[:, :samples]
    noise -= noise.mean(-1, keepdims=True)
    return noise / np.sqrt(np.mean(noise**2, axis=-1, keepdims=True)) * rms


@contextmanager
def _recorded_warnings():
    """Yields a list that fills with every warning, and every log record of level WARNING or more, of any package."""

    class Collector(logging.Handler):
        def emit(self, record):
            found.append(f"{record.name}: {record.getMessage()}")

    found, collector = [], Collector(logging.WARNING)
    loggers = [logging.getLogger(name) for name in (None, "diffusers", "transformers", "accelerate")]
    for logger in loggers:
        logger.addHandler(collector)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            yield found
        found.extend(f"{warning.category.__name__}: {warning.message}" for warning in caught)
    finally:
        for logger in loggers:
            logger.removeHandler(collector)


@pytest.fixture
def randomized():
    return _randomized


@pytest.fixture
def make_lctg():
    return _make_lctg


@pytest.fixture
def make_dale():
    return _make_dale


@pytest.fixture
def make_extractor():
    return _make_extractor


@pytest.fixture(scope="session")
def make_pipeline():
    return _make_pipeline


@pytest.fixture(scope="session")
def rating_statistics():
    """Statistics of DALE that ratings can be drawn from."""
    return {
        "quantiles": [[-1.5, 0.0, 1.5]] * 3,
        "centre": [0.0] * 3,
        "covariance": [[0.6, 0.2, 0.0], [0.2, 0.6, 0.0], [0.0, 0.0, 0.6]],
        "reach": 4.0,
        "range": [[-1.5, 1.5]] * 3,
    }


@pytest.fixture
def pipe():
    return _make_pipeline()


@pytest.fixture
def evaluable_pipe():
    """A function (dale=True) -> a pipeline whose segments, 0.82 s, are long enough for `TactileEmbedding`."""
    return lambda dale=True: _make_pipeline(dale, 0, {"latent_frames": 128}, {"segment_samples": 2048})


@pytest.fixture
def pink_noise():
    return _pink_noise


@pytest.fixture
def recorded_warnings():
    return _recorded_warnings


@pytest.fixture(scope="session")
def prepared(tmp_path_factory):
    """Nobody writes to it; recordings are beside it, r.h5."""
    folder = tmp_path_factory.mktemp("data")
    generate_recordings(folder / "r.h5", surfaces=8, seconds=15, explorers=2, seed=4, quiet=True)
    limits = SegmentLimits(seconds=2048 / 2500)  # those of `evaluable_pipe`
    prepare_recordings(folder / "r.h5", folder / "p.h5", limits=limits, validation=3, test=2, quiet=True)
    return folder / "p.h5"


@pytest.fixture
def checkpoint(evaluable_pipe, tmp_path):
    evaluable_pipe().save_pretrained(str(tmp_path / "pipeline"))
    return tmp_path / "pipeline"


def _make_recording(seconds=4.0, normal_force=0.5, speed=80.0, friction=0.6, heading=0.0, seed=0):
    """A steady slide with white noise on the friction: keyword arguments of `add_recording`."""
    rng = np.random.default_rng(seed)
    samples = int(seconds * DEVICE_RATE)
    lateral = friction * normal_force + 0.01 * rng.standard_normal(samples)
    force = np.stack([lateral * np.cos(heading), lateral * np.sin(heading), np.full(samples, normal_force)], axis=-1)
    direction = np.array([np.cos(heading), np.sin(heading)])
    velocity = np.tile(speed * direction, (int(seconds * _VELOCITY_RATE), 1))
    return dict(force=force, force_rate=DEVICE_RATE, velocity=velocity, velocity_rate=_VELOCITY_RATE)


def _write_recordings(path, recordings, ratings=None):
    """Writes {surface: keyword arguments of `add_recording`}; `ratings` is (raters, surfaces, 3)."""
    with RecordingsWriter(path, source="a test", licence="CC0-1.0") as writer:
        for surface, recording in recordings.items():
            writer.add_recording(surface, "explorer", "0", **recording)
        if ratings is not None:
            writer.set_ratings(ratings, [f"r{i}" for i in range(len(ratings))], list(recordings), RATING_AXES)
    return path


@pytest.fixture
def recording_maker():
    return _make_recording


@pytest.fixture
def recordings_writer():
    return _write_recordings


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


class _Lives:
    """Scripts in forks of a process that has imported everything (`lives.py`), one after the other, to be killed."""

    def __init__(self):
        words = [sys.executable, str(Path(__file__).parent / "lives.py")]
        environment = {**os.environ, "CUDA_VISIBLE_DEVICES": "", "OMP_NUM_THREADS": "1"}
        self.server = subprocess.Popen(words, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._answer() == "ready"

    def _answer(self):
        return self.server.stdout.readline().strip()

    def _ask(self, line):
        self.server.stdin.write(line + "\n")
        self.server.stdin.flush()

    def start(self, script, words, log):
        """Starts `main(words)` of a script (path) in a process; what it prints is added to the file `log`."""
        self._ask(json.dumps({"script": str(script), "words": [str(word) for word in words], "log": str(log)}))
        self.pid = int(self._answer())

    def ended(self, seconds=0.0):
        """Whether it ends by itself within so many seconds."""
        return bool(select.select([self.server.stdout], [], [], seconds)[0])

    def kill(self):
        os.kill(self.pid, signal.SIGKILL)

    def wait(self):
        """Waits for its end and returns its exit code, negative = of a signal."""
        assert self._answer() == "ended"
        self._ask("")
        return int(self._answer())


@pytest.fixture(scope="session")
def lives():
    if not hasattr(os, "fork"):
        pytest.skip("needs fork")
    server = _Lives()
    yield server
    server.server.stdin.close()
    server.server.wait()
