"""Which tables of a folder look like raters' answers, and how they are arranged. A guess (recipe)."""

import re
from dataclasses import dataclass, field

from ...signal import RATING_AXES
from .draft_groups import TableGroup
from .draft_names import FIELD_WORDS, words_of
from .layout import AXIS_WORDS, TODO

#: Words in names of columns, sheets and files that tell of an axis; those of no axis of ours are known as adjectives.
WORDS_OF_AXIS = {
    "roughness": ("rough", "roughness", "smooth", "smoothness"),
    "bumpiness": ("bumpy", "bumpiness", "bump", "flat", "flatness"),
    "slipperiness": ("slippery", "slipperiness", "slip", "sticky", "stickiness"),
}
ADJECTIVES = "hot cold warm cool hard soft wet dry regular irregular fine coarse hardness softness warmth".split()
#: Words for a person, and for a surface, in the names of columns.
PERSON_WORDS = ("rater", "observer", "judge", "id", "name", *FIELD_WORDS["explorer"])
SURFACE_WORDS = ("item", "object", *FIELD_WORDS["surface"])
ANSWER_WORDS = ("answer", "rating", "response", "score", "value", "judgement", "judgment")
#: Scales that are in use; answers that reach both ends of one are taken to be on it.
SCALES = ((0, 8), (1, 9), (1, 7), (1, 5), (0, 10), (1, 10), (0, 6), (-3, 3), (-4, 4), (0, 100), (1, 100))
#: Answers are whole numbers between these ...
LIKELY_ANSWERS = (-100, 100)
#: ... of which there are no more than these.
MOST_ANSWERS = 101


@dataclass
class RatingsGuess:
    """What `[ratings]` of a layout may say.

    Attributes:
        group (`TableGroup`): the tables; the roles of its fields are "rater", "surface", "axis".
        keys, axes (`dict`): of `[ratings]` and `[ratings.axes]`; values that hold "TODO" are unknown.
        comments (`dict[str, str]`): key -> evidence.
        surfaces (`list[str]`): names of surfaces in the answers.
        doubts (`list[str]`): what was only guessed, or is left out.
    """

    group: TableGroup
    keys: dict
    axes: dict
    comments: dict = field(default_factory=dict)
    surfaces: list = field(default_factory=list)
    doubts: list = field(default_factory=list)


def axis_of(text):
    """The axis that a text names: one of `RATING_AXES`, "other" for another adjective, or `None`."""
    words = words_of(text)
    for axis, known in WORDS_OF_AXIS.items():
        if any(word in known for word in words):
            return axis
    return "other" if any(word in ADJECTIVES for word in words) else None


def guess_ratings(group, surfaces):
    """Looks whether tables hold answers.

    Args:
        group (`TableGroup`): the tables; the roles of its fields are set if they do.
        surfaces (`set[str]`): names of recorded surfaces, as far as they are known.

    Returns:
        `RatingsGuess`, or `None`.
    """
    facts = group.first
    is_force = facts.measuring("force").keys() >= {"x", "y", "z"}
    if facts.table.rate is not None or not facts.columns or not facts.complete or is_force:
        return None
    axis_fields = [item for item in group.fields if all(axis_of(value) for value in item.bare)]
    answers = [column for column in facts.columns if _is_answer(column)]
    named = [column for column in answers if axis_of(column.name)]
    spoken = [column for column in facts.columns if column.measures == "text" and _speaks_of_axes(facts, column)]
    ours = [column for column in named if axis_of(column.name) in RATING_AXES]
    if not answers or not (ours or spoken or axis_fields):
        return None
    _set_roles(group, axis_fields[:1])
    if axis_fields:
        return _by_file(group, answers, axis_fields[0], surfaces)
    if ours:
        return _by_column(group, named, surfaces)
    return _by_row(group, answers, spoken[0], surfaces)


def _is_answer(column):
    low, high = LIKELY_ANSWERS
    return column.whole and low <= column.low < column.high <= high and column.distinct <= MOST_ANSWERS


def _speaks_of_axes(facts, column):
    texts = {text for text in facts.table.text(column.name) if text}
    return sum(axis_of(text) is not None for text in texts) > len(texts) / 2


def _set_roles(group, axis_fields):
    for item in group.fields:
        item.role = {"explorer": "rater", "surface": "surface"}.get(item.hint, "")
    for item in axis_fields:
        item.role, item.hint = "axis", None
    for number, item in enumerate(item for item in group.fields if not item.role):
        item.role = f"part{number}"


def _by_column(group, named, surfaces):
    """A column an axis, a row a rater and surface."""
    axes, used = {}, []
    for axis in RATING_AXES:
        column = next((column for column in named if axis_of(column.name) == axis), None)
        if column is not None:
            axes[axis] = _axis(axis, column.name)
            used.append(column)
    guess = _long(group, named, axes, surfaces)
    _tell_scale(guess, used)
    unused = [column.name for column in named if column not in used]
    if unused:
        guess.doubts.append(f"axes that are not used: {', '.join(unused)}")
    return guess


def _by_row(group, answers, spoken, surfaces):
    """A row an answer, and a column that names the axis."""
    theirs = dict.fromkeys(text for text in group.first.table.text(spoken.name) if axis_of(text) in RATING_AXES)
    axes = {axis_of(text): _axis(axis_of(text), text) for text in reversed(theirs)}
    answer = _by_words(answers, ANSWER_WORDS) or answers[-1]
    guess = _long(group, [spoken, answer], {axis: axes[axis] for axis in RATING_AXES if axis in axes}, surfaces)
    guess.keys |= {"axis": spoken.name, "answer": answer.name}
    _tell_scale(guess, [answer])
    return guess


def _by_file(group, answers, axis_field, surfaces):
    """A file or sheet an axis: raters x surfaces, or a row an answer."""
    theirs = dict.fromkeys(value for value in axis_field.values if axis_of(value) in RATING_AXES)
    axes = {axis: _axis(axis, text) for axis in RATING_AXES for text in theirs if axis_of(text) == axis}
    columns = group.first.columns
    others = [column for column in columns if column not in answers]
    if _by_words(columns, PERSON_WORDS) and _by_words(columns, SURFACE_WORDS):
        answer = _by_words(answers, ANSWER_WORDS) or answers[-1]
        guess = _long(group, [answer], axes, surfaces)
        guess.keys["answer"] = answer.name
        _tell_scale(guess, [answer])
        return guess
    rows = group.first.table.text(columns[0].name)
    names = [column.name for column in columns[1:]]
    guess = RatingsGuess(group, {"form": "wide", **_wide_roles(rows, names, columns[0].name, surfaces)}, axes)
    guess.surfaces = {"surface": rows}.get(guess.keys["rows"], names if guess.keys["columns"] == "surface" else [])
    _tell_scale(guess, [column for column in answers if column is not columns[0]])
    if len(others) > 1:
        guess.doubts.append(f"columns without answers: {', '.join(column.name for column in others)}")
    return guess


def _wide_roles(rows, names, corner, surfaces):
    """Whether surfaces are rows or columns: by recorded names, else by words."""
    known = len(surfaces & set(names)) - len(surfaces & set(rows))
    spoken = [_counted(texts, PERSON_WORDS) - _counted(texts, SURFACE_WORDS) for texts in (rows + [corner], names)]
    if not known and spoken[0] == spoken[1]:
        ask = f"{TODO}: surface or rater?"
        return {"rows": ask, "columns": ask}
    surface_columns = known > 0 if known else spoken[0] > spoken[1]
    return {"rows": "rater", "columns": "surface"} if surface_columns else {"rows": "surface", "columns": "rater"}


def _counted(texts, words):
    return sum(any(word.removesuffix("s") in words for word in words_of(text)) for text in texts) / max(1, len(texts))


def _long(group, taken, axes, surfaces):
    """Keys of a long table: who answered about what, in a column or in the name of the file."""
    guess = RatingsGuess(group, {"form": "long"}, axes)
    table = group.first.table
    free = [column for column in group.first.columns if column not in taken]
    surface = rater = None
    if group.field_of("surface") is None:
        overlap = {column.name: len(surfaces & set(table.text(column.name))) for column in free}
        best = max(free, key=lambda column: overlap[column.name], default=None)
        surface = best if best is not None and overlap[best.name] else _by_words(free, SURFACE_WORDS)
        guess.surfaces = [text for text in dict.fromkeys(table.text(surface.name)) if text] if surface else []
    else:
        guess.surfaces = group.field_of("surface").distinct
    free = [column for column in free if column is not surface]
    if group.field_of("rater") is None:
        rater = _by_words(free, PERSON_WORDS)
    unnamed = [item for item in group.fields if item.role.startswith("part")]
    for role, column in (("rater", rater), ("surface", surface)):
        if group.field_of(role) is None and column is None and len(unnamed) == 1:
            unnamed[0].role = role
            if role == "surface":
                guess.surfaces = unnamed[0].distinct
            unnamed = []
            guess.doubts.append(f"what varies in {group.place} taken as the {role}: no column names it")
        elif group.field_of(role) is None:
            ask = f"{TODO}: the column that names the {role}; there are {', '.join(column.name for column in free)}"
            guess.keys[role] = column.name if column else ask
    return guess


def _by_words(columns, words):
    """The first column whose name has one of the words, or `None`."""
    return next((column for column in columns if any(word in words for word in words_of(column.name))), None)


def _axis(axis, theirs):
    low, high = AXIS_WORDS[axis]
    ask = f"{TODO}: {low} or {high}? what the largest number means"
    return {"column": theirs, "high": ask, "words": [low, high]}


def _tell_scale(guess, columns):
    """The scale by the smallest and largest answer, in all files that were opened."""
    names = {column.name for column in columns}
    found = [column for facts in guess.group.tables for column in facts.columns if column.name in names]
    low, high = min(column.low for column in found), max(column.high for column in found)
    seen = f"answers from {low:g} to {high:g}"
    fits = (low, high) in SCALES
    guess.keys["scale"] = [low, high] if fits else [low, f"{TODO}: the ends of the scale; {seen}"]
    guess.comments["scale"] = f"the {seen} reach both ends of a usual scale" if fits else seen
    facts = guess.group.first
    missing = {text for column in columns for text in facts.table.text(column.name) if not _is_number(text)}
    if missing - {""}:
        guess.keys["missing"] = ["", *sorted(missing - {""})]
        guess.comments["missing"] = "what is no number among the answers"


def _is_number(text):
    return bool(re.fullmatch(r"[+-]?(\d+[.,]?\d*|[.,]\d+)", text))


def surface_names(rated, recorded):
    """Pairs names in the ratings with names of recordings where they differ.

    Args:
        rated, recorded (`list[str]`): the names.

    Returns:
        `dict[str, str]`: name in the ratings -> name in the recordings: the one with the same numbers or the same
        letters, or else a "TODO". Empty if there is nothing left on one of the sides.
    """
    left, right = ([name for name in one if name not in other] for one, other in ((rated, recorded), (recorded, rated)))
    if not left or not right:
        return {}
    pairs = {}
    for name in left:
        same = [other for other in right if _spelling(other) == _spelling(name)]
        same = same or [other for other in right if _numbers(other) == _numbers(name) != []]
        pairs[name] = (
            same[0] if len(same) == 1 else f"{TODO}: which of {', '.join(right[:4])}{', ..' * (len(right) > 4)}"
        )
    return pairs


def _spelling(name):
    return re.sub(r"[\W_]", "", name.casefold())


def _numbers(name):
    return [int(number) for number in re.findall(r"\d+", name)]
