"""The part of `layout.toml` that describes the tables of ratings."""

import math
from dataclasses import dataclass

from ...signal import RATING_AXES
from .patterns import Pattern
from .table_layout import table_keys

#: The words at 0 and at 8 of our axes (pairs of SENS3, arXiv 2401.01818).
AXIS_WORDS = dict(zip(RATING_AXES, (("smooth", "rough"), ("flat", "bumpy"), ("sticky", "slippery")), strict=True))
FORMS = ("long", "wide")


@dataclass(frozen=True)
class AxisLayout:
    """Where the answers on an axis are, and whether they are turned round: then the largest means our 0."""

    column: str
    turned: bool


@dataclass(frozen=True)
class RatingsLayout:
    """`[ratings]`: tables of answers.

    Attributes:
        pattern (`Pattern`): relative path; may hold `{rater}`, `{surface}` and `{axis}`.
        kind, inside, delimiter, header: as in `FilesLayout`; `header` is 1 by default.
        form (`str`): "long" = one row an answer, or a set of them; "wide" = one table an axis, rows x columns.
        rater, surface (`str` or `None`): long: their columns, unless in the pattern. wide: "rows" and "columns".
        axis, answer (`str` or `None`): long with one row an answer: the columns of the axis' name and of the answer.
        scale (`tuple[float, float]`): the smallest and largest number used; mapped linearly to 0-8.
        missing (`tuple[str, ...]`): what stands for no answer.
        axes (`dict[str, AxisLayout]`): our name -> theirs. Axes beyond `RATING_AXES` keep 8 = `high`.
    """

    pattern: Pattern
    kind: str
    form: str
    axes: dict
    scale: tuple[float, float]
    rater: str | None = None
    surface: str | None = None
    axis: str | None = None
    answer: str | None = None
    missing: tuple[str, ...] = ("", "NA", "-")
    inside: Pattern | None = None
    delimiter: str | None = None
    header: int = 1


def rating_keys(keys):
    """Takes everything from `[ratings]`.

    Args:
        keys (`Keys`): the table.

    Returns:
        `RatingsLayout`.

    Raises:
        ValueError: naming file, key, value and remedy.
    """
    table, form = table_keys(keys, header=1), keys.choice("form", FORMS)
    named = table["pattern"].names + (table["inside"].names if table["inside"] else ())
    axes = keys.table("axes")
    if axes is None:
        keys.fail("axes", "is missing: add [ratings.axes] with, for example, roughness = { column = .., high = .. }")
    ratings = RatingsLayout(
        **table,
        form=form,
        scale=_scale(keys),
        missing=_texts(keys, "missing", ["", "NA", "-"]),
        **(_wide(keys, named) if form == "wide" else _long(keys, named)),
        axes=_axes(axes),
    )
    keys.finish()
    return ratings


def _long(keys, named):
    columns = {}
    for name in ("rater", "surface"):
        if name in named and name in keys:
            keys.fail(name, "is in the pattern and a column: remove one of them")
        columns[name] = None if name in named else keys.take(name, (str, int))
    columns["axis"] = None if "axis" in named else keys.take("axis", (str, int), None)
    one_answer = "axis" in named or columns["axis"] is not None
    columns["answer"] = keys.take("answer", (str, int)) if one_answer else None
    return columns


def _wide(keys, named):
    if "axis" not in named:
        keys.fail("form", '= "wide" needs {axis} in `pattern` or `sheet`: one table an axis. Is it "long"?')
    rows, columns = (keys.choice(name, ("rater", "surface")) for name in ("rows", "columns"))
    if rows == columns:
        keys.fail("columns", f"= {columns!r} must be the other one of rater and surface")
    return {rows: "rows", columns: "columns"}


def _scale(keys):
    scale = keys.take("scale", list)
    numbers = [value for value in scale if type(value) in (int, float) and math.isfinite(value)]
    if len(scale) != 2 or numbers != scale or not scale[0] < scale[1]:
        keys.fail("scale", f"= {scale!r} must be the smallest and the largest number of the scale, such as [0, 8]")
    return float(scale[0]), float(scale[1])


def _texts(keys, name, default):
    texts = keys.take(name, list, default)
    if not all(isinstance(text, str) for text in texts):
        keys.fail(name, f"= {texts!r} must be a list of texts")
    return tuple(texts)


def _axes(keys):
    axes = {}
    for name in keys.names:
        axis = keys.table(name)
        column, high = axis.take("column", (str, int)), axis.take("high", str)
        words = _texts(axis, "words", list(AXIS_WORDS.get(name, ())))
        ours = AXIS_WORDS.get(name, (None, high))[1]
        if len(words) != 2 or high not in words or ours not in words:
            pair = "the two words of the axis" if name not in AXIS_WORDS else f"{AXIS_WORDS[name]}"
            axis.fail("high", f"= {high!r}, `words` = {list(words)}: `words` must be {pair}, `high` one of them")
        axis.finish()
        axes[name] = AxisLayout(column, turned=high != ours)
    if not axes:
        keys.fail(RATING_AXES[0], "is missing: name at least one axis")
    return axes
