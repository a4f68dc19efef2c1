"""The benchmarks of playback: what they measure is real, and they refuse what is impossible."""

import json

import endless as benchmark_endless
import pytest
import stream as benchmark_stream


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(benchmark_stream, "SPEEDS", (80.0, 160.0))
    monkeypatch.setattr(benchmark_stream, "SENSORS", ((125.0, 0.1), (125.0, 1.0)))
    monkeypatch.setattr(benchmark_endless, "RATINGS", benchmark_endless.RATINGS[:2])
    monkeypatch.setattr(benchmark_endless, "WINDOWS", 5)
    monkeypatch.setattr(benchmark_endless, "TIMES", 1)
    monkeypatch.setattr(benchmark_endless, "CHANGE_SECONDS", 0.5)


@pytest.mark.slow
def test_playback_in_space(small, tmp_path, capsys):
    words = f"--surfaces 2 --minutes 0.02 --quiet --output {tmp_path}"
    assert benchmark_stream.main(words.split()) == 0
    report = json.loads((tmp_path / "stream.json").read_text())
    classes = [rows for group, rows in report["recordings"].items() if group.startswith("with")]
    assert sum(rows["surfaces"] for rows in classes) == 2
    for rows in classes:
        # at the recorded speed a profile is the recording; elsewhere a signal that knows no speed is worse
        assert rows["profile"]["80 mm/s"] < 1.5
        assert rows["profile"]["160 mm/s"] < rows["time signal, whatever the speed"]["160 mm/s"]
    fine, coarse = report["sensors"]["125 Hz, 0.1 mm"], report["sensors"]["125 Hz, 1 mm"]
    assert fine["spurious dB"] < -15 and coarse["spurious dB"] > fine["spurious dB"] + 6
    assert report["clock"]["finite"] and report["clock"]["median ms"] > 0
    assert (tmp_path / "stream.md").read_text().strip() == capsys.readouterr().out.strip()


@pytest.mark.slow
def test_textures_without_end(small, tmp_path, capsys):
    assert benchmark_endless.main(f"--minutes 0.02 --quiet --output {tmp_path}".split()) == 0
    report = json.loads((tmp_path / "endless.json").read_text())
    # neighbours are decoded from the same latents and noise where they meet
    assert report["joints"]["correlation of two windows"] > 0.95
    for row in report["starts"].values():
        assert 0 < row["first sample ms"] and 20 < row["change felt ms"] <= row["slowest change ms"]
    assert len(report["starts"]) == 3
    for way in ("in a thread", "in a process"):
        endless = report["real time"][way]
        assert endless["finite"] and endless["median ms"] > 0 and endless["largest step mN"] > 0
    assert report["real time"]["waking, of the machine"]["largest ms"] > 0
    assert (tmp_path / "endless.md").read_text().strip() == capsys.readouterr().out.strip()
