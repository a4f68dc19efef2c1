"""The benchmark of loading data, on a tiny pipeline: every figure is there; how large it is, no test tells."""

import json
import math

import data_loading as benchmark_data
import pytest

from tactile_diffusers.data import SegmentLimits, prepare_recordings
from tactile_diffusers.virtual import generate_recordings

COLUMNS = {"random textures /s", "batches /s", "batches, 2 workers /s"}


@pytest.fixture
def recordings(tmp_path):
    generate_recordings(tmp_path / "r.h5", surfaces=5, seconds=8, explorers=1, seed=4, quiet=True)
    return tmp_path / "r.h5"


@pytest.mark.slow
def test_every_figure_is_reported(evaluable_pipe, recordings, tmp_path, monkeypatch):
    monkeypatch.setattr(benchmark_data, "MEASURED_SECONDS", 0.01)
    limits = SegmentLimits(None, None, seconds=2048 / 2500)  # as long as those of the tiny pipeline
    prepare_recordings(recordings, tmp_path / "p.h5", limits, validation=0, test=0, quiet=True)
    evaluable_pipe().save_pretrained(str(tmp_path / "pipeline"))
    words = f"--checkpoint {tmp_path / 'pipeline'} --recordings {recordings} --data {tmp_path / 'p.h5'} --quiet"
    assert benchmark_data.main([*words.split(), "--output", str(tmp_path / "out")]) == 0
    report = json.loads((tmp_path / "out" / "data.json").read_text())
    assert "#### Loading against training" in (tmp_path / "out" / "data.md").read_text()
    preparation = report["preparation"]
    assert preparation["recorded s"] == pytest.approx(40)
    assert preparation["seconds for 22000"] == pytest.approx(preparation["seconds"] * 22_000 / preparation["segments"])
    assert set(report["loading"]) == {"10000 Hz", "2500 Hz"} and set(report["training"]) == {"LCTG", "DALE"}
    assert all(row.keys() >= COLUMNS for row in report["loading"].values())
    for row in report["training"].values():
        assert row["times as fast"] == pytest.approx(row["loader gives /s"] / row["training takes /s"])
    numbers = [value for part in ("loading", "training") for row in report[part].values() for value in row.values()]
    assert all(math.isfinite(value) and value > 0 for value in numbers)
