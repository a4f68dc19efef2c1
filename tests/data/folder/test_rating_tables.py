"""Tables of answers, long and wide: the same scores from every form, and faults named by file and line."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tactile_diffusers.data.folder import load_layout
from tactile_diffusers.data.folder.rating_tables import read_ratings

SURFACES = ("felt", "glass", "wood")
RATERS = ("ann", "bob")
#: (raters, surfaces, axes) on a 0-8 scale; NaN = missing, and bob has not touched glass.
SCORES = np.array([[[1, 2, 8], [0, 0, 4], [7, 8, 1]], [[2, 3, 7], [np.nan] * 3, [6, np.nan, 0]]], dtype=np.float32)
AXES = ("roughness", "bumpiness", "slipperiness")
HEAD = """format = "tactile-layout"
version = 1
source = "a rig"
licence = "CC0-1.0"
[[files]]
pattern = "{surface}.wav"
lateral = { column = 0, unit = "N" }
[ratings]
scale = [0, 8]
"""
COLUMNS = """
[ratings.axes]
roughness = { column = "rough", high = "rough" }
bumpiness = { column = "bumpy", high = "bumpy", words = ["flat", "bumpy"] }
slipperiness = { column = "slippery", high = "slippery" }
"""
LONG = 'pattern = "ratings.csv"\nform = "long"\nrater = "rater"\nsurface = "surface"\n'


def long_table(scores=SCORES):
    rows = [[rater, surface, *scores[r, s]] for r, rater in enumerate(RATERS) for s, surface in enumerate(SURFACES)]
    return pd.DataFrame(rows, columns=["rater", "surface", "rough", "bumpy", "slippery"]).dropna(thresh=3)


@pytest.fixture
def read(tmp_path):
    def read(described, surfaces=SURFACES, axes=COLUMNS, more="", scale=(0, 8)):
        head = HEAD.replace("[0, 8]", str(list(scale)))
        (tmp_path / "layout.toml").write_text(head + described + axes + more)
        return read_ratings(tmp_path, load_layout(tmp_path / "layout.toml"), surfaces)

    return read


def assert_scores(scores, expected=SCORES):
    assert (scores.raters, scores.surfaces, scores.axes) == (RATERS, SURFACES, AXES)
    assert scores.values.dtype == np.float32
    np.testing.assert_array_equal(scores.values, expected)


def test_long_with_a_column_an_axis(tmp_path, read):
    long_table().to_csv(tmp_path / "ratings.csv", index=False)
    scores, notes = read(LONG)
    assert_scores(scores)
    assert notes == ["4 of 18 answers (raters x surfaces x axes) are missing"]


@pytest.mark.parametrize("missing", ["", "NA", "-", "nan"])
def test_missing_answers(tmp_path, read, missing):
    long_table().to_csv(tmp_path / "ratings.csv", index=False, na_rep=missing)
    if missing == "nan":
        with pytest.raises(ValueError, match=r"ratings.csv, line 6: the answer 'nan' on bumpiness is no number"):
            read(LONG)
    else:
        assert_scores(read(LONG)[0])


def test_long_with_a_row_an_answer(tmp_path, read):
    table = long_table().melt(["rater", "surface"], var_name="axis", value_name="answer").dropna()
    other = table.assign(axis="warm")
    pd.concat([table, other]).to_csv(tmp_path / "ratings.csv", index=False)
    scores, notes = read(LONG + 'axis = "axis"\nanswer = "answer"\n')
    assert_scores(scores)
    assert notes[-1] == "axes that the layout does not name are ignored: 'warm'"


def test_long_files_of_raters_and_axes(tmp_path, read):
    for rater, table in long_table().groupby("rater"):
        table.drop(columns="rater").to_csv(tmp_path / f"by_{rater}.csv", index=False)
    assert_scores(read('pattern = "by_{rater}.csv"\nform = "long"\nsurface = "surface"\n')[0])
    for axis in ("rough", "bumpy", "slippery"):
        table = long_table()[["rater", "surface", axis]].rename(columns={axis: "answer"})
        table.to_csv(tmp_path / f"on_{axis}.csv", index=False)
    described = 'pattern = "on_{axis}.csv"\nform = "long"\nrater = "rater"\nsurface = 1\nanswer = "answer"\n'
    assert_scores(read(described)[0])


@pytest.mark.parametrize("rows", ["rater", "surface"])
@pytest.mark.parametrize("kind", ["csv", "xlsx"])
def test_wide(tmp_path, read, rows, kind):
    """One table an axis: files, or sheets of a workbook."""
    columns = {"rater": "surface", "surface": "rater"}[rows]
    tables = {
        axis: long_table().pivot(index=rows, columns=columns, values=axis) for axis in ("rough", "bumpy", "slippery")
    }
    form = f'form = "wide"\nrows = "{rows}"\ncolumns = "{columns}"\n'
    if kind == "csv":
        for axis, table in tables.items():
            table.to_csv(tmp_path / f"{axis}.csv")
        assert_scores(read('pattern = "{axis}.csv"\n' + form)[0])
    else:
        with pd.ExcelWriter(tmp_path / "ratings.xlsx") as book:
            for axis, table in tables.items():
                table.to_excel(book, sheet_name=axis)
        assert_scores(read('pattern = "ratings.xlsx"\nsheet = "{axis}"\n' + form)[0])


@settings(max_examples=40, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(low=st.integers(-5, 5), points=st.integers(2, 101), turned=st.booleans(), data=st.data())
def test_scale_and_direction(tmp_path, read, low, points, turned, data):
    """The scale goes linearly to 0-8, and an axis whose largest number means our low word is turned round."""
    answers = data.draw(st.lists(st.integers(low, low + points - 1), min_size=3, max_size=3))
    lines = [f"ann,{surface},{answer}" for surface, answer in zip(SURFACES, answers, strict=True)]
    (tmp_path / "ratings.csv").write_text("rater,surface,rough\n" + "\n".join(lines) + "\n")
    word = "smooth" if turned else "rough"
    axes = f'[ratings.axes]\nroughness = {{ column = "rough", high = "{word}" }}\n'
    scores, notes = read(LONG, axes=axes, scale=(low, low + points - 1))
    share = (np.array(answers) - low) / (points - 1)
    expected = np.float32(8 * (1 - share if turned else share))
    np.testing.assert_array_equal(scores.values[0, :, 0], expected)
    assert notes == ["the layout names no bumpiness and no slipperiness"]


def test_words_in_any_order_and_further_axes(tmp_path, read):
    long_table().assign(hard=5).to_csv(tmp_path / "ratings.csv", index=False)
    axes = COLUMNS.replace('high = "rough"', 'high = "smooth", words = ["rough", "smooth"]')
    axes += 'hardness = { column = "hard", high = "soft", words = ["hard", "soft"] }\n'
    scores, _ = read(LONG, axes=axes)
    assert scores.axes == (*AXES, "hardness")
    np.testing.assert_array_equal(scores.values[:, :, 0], 8 - SCORES[:, :, 0])
    assert scores.values[0, 0, 3] == 5


@pytest.mark.parametrize(
    "line, text, message",
    [
        (3, "ann,glass,9,0,4", r"1 answers lie outside `scale` = \[0, 8\]: 9 at .*ratings.csv, line 3"),
        (3, "ann,glass,4,often,4", "ratings.csv, line 3: the answer 'often' on bumpiness is no number"),
        (3, "ann,felt,4,4,4", "line 3: roughness of surface 'felt' by 'ann' was answered before, at .*, line 2"),
        (3, ",glass,4,4,4", "ratings.csv, line 3: the answer '4' on roughness has no rater"),
        (3, "ann,,4,4,4", "ratings.csv, line 3: the answer '4' on roughness has no surface"),
        (1, "rater,surface,rough,bump,slippery", "ratings.csv has no column 'bumpy'.*Did you mean 'bump'"),
    ],
)
def test_faults_are_named_by_line(tmp_path, read, line, text, message):
    lines = long_table().to_csv(index=False).splitlines()
    lines[line - 1] = text
    (tmp_path / "ratings.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(ValueError, match=message):
        read(LONG)
    with pytest.raises(ValueError, match=r"\[ratings\], `pattern` = 'rating.csv' matches none of the .*'ratings.csv'"):
        read(LONG.replace("ratings.csv", "rating.csv"))


def test_an_axis_without_answers(tmp_path, read):
    table = long_table().melt(["rater", "surface"], var_name="axis", value_name="answer").dropna()
    table.replace({"axis": {"bumpy": "flat-bumpy"}}).to_csv(tmp_path / "ratings.csv", index=False)
    with pytest.raises(ValueError, match="bumpiness = 'bumpy' has no answer; the tables have 'flat-bumpy'"):
        read(LONG + 'axis = "axis"\nanswer = "answer"\n')


def test_names_that_match_on_neither_side(tmp_path, read):
    """Nothing matches by chance: "1", "01" and "surface 1" are three names, and the remedy is spelt out."""
    names = {"felt": "1", "glass": "2", "wood": "Sandpaper P80"}
    long_table().replace({"surface": names}).to_csv(tmp_path / "ratings.csv", index=False)
    recorded = ("01", "surface 2", "sandpaper_P80")
    with pytest.raises(ValueError) as error:
        read(LONG, surfaces=recorded)
    message = str(error.value)
    assert "Only in the ratings: '1', '2', 'Sandpaper P80'" in message
    assert "Only in the recordings: '01', 'surface 2', 'sandpaper_P80'" in message
    remedy = [line.strip() for line in message.splitlines() if line.startswith("    ")]
    assert remedy == ['"1" = "01"', '"2" = "surface 2"', '"Sandpaper P80" = "sandpaper_P80"']
    scores, _ = read(LONG, surfaces=recorded, more="[surface_names]\n" + "\n".join(remedy))
    assert scores.surfaces == recorded
    np.testing.assert_array_equal(scores.values, SCORES)


def test_names_that_match_on_one_side_are_noted(tmp_path, read):
    long_table().to_csv(tmp_path / "ratings.csv", index=False)
    scores, notes = read(LONG, surfaces=("wood", "felt"))
    assert scores.surfaces == ("wood", "felt") and notes[0] == "answers on 'glass' left out: there is no recording"
    np.testing.assert_array_equal(scores.values[0, :, 0], [7, 1])
    scores, notes = read(LONG, surfaces=(*SURFACES, "silk"))
    assert scores.surfaces == SURFACES and notes[0] == "1 recorded surfaces have no answers: 'silk'"
    scores, _ = read(LONG, surfaces=("felt", "wood", "silk"), more='[surface_names]\nglass = ""\n')
    assert scores.surfaces == ("felt", "wood")
    with pytest.raises(ValueError, match=r"\[surface_names\] renames \['glas'\], which the ratings do not hold"):
        read(LONG, more='[surface_names]\nglas = "felt"\n')
    with pytest.raises(ValueError, match="surface 'felt' by 'ann' was answered before"):
        read(LONG, surfaces=("felt", "wood"), more='[surface_names]\nglass = "felt"\n')


def test_a_scale_that_is_hardly_used_is_noted(tmp_path, read):
    """Answers 0 to 8, declared as 0 to 100; turned axes lie at the other end of the scale and must not hide it."""
    long_table().to_csv(tmp_path / "ratings.csv", index=False)
    turned = COLUMNS.replace('high = "rough"', 'high = "smooth"')
    note = "the answers run from 0 to 8, less than half of `scale` = [0, 100]: is `scale` right?"
    for axes in (COLUMNS, turned):
        assert note in read(LONG, axes=axes, scale=(0, 100))[1]
        assert not any("is `scale` right" in other for other in read(LONG, axes=axes, scale=(0, 16))[1])


@pytest.mark.parametrize("kind", ["csv", "xlsx"])
def test_titles_above_the_header(tmp_path, read, kind):
    table = long_table()
    rows = [["Questionnaire 2024", *[None] * 4], [None] * 5, list(table), *table.values.tolist()]
    if kind == "csv":
        pd.DataFrame(rows).to_csv(tmp_path / "ratings.csv", index=False, header=False)
    else:
        pd.DataFrame(rows).to_excel(tmp_path / "ratings.xlsx", index=False, header=False)
    assert_scores(read(LONG.replace("csv", kind))[0])
