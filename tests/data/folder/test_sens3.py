"""SENS3: the template names what is to be filled in, and a made-up folder of its kind is converted."""

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tactile_diffusers.data import RecordingsFile
from tactile_diffusers.data.folder import convert_folder, load_layout
from tactile_diffusers.signal import DEVICE_RATE

LAYOUT = Path(__file__).parents[3] / "examples/configs/sens3_layout.toml"
#: What somebody would write in place of each TODO, in the order of the template.
ANSWERS = (
    *("sliding/{surface}/P{explorer}_{trial}_force.csv", "csv", "Fx", "Fy", "Fz", "N", -1),
    *("sliding/{surface}/P{explorer}_{trial}_pos.csv", "csv", 500, "px", "py", "mm"),
    *("ratings.csv", "csv", "participant", "texture"),
    *("rough-smooth", "smooth", "flat-bumpy", "bumpy", "sticky-slippery", "slippery"),
)


def filled(folder):
    answers = iter(ANSWERS)
    text = re.sub('"TODO[^"]*"', lambda _: json.dumps(next(answers)), LAYOUT.read_text())
    assert next(answers, None) is None
    (folder / "layout.toml").write_text(text)
    return folder / "layout.toml"


@pytest.fixture
def folder(tmp_path):
    rng = np.random.default_rng(0)
    time = np.arange(2 * DEVICE_RATE) / DEVICE_RATE
    lateral = 0.3 + 0.01 * rng.standard_normal(len(time))
    for surface in ("01", "02"):
        (tmp_path / "sliding" / surface).mkdir(parents=True)
        force = pd.DataFrame({"Fx": lateral, "Fy": 0 * lateral, "Fz": -0.5 - 0.1 * lateral})
        force.to_csv(tmp_path / "sliding" / surface / "P1_1_force.csv", index=False)
        position = pd.DataFrame({"px": 80 * time[::20], "py": 0 * time[::20]})
        position.to_csv(tmp_path / "sliding" / surface / "P1_1_pos.csv", index=False)
    names = ["rough-smooth", "flat-bumpy", "sticky-slippery"]
    rows = [[f"R{r}", surface, *rng.integers(0, 9, 3)] for r in range(12) for surface in ("01", "02")]
    pd.DataFrame(rows, columns=["participant", "texture", *names]).to_csv(tmp_path / "ratings.csv", index=False)
    return tmp_path


def test_the_template_names_what_is_to_be_filled_in(tmp_path):
    (tmp_path / "layout.toml").write_text(LAYOUT.read_text())
    with pytest.raises(ValueError, match=r"`\[\[files\]\] 1, pattern` = 'TODO: .*' is still to be filled in"):
        convert_folder(tmp_path, tmp_path / "layout.toml", tmp_path / "r.h5", quiet=True)


def test_a_folder_of_its_kind(folder):
    layout = load_layout(filled(folder))
    assert layout.source == "SENS3 (www.sens3.net, arXiv 2401.01818)" and "SENS3" in layout.licence
    convert_folder(folder, folder / "layout.toml", folder / "r.h5", quiet=True)
    table = pd.read_csv(folder / "ratings.csv", dtype={"texture": str})
    with RecordingsFile(folder / "r.h5") as file:
        recording = file.read("01/1/1")
        scores = file.ratings
    assert recording.rate == DEVICE_RATE and recording.velocity_rate == 500
    np.testing.assert_allclose(recording.velocity[:, 0], 80, rtol=1e-4)
    assert (recording.force[:, 2] > 0.4).all()  # pressing is positive
    first = table[table["participant"] == "R0"]
    np.testing.assert_array_equal(scores.values[0, :, 0], 8 - first["rough-smooth"])
    np.testing.assert_array_equal(scores.values[0, :, 2], first["sticky-slippery"])
