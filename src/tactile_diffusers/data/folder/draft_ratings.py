"""Which tables of a folder look like raters' answers, and how they are arranged. A guess (recipe)."""

import re
from dataclasses import dataclass, field

from ...signal import RATING_AXES
from .draft_groups import TableGroup
from .draft_names import FIELD_WORDS, words_of
from .layout import AXIS_WORDS, TODO

#: Words in names of columns, sheets and files for an axis; those of no axis of ours are known as adjectives.
WORDS_OF_AXIS = {
    "roughness": "rough roughness smooth smoothness".split(),
    "bumpiness": "bumpy bumpiness bump flat flatness".split(),
    "slipperiness": "slippery slipperiness slip sticky stickiness".split(),
    "other": "hot cold warm cool hard soft wet dry regular irregular fine coarse hardness softness warmth".split(),
}
#: Words for a person, for a surface and for an answer in the names of columns.
PERSON_WORDS = ("rater", "observer", "judge", "id", "name", *FIELD_WORDS["explorer"])
SURFACE_WORDS = ("item", "object", *FIELD_WORDS["surface"])
ANSWER_WORDS = ("answer", "rating", "response", "score", "value", "judgement", "judgment")
#: Scales that are in use; answers that reach both ends of one are taken to be on it.
SCALES = ((0, 8), (1, 9), (1, 7), (1, 5), (0, 10), (1, 10), (0, 6), (-3, 3), (-4, 4), (0, 100), (1, 100))
#: Answers are whole numbers between these, of which there are no more than `MOST_ANSWERS`.
LIKELY_ANSWERS, MOST_ANSWERS = (-100, 100), 101


@dataclass
class RatingsGuess:
    """What `[ratings]` of a layout may say.

    `keys` and `axes` are those of `[ratings]` and `[ratings.axes]`, "TODO" where unknown, `comments` their evidence,
    `surfaces` the names in the answers, `doubts` what was only guessed, or is left out. The roles of the fields of
    `group` are "rater", "surface", "axis".
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
    return next((axis for axis, known in WORDS_OF_AXIS.items() if set(words) & set(known)), None)


def guess_ratings(group, surfaces):
    """`RatingsGuess` if tables look like answers, else `None`; `surfaces` are the recorded ones, if known."""
    facts = group.first
    is_force = facts.measuring("force").keys() >= {"x", "y", "z"}
    if facts.table.rate is not None or not facts.columns or not facts.complete or is_force:
        return None
    axis_fields = [item for item in group.fields if all(axis_of(value) for value in item.bare)][:1]
    answers = [column for column in facts.columns if _is_answer(column)]
    named = [column for column in answers if axis_of(column.name)]
    naming = [column for column in facts.columns if column.measures == "text" and _names_axes(facts, column)]
    ours = [column for column in named if axis_of(column.name) in RATING_AXES]
    if not answers or not (ours or naming or axis_fields):
        return None
    for item in group.fields:
        item.role = {"explorer": "rater", "surface": "surface"}.get(item.hint, "")
    for item in axis_fields:
        item.role, item.hint = "axis", None
    for number, item in enumerate(item for item in group.fields if not item.role):
        item.role = f"part{number}"
    if axis_fields:
        return _by_file(group, answers, axis_fields[0], surfaces)
    if ours:
        return _by_column(group, named, surfaces)
    return _by_row(group, answers, naming[0], surfaces)


def _is_answer(column):
    low, high = LIKELY_ANSWERS
    return column.whole and low <= column.low < column.high <= high and column.distinct <= MOST_ANSWERS


def _names_axes(facts, column):
    texts = {text for text in facts.table.text(column.name) if text}
    return sum(axis_of(text) is not None for text in texts) > len(texts) / 2


def _by_column(group, named, surfaces):
    """A column an axis, a row a rater and surface."""
    used = {axis_of(column.name): column for column in reversed(named) if axis_of(column.name) in RATING_AXES}
    guess = _long(group, named, {axis: column.name for axis, column in used.items()}, surfaces)
    _set_scale(guess, list(used.values()))
    unused = [column.name for column in named if column not in used.values()]
    if unused:
        guess.doubts.append(f"axes that are not used: {', '.join(unused)}")
    return guess


def _by_row(group, answers, naming, surfaces):
    """A row an answer, and a column that names the axis."""
    answer = _by_words(answers, ANSWER_WORDS) or answers[-1]
    theirs = dict.fromkeys(group.first.table.text(naming.name))
    guess = _long(group, [naming, answer], {axis_of(text): text for text in reversed(theirs)}, surfaces)
    guess.keys |= {"axis": naming.name, "answer": answer.name}
    _set_scale(guess, [answer])
    return guess


def _by_file(group, answers, axis_field, surfaces):
    """A file or sheet an axis: raters x surfaces, or a row an answer."""
    theirs = {axis_of(value): value for value in axis_field.values}
    columns = group.first.columns
    if _by_words(columns, PERSON_WORDS) and _by_words(columns, SURFACE_WORDS):
        answer = _by_words(answers, ANSWER_WORDS) or answers[-1]
        guess = _long(group, [answer], theirs, surfaces)
        guess.keys["answer"] = answer.name
        _set_scale(guess, [answer])
        return guess
    rows = group.first.table.text(columns[0].name)
    names = [column.name for column in columns[1:]]
    guess = RatingsGuess(group, {"form": "wide", **_wide_roles(rows, names, columns[0].name, surfaces)}, _axes(theirs))
    guess.surfaces = {"surface": rows}.get(guess.keys["rows"], names if guess.keys["columns"] == "surface" else [])
    _set_scale(guess, [column for column in answers if column is not columns[0]])
    others = [column.name for column in columns if column not in answers]
    if len(others) > 1:
        guess.doubts.append(f"columns without answers: {', '.join(others)}")
    return guess


def _wide_roles(rows, names, corner, surfaces):
    """Whether surfaces are rows or columns: by recorded names, else by words."""

    def share(texts, known):
        found = [any(word.removesuffix("s") in known for word in words_of(text)) for text in texts]
        return sum(found) / max(1, len(found))

    clear = len(surfaces & set(names)) - len(surfaces & set(rows))
    if not clear:
        persons = [share(texts, PERSON_WORDS) - share(texts, SURFACE_WORDS) for texts in ([*rows, corner], names)]
        clear = persons[0] - persons[1]
    if not clear:
        ask = f"{TODO}: surface or rater?"
        return {"rows": ask, "columns": ask}
    return {"rows": "rater", "columns": "surface"} if clear > 0 else {"rows": "surface", "columns": "rater"}


def _long(group, taken, theirs, surfaces):
    """Keys of a long table: who answered about what, in a column or in the name of the file."""
    guess = RatingsGuess(group, {"form": "long"}, _axes(theirs))
    table, found = group.first.table, {}
    free = [column for column in group.first.columns if column not in taken]
    if group.field_of("surface") is None:
        overlap = {column.name: len(surfaces & set(table.text(column.name))) for column in free}
        best = max(free, key=lambda column: overlap[column.name], default=None)
        found["surface"] = best if best is not None and overlap[best.name] else _by_words(free, SURFACE_WORDS)
        free = [column for column in free if column is not found["surface"]]
    if group.field_of("rater") is None:
        found["rater"] = _by_words(free, PERSON_WORDS)
    unnamed = [item for item in group.fields if item.role.startswith("part")]
    for role in ("rater", "surface"):
        if role not in found:
            continue
        if found[role] is None and len(unnamed) == 1:
            unnamed.pop().role = role
            guess.doubts.append(f"what varies in {group.place} taken as the {role}: no column names it")
        else:
            ask = f"{TODO}: the column that names the {role}; there are {', '.join(column.name for column in free)}"
            guess.keys[role] = found[role].name if found[role] else ask
    if (item := group.field_of("surface")) is not None:
        guess.surfaces = item.distinct
    elif found["surface"]:
        guess.surfaces = [text for text in dict.fromkeys(table.text(found["surface"].name)) if text]
    return guess


def _by_words(columns, words):
    """The first column whose name has one of the words, or `None`."""
    return next((column for column in columns if any(word in words for word in words_of(column.name))), None)


def _axes(theirs):
    """`[ratings.axes]`, from our name of each axis to theirs; which word is high is left to ask."""
    axes = {}
    for axis in RATING_AXES:
        if axis in theirs:
            low, high = AXIS_WORDS[axis]
            ask = f"{TODO}: {low} or {high}? what the largest number means"
            axes[axis] = {"column": theirs[axis], "high": ask, "words": [low, high]}
    return axes


def _set_scale(guess, columns):
    """The scale by the smallest and largest answer, in all files that were opened, and what stands for none."""
    names = {column.name for column in columns}
    found = [column for facts in guess.group.tables for column in facts.columns if column.name in names]
    low, high = min(column.low for column in found), max(column.high for column in found)
    seen = f"answers from {low:g} to {high:g}"
    fits = (low, high) in SCALES
    guess.keys["scale"] = [low, high] if fits else [low, f"{TODO}: the ends of the scale; {seen}"]
    guess.comments["scale"] = f"the {seen} reach both ends of a usual scale" if fits else seen
    texts = {text for column in columns for text in guess.group.first.table.text(column.name)}
    missing = sorted(text for text in texts if text and not re.fullmatch(r"[+-]?(\d+[.,]?\d*|[.,]\d+)", text))
    if missing:
        guess.keys["missing"] = ["", *missing]
        guess.comments["missing"] = "what is no number among the answers"
