"""What a first layout gets wrong: units of position and time are named before anything is computed from them."""

import numpy as np
import pandas as pd
import pytest

from tactile_diffusers.data import RecordingsFile
from tactile_diffusers.data.folder import convert_folder

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
    with pytest.raises(ValueError, match=r"felt.csv: with `unit` = 'm' of `position` .* \d\d,\d{3} mm/s"):
        convert('"mm"', '"m"')
    with pytest.raises(ValueError, match=r"`unit` = 'm/s' of `velocity` the median speed is \d\d,\d{3} mm/s"):
        convert('position = { x = "px", unit = "mm" }', 'velocity = { x = "px", unit = "m/s" }')
    assert not (tmp_path / "r.h5").exists()


BATCH = FILES.replace('"{surface}.csv"', '"{surface}/P{explorer}_{trial}.csv"').replace("fz", "fz_N")
ODD = BATCH.replace("fz_N", "fz_mN")


@pytest.fixture
def batch(convert, tmp_path):
    """Three surfaces, two explorers, two trials; of one surface and explorer another column has the normal force."""
    table = pd.read_csv(tmp_path / "root" / "felt.csv")
    (tmp_path / "root" / "felt.csv").unlink()
    for surface in ("cork", "denim", "felt"):
        (tmp_path / "root" / surface).mkdir()
        for explorer in ("01", "02"):
            odd = (surface, explorer) == ("denim", "02")
            renamed = table.rename(columns={"fz": "fz_mN" if odd else "fz_N"})
            for trial in "12":
                renamed.to_csv(tmp_path / "root" / surface / f"P{explorer}_{trial}.csv", index=False)

    def convert(files):
        (tmp_path / "layout.toml").write_text(HEAD + files)
        return convert_folder(tmp_path / "root", tmp_path / "layout.toml", tmp_path / "r.h5", quiet=True)

    return convert


@pytest.mark.parametrize("pattern", ["{surface}/P{explorer}_{trial}.csv", "denim/P02_{trial}.csv"])
def test_an_odd_batch_has_an_entry_of_its_own(batch, tmp_path, pattern):
    with pytest.raises(ValueError, match="denim/P02_1.csv has no column 'fz_N'.*own, with `where`"):
        batch(BATCH)
    where = f'pattern = "{pattern}"\nwhere = {{ surface = "denim", explorer = "02" }}'
    odd = ODD.replace('pattern = "{surface}/P{explorer}_{trial}.csv"', where)
    for files in (BATCH + odd, odd + BATCH):
        assert batch(files).recordings == 12
        with RecordingsFile(tmp_path / "r.h5") as file:
            assert {"denim/01/1", "denim/02/2", "cork/02/1"} <= set(file.names)
    with pytest.raises(ValueError, match=r"2: no file that `pattern` matches has `where` = \{'surface': 'silk'"):
        batch(BATCH + odd.replace('"denim", e', '"silk", e').replace("denim/P02", "{surface}/P02"))
    with pytest.raises(ValueError, match="where.surfce` = 'surfce': Input should be 'surface', 'explorer' or 'trial'"):
        batch(BATCH + odd.replace("surface =", "surfce =").replace("denim/P02", "{surface}/P02"))


def test_two_rates_are_told_and_brought_to_one(convert, tmp_path):
    """Every second sample of another surface: noted, and resampled; a gap stays one."""
    table = pd.read_csv(tmp_path / "root" / "felt.csv")
    smooth = table.assign(fx=0.3 + 0.1 * np.sin(2 * np.pi * 20 * table["t"]))
    smooth[::2].assign(fz=smooth["fz"].where((smooth.index < 1000) | (smooth.index >= 1100))).to_csv(
        tmp_path / "root" / "wood.csv", index=False
    )
    report = convert()
    assert report.rates == [1000, 500] and "a prepared data set needs one rate of force" in str(report)
    report = convert("force =", "resample = 1000\nforce =")
    assert report.rates == [1000] and report.notes["recordings resampled to 1000 Hz"][0] == 1
    with RecordingsFile(tmp_path / "r.h5") as file:
        force = file.read("wood/0/0").force
        assert (file.read("felt/0/0").force[:, 0] == np.float32(table["fx"])).all()
    missing = np.isnan(force).any(axis=1)
    assert missing[1000:1099].all() and missing.sum() <= 101 and len(force) == 4000
    middle = ~missing & (smooth["t"] > 0.2) & (smooth["t"] < 3.8)
    np.testing.assert_allclose(force[middle, 0], smooth["fx"][middle], atol=1e-3)
    np.testing.assert_allclose(force[~missing, 2].mean(), 0.5, atol=0.01)
    for old, new in (("force =", "resample = 0.5\nforce ="), ("position", "resample = 99.5\nposition")):
        with pytest.raises(ValueError, match="resample` = .*: Input should be a multiple of 1"):
            convert(old, new)
