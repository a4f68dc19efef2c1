"""Windows from another process: those of this one, as quickly given up, and an error if the process is gone."""

import gc
import sys
import time
from multiprocessing import Pipe
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from tactile_diffusers import TactileTexturePipeline
from tactile_diffusers.playback import EndlessProfile, EndlessStream, GeneratingProcess, on_time

RATINGS = [0.5, 0.0, -0.5]


@pytest.fixture(scope="module")
def process():
    folder = Path(__file__).parents[1] / "fixtures" / "tiny_pipeline"
    with GeneratingProcess(TactileTexturePipeline.from_pretrained(str(folder))) as process:
        yield process


def _read(profile, begin, end):
    speed = profile.reference_speed
    return profile.read(np.linspace(begin, end, 400) * profile.spacing - profile.window_length / 2, np.full(400, speed))


def test_windows_are_those_of_this_process(process):
    there, here = EndlessProfile(process, RATINGS, 3), EndlessProfile(process.pipe, RATINGS, 3)
    for profile in (there, here):
        profile.generate(0, 1)
    assert there.level == pytest.approx(here.level)
    # the other process computes with other threads: the last bits of float32 differ
    assert there.friction_coefficient == pytest.approx(here.friction_coefficient, rel=1e-6)
    assert sorted(there.windows) == [0, 1]
    np.testing.assert_allclose(_read(there, 0.3, 1.9), _read(here, 0.3, 1.9), rtol=0, atol=1e-6)


def test_several_profiles_take_turns(process):
    first, second = (EndlessProfile(process, RATINGS, seed) for seed in (1, 2))
    for index in range(3):
        first.generate(index)
        second.generate(index)
    assert sorted(first.windows) == sorted(second.windows) == [0, 1, 2]
    assert first.level != second.level
    again = EndlessProfile(process, RATINGS, 1)
    again.generate(2)
    np.testing.assert_allclose(_read(again, 2.3, 2.9), _read(first, 2.3, 2.9), rtol=0, atol=1e-6)


@pytest.mark.parametrize("wait", [False, True])
def test_a_stream_changes_its_ratings(process, wait):
    with EndlessStream(EndlessProfile(process, RATINGS, wait=wait), 125.0) as stream:
        before, deadline = stream.profile, time.monotonic() + 20
        stream.change([-1.0, 1.0, 1.0])
        while stream.profile is before:
            assert np.isfinite(stream.read(32)).all() and time.monotonic() < deadline
        assert stream.profile.ratings.tolist() == [[-1.0, 1.0, 1.0]]


def test_what_is_interrupted_leaves_nothing_half_made(process, monkeypatch):
    profile, send = EndlessProfile(process, RATINGS, num_latent_inference_steps=1000), process._connection.send

    def send_and_interrupt(request):
        send(request)
        time.sleep(0.3)
        profile.interrupt()

    monkeypatch.setattr(process, "_connection", SimpleNamespace(send=send_and_interrupt, recv=process._connection.recv))
    profile.generate(0)
    assert profile.windows == {}


def test_a_failure_there_is_raised_here(process):
    with pytest.raises(RuntimeError, match="Generating has failed: .*not a number"):
        process._generate(-1, ("not a number", 0, True, {}), "generate", [0])
    profile = EndlessProfile(process, RATINGS)
    profile.generate(0)
    assert list(profile.windows) == [0]


def test_an_ended_process_says_so(process, monkeypatch):
    profile, (ours, theirs) = EndlessProfile(process, RATINGS), Pipe()
    theirs.close()  # as the end of a process does
    monkeypatch.setattr(process, "_connection", ours)
    with pytest.raises(RuntimeError, match="The generating process has ended"):
        profile.generate(0)
    with pytest.raises(RuntimeError, match="The generating process has ended"):
        process._receive()


def test_it_needs_a_core():
    with pytest.raises(ValueError, match="`threads` must be a whole number of at least 1, got 0"):
        GeneratingProcess(None, threads=0)


def test_on_time_leaves_everything_as_it_was():
    interval, threads, frozen = sys.getswitchinterval(), torch.get_num_threads(), gc.get_freeze_count()
    with pytest.raises(KeyError), on_time():
        assert sys.getswitchinterval() == pytest.approx(5e-4) and gc.get_freeze_count() > frozen
        assert torch.get_num_threads() == max(1, threads - 1)
        raise KeyError
    assert (sys.getswitchinterval(), torch.get_num_threads(), gc.get_freeze_count()) == (interval, threads, frozen)
