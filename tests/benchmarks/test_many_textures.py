"""The benchmark of many textures: figures from the times of shards."""

import numpy as np
import pytest
from many_textures import SHARD, growth, main


def test_proportional_growth_of_two_processes():
    # each makes a shard in 4 s; they take turns, and the second begins 1 s later
    finished = np.stack([100 + 4.0 * np.arange(10), 101 + 4.0 * np.arange(10)], axis=1).ravel()
    found = growth(finished, 20 * SHARD, 2)
    assert found["textures a second"] == pytest.approx(2 * SHARD / 4)
    assert found["hours for 100,000"] == pytest.approx(1e5 / (2 * SHARD / 4) / 3600)
    assert found["departure from proportion"] == pytest.approx(0, abs=1e-6)


def test_growth_that_is_not_proportional_shows():
    finished = np.cumsum(np.linspace(1, 3, 20))
    assert growth(finished, 20 * SHARD, 1)["departure from proportion"] > 0.05


def test_too_few(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(f"--textures 10 --output {tmp_path}".split())
    assert "--textures: must be at least" in capsys.readouterr().err
