"""Which tables of a folder look like raters' answers, and how they are arranged. A guess (recipe)."""

import re
from dataclasses import dataclass, field

from ...signal import RATING_AXES
from .draft_names import FIELD_WORDS, words_of
from .draft_tables import TableGroup
from .layout import AXIS_WORDS, TODO

#: Words in names of columns, sheets and files for an axis; those of no axis of ours are known as adjectives.
WORDS_OF_AXIS = {
    "roughness": "rough roughness smooth smoothness".split(),
    "bumpiness": "bumpy bumpiness bump flat flatness".split(),
    "slipperiness": "slippery slipperiness slip sticky stickiness".split(),
    "other": "hot cold warm cool hard soft wet dry regular irregular fine coarse hardness softness warmth".split(),
}
#: Words for a person, for a surface and for an answer in the names of columns.
ROLE_WORDS = {
    "rater": ("rater", "observer", "judge", "id", "name", *FIELD_WORDS["explorer"]),
    "surface": ("item", "object", *FIELD_WORDS["surface"]),
    "answer": ("answer", "rating", "response", "score", "value", "judgement", "judgment"),
}
#: Scales that are in use; answers that reach both ends of one are taken to be on it.
SCALES = ((0, 8), (1, 9), (1, 7), (1, 5), (0, 10), (1, 10), (0, 6), (-3, 3), (-4, 4), (0, 100), (1, 100))
#: Answers are whole numbers between these.
LIKELY_ANSWERS = (-100, 100)


@dataclass
class RatingsGuess:
    """What `[ratings]` of a layout may say.

    `keys` and `axes` are those of `[ratings]` and `[ratings.axes]`, "TODO" where unknown, `comments` their evidence,
    `surfaces` the names in the answers, `doubts` what was only guessed, or is left out. The roles of the fields of
    `group` are "rater", "surface", "axis".
    """

    group: TableGroup
    keys: dict
    axes: dict = field(default_factory=dict)
    comments: dict = field(default_factory=dict)
    surfaces: list = field(default_factory=list)
    doubts: list = field(default_factory=list)


def axis_of(text):
    """The axis that a text names: one of `RATING_AXES`, "other" for another adjective, or `None`."""
    words = set(words_of(text))
    return next((axis for axis, known in WORDS_OF_AXIS.items() if words & set(known)), None)


def guess_ratings(group, surfaces):
    """`RatingsGuess` if tables look like answers, else `None`; `surfaces` are the recorded ones, if known.

    An axis is a column, a value of a text column, or a part of the names of the files or sheets. Where no word for one
    is known, a column that names recorded surfaces beside answers will do.
    """
    facts = group.first
    is_force = facts.measuring("force").keys() >= {"x", "y", "z"}
    if facts.table.rate is not None or not facts.columns or not facts.complete or is_force:
        return None
    low, high = LIKELY_ANSWERS
    answers = [column for column in facts.columns if column.whole and low <= column.low < column.high <= high]
    ours = {axis_of(column.name): column for column in reversed(answers) if axis_of(column.name) in RATING_AXES}
    naming = next((column for column in facts.columns if _names_axes(facts, column)), None)
    by_name = next((item for item in group.fields if all(map(axis_of, item.values))), None)
    known = ours or naming or by_name
    texts = [facts.table.text(column.name) for column in facts.columns if column.measures == "text"]
    if not answers or not (known or any(surfaces & set(names) for names in texts)):
        return None
    for item in group.fields:
        role = "axis" if item is by_name else {"explorer": "rater"}.get(item.hint, item.hint)
        item.role = role if role in ("axis", "rater", "surface") else ""
    guess = RatingsGuess(group, {"form": "long"})
    values = by_name.values if by_name else facts.table.text(naming.name) if naming else []
    if unused := sorted({value for value in values if value and axis_of(value) not in AXIS_WORDS}):
        guess.doubts.append(f"axes that are not used: {', '.join(unused)}; [ratings.axes.NAME] takes one more")
    if by_name and not all(_by_words(facts.columns, role) for role in ("rater", "surface")):
        answers, theirs = _wide(guess, answers, surfaces), {axis_of(value): value for value in by_name.values}
    elif not known:
        _long(guess, answers, surfaces)
        names = ", ".join(column.name for column in answers)
        theirs = {axis: f"{TODO}: the column of {axis}, one of {names}; or remove this axis" for axis in AXIS_WORDS}
    elif ours and not by_name:
        named = [column for column in answers if axis_of(column.name)]
        _long(guess, named, surfaces)
        answers, theirs = list(ours.values()), {axis: column.name for axis, column in ours.items()}
        if unused := [column.name for column in named if column not in answers]:
            guess.doubts.append(f"axes that are not used: {', '.join(unused)}")
    else:  # a row an answer
        answers = [_by_words(answers, "answer") or answers[-1]]
        theirs = {axis_of(value): value for value in reversed(values)}
        _long(guess, answers if by_name else [*answers, naming], surfaces)
        guess.keys |= ({} if by_name else {"axis": naming.name}) | {"answer": answers[0].name}
    for axis, words in AXIS_WORDS.items():
        if axis in theirs:
            ask = f"{TODO}: {' or '.join(words)}? what the largest number means"
            guess.axes[axis] = {"column": theirs[axis], "high": ask, "words": list(words)}
    _set_scale(guess, answers)
    return guess


def _names_axes(facts, column):
    texts = {text for text in facts.table.text(column.name) if text} if column.measures == "text" else ()
    return sum(axis_of(text) is not None for text in texts) > len(texts) / 2


def _by_words(columns, role):
    """The first column whose name has a word of the role, or `None`."""
    return next((column for column in columns if set(words_of(column.name)) & set(ROLE_WORDS[role])), None)


def _wide(guess, answers, surfaces):
    """Sets the keys of tables of raters x surfaces, or the other way round; returns the columns of the answers."""
    first, *others = guess.group.first.columns
    rows, columns = guess.group.first.table.text(first.name), [column.name for column in others]
    clear = len(surfaces & set(columns)) - len(surfaces & set(rows))
    ask = f"{TODO}: surface or rater?"
    roles = ("rater", "surface") if clear > 0 else ("surface", "rater") if clear else (ask, ask)
    guess.keys = {"form": "wide", "rows": roles[0], "columns": roles[1]}
    guess.surfaces = (columns if clear > 0 else rows) if clear else []
    return [column for column in answers if column is not first] or answers


def _long(guess, taken, surfaces):
    """Sets who answered about what: a part of the name of the file, or a column."""
    group, texts = guess.group, guess.group.first.table.text
    free = [column for column in group.first.columns if column not in taken]
    unnamed = [item for item in group.fields if not item.role]
    for role in ("surface", "rater"):
        item, column = group.field_of(role), _by_words(free, role)
        if role == "surface" and free:  # a column with recorded names is it, whatever it is called
            best = max(free, key=lambda other: len(surfaces & set(texts(other.name))))
            column = best if surfaces & set(texts(best.name)) else column
        if item is None and column is not None:
            guess.keys[role] = column.name
            free.remove(column)
        elif item is None and len(unnamed) == 1:
            item = unnamed.pop()
            item.role = role
            guess.doubts.append(f"what varies in {group.place} taken as the {role}: no column names it")
        elif item is None:
            there = ", ".join(other.name for other in free)
            guess.keys[role] = f"{TODO}: the column that names the {role}; there are {there}"
        if role == "surface" and (item or column):
            guess.surfaces = item.distinct if item else list(dict.fromkeys(filter(None, texts(column.name))))


def _set_scale(guess, columns):
    """The scale by the smallest and largest answer, in all files that were opened, and what stands for none."""
    names, group = {column.name for column in columns}, guess.group
    found = [column for facts in group.tables for column in facts.columns if column.name in names]
    low, high = min(column.low for column in found), max(column.high for column in found)
    seen, fits = f"answers from {low:g} to {high:g}", (low, high) in SCALES
    guess.keys["scale"] = [low, high] if fits else [low, f"{TODO}: the ends of the scale; {seen}"]
    guess.comments["scale"] = f"the {seen} reach both ends of a usual scale" if fits else seen
    texts = {text for name in names for text in group.first.table.text(name)}
    missing = sorted(text for text in texts if text and not re.fullmatch(r"[+-]?(\d+[.,]?\d*|[.,]\d+)", text))
    if missing:
        guess.keys["missing"] = ["", *missing]
        guess.comments["missing"] = "what is no number among the answers"
