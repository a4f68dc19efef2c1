"""The study of sensitivity: what it measures, and that it runs and resumes."""

import json

import numpy as np
import pytest
import sensitivity

from tactile_diffusers.signal import DEVICE_RATE


def test_measures_of_a_sine():
    time = np.arange(2 * DEVICE_RATE) / DEVICE_RATE
    textures = 0.01 * np.sqrt(2) * np.sin(2 * np.pi * 128 * time)[None]
    level, centroid, friction, kurtosis = sensitivity.measure(textures, np.array([0.5]))[0]
    assert level == pytest.approx(-40, abs=0.01) and centroid == pytest.approx(7, abs=0.01)
    assert friction == pytest.approx(np.log(0.5)) and np.exp(kurtosis) == pytest.approx(1.5, abs=0.01)


@pytest.mark.slow
def test_it_runs_and_resumes(tmp_path, capsys):
    size = "--surfaces 14 --seconds 5 --steps 2 --takes 2".split()
    assert sensitivity.main(["--output", str(tmp_path), *size]) == 0
    stored = json.loads((tmp_path / "sensitivity.json").read_text())
    assert len(stored["worlds"]) == len(sensitivity.worlds())
    assert "impulsiveness" in (tmp_path / "sensitivity.md").read_text()
    written = (tmp_path / "sensitivity.json").stat().st_mtime_ns
    assert sensitivity.main(["--output", str(tmp_path), *size]) == 0
    assert (tmp_path / "sensitivity.json").stat().st_mtime_ns == written
    with pytest.raises(SystemExit):
        sensitivity.main(["--output", str(tmp_path), *size[:-1], "3"])
    assert "holds another study" in capsys.readouterr().err
