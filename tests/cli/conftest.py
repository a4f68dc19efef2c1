"""Prepared data and a tiny pipeline for the commands that take both."""

import pytest

from tactile_diffusers.data import SegmentLimits, generate_recordings, prepare_recordings


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
