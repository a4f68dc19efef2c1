"""What a first layout gets wrong: units of position and time are named before anything is computed from them."""

import numpy as np
import pandas as pd
import pytest

from tactile_diffusers.data.folder import convert_folder
from tactile_diffusers.data.folder.lag import residual_lag

HEAD = 'format = "tactile-layout"\nversion = 1\nsource = "a rig"\nlicence = "CC0-1.0"\n'
FILES = """
[[files]]
pattern = "{surface}.csv"
time = { column = "t", unit = "s" }
force = { x = "fx", y = "fy", z = "fz", unit = "N" }
position = { x = "px", unit = "mm" }
"""


@pytest.fixture
def convert(tmp_path):
    """Strokes of 60 mm at 80 mm/s, 0.5 N; a function that converts them by a changed layout."""
    (tmp_path / "root").mkdir()
    time = np.arange(4000) / 1000
    path = 80 * time % 120
    rng = np.random.default_rng(0)
    columns = {"t": time, "fx": rng.normal(0.3, 0.02, len(time)), "fy": 0.01 * time, "fz": 0.5 + 0.01 * np.sin(time)}
    pd.DataFrame(columns | {"px": np.minimum(path, 120 - path)}).to_csv(tmp_path / "root" / "felt.csv", index=False)

    def convert(old="", new=""):
        (tmp_path / "layout.toml").write_text(HEAD + FILES.replace(old, new))
        return convert_folder(tmp_path / "root", tmp_path / "layout.toml", tmp_path / "r.h5", quiet=True)

    return convert


def test_metres_for_millimetres_stop_the_conversion(convert, tmp_path):
    assert convert().recordings == 1
    (tmp_path / "r.h5").unlink()
    with pytest.raises(ValueError, match=r"felt.csv: with `unit` = 'm' the positions span 5\d,\d{3} mm"):
        convert('"mm"', '"m"')
    with pytest.raises(ValueError, match=r"`unit` = 'm/s' of `velocity` the median speed is \d\d,\d{3} mm/s"):
        convert('position = { x = "px", unit = "mm" }', 'velocity = { x = "px", unit = "m/s" }')
    assert not (tmp_path / "r.h5").exists()


def test_a_way_that_is_too_long_tells_no_lag():
    """Tracking that jumps by kilometres: the steps of the way would fill the memory."""
    velocity = np.random.default_rng(0).normal(0, 80, (2000, 2))
    velocity[1000] = 1e12
    assert residual_lag(velocity, 500, velocity, 500) is None


def test_millinewtons_for_newtons_are_noted_at_conversion(convert):
    kind = "recordings with a median normal force outside (0.01, 30.0) N: is the unit right?"
    assert not convert().notes
    count, first = convert('"N"', '"mN"').notes[kind]
    assert count == 1 and first.endswith("(0.00051 N)")
