"""Names of files as patterns, and units in names of columns: pure text."""

import pytest

from tactile_diffusers.data.folder.draft_names import assign_roles, group_names
from tactile_diffusers.data.folder.draft_tables import split_unit
from tactile_diffusers.data.folder.rating_tables import pair_names
from tactile_diffusers.data.folder.sources import Pattern

NAMES = {
    "sliding/{surface}/P{explorer}_force.csv": [
        f"sliding/texture_{t:02d}/P{p}_force.csv" for t in range(5) for p in "12"
    ],
    "data/force/{surface}_{trial.1}_{trial.2}_500_{trial.3}.csv": [
        f"data/force/{t}_{d}_{v}_500_{r}.csv" for t in range(9) for d in (0, 45) for v in (20, 40) for r in "01"
    ],
    "{surface}/{explorer}/0_force_10000Hz.npy": [
        f"{s}/explorer-0/0_force_10000Hz.npy" for s in ("00-glass", "01-felt")
    ],
    "textures/{surface}/S{explorer}_run{trial}.mat": [
        f"textures/{s}/S{p}_run{r}.mat" for s in "ABC" for p in "12" for r in "12"
    ],
    "{explorer}/texture_{surface}.csv": [f"S{p}/texture_{s}.csv" for s in range(3) for p in (1, 2)],  # S: the subject
    "{surface}/S{explorer}.csv": [f"{s}/S{p}.csv" for s in ("felt", "cork") for p in (1, 2)],
    "{surface}_{trial}.wav": [f"{s}_{r}.wav" for s in ("felt", "cork", "Sandpaper80") for r in (1, 2)],
    "mat{surface}_v{trial}mms.txt": [f"mat{m}_v{v}mms.txt" for m in range(4) for v in (20, 40)],
    "{surface}/P{explorer}.csv": [f"{s}/P1.csv" for s in ("rough felt", "cork", "Sandpaper_P80")],
    "{surface}/P{explorer}_run{trial}/a.csv": [f"{s}/P{p}_run{r}/a.csv" for s in "AB" for p in "12" for r in "12"],
    "my_study_{surface}_{trial}.csv": [f"my_study_{s}_{r}.csv" for s in ("felt", "cork") for r in (1, 2)],
    "{trial}/{surface}/subject {explorer}.mat": [
        f"trial{t}/{s}/subject {p}.mat" for t in (1, 2) for s in ("Sandpaper", "wood grain") for p in (3, 15)
    ],
    "a*b*1*/x{surface}.csv": ["a*b{1}/x1.csv", "a*b{1}/x2.csv"],
}


@pytest.mark.parametrize("pattern", NAMES)
def test_names_become_a_pattern(pattern):
    (group,) = group_names(NAMES[pattern])
    assign_roles(group.fields)
    assert group.pattern == pattern
    surface = next(item for item in group.fields if item.role == "surface")
    assert [Pattern(pattern).match(name)["surface"] for name in group.names] == surface.values


def test_words_of_content_separate_kinds():
    names = [f"data/texture_{number}/{kind}" for kind in ("force", "vel") for number in (1, 2)]
    assert [group.pattern for group in group_names(names)] == ["data/*/force", "data/*/vel"]
    assert len(group_names(["ratings.csv", "forces.csv"])) == 2


def test_names_that_differ_are_paired():
    assert pair_names(["1", "2"], ["texture_01", "texture_02"]) == {"1": "texture_01", "2": "texture_02"}
    assert pair_names(["Fine Felt"], ["fine_felt", "cork"]) == {"Fine Felt": "fine_felt"}
    assert pair_names(["Sandpaper P80", "x"], ["12", "13"]) == {"Sandpaper P80": "", "x": ""}


#: Name of a column, the name without its unit, and the unit; "F_N" is the normal force, not newtons.
COLUMNS = """\
Fx [N] | Fx | N
fz (mN) | fz | mN
time_ms | time | ms
vx_mm_s | vx | mm/s
pos_x_mm | pos_x | mm
Normal force / N | Normal force | N
position x in µm | position x | um
speed mm/s | speed | mm/s
T [°C] | T | °C
fx_counts | fx | 1
F_N | F_N |
rough-smooth | rough-smooth |
x | x |
"""


@pytest.mark.parametrize("row", COLUMNS.splitlines())
def test_units_in_names(row):
    name, base, unit = map(str.strip, row.split("|"))
    assert split_unit(name) == (base, unit or None)
