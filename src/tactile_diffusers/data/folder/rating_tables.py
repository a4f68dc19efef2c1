"""Tables of raters' answers, long or wide, as `RaterScores` on the 0-8 scale."""

import difflib
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...signal import RATING_AXES
from ...signal.rating_scales import RATING_SCALE
from ..recordings import RaterScores
from .sources import Source, files_below, matching_places

#: How many names or places a message lists.
_FEW = 8
#: So many answers, or more, that use a smaller share of the scale are probably on another one (recipe).
LEAST_ANSWERS, LEAST_USED = 10, 0.5


@dataclass(frozen=True)
class _Answer:
    """One cell of a table: whose answer, on what, and where it stands. `axis` is our name."""

    rater: str
    surface: str
    axis: str
    text: str
    place: str


def read_ratings(root, layout, surfaces):
    """Reads the answers that `[ratings]` of a layout describes.

    Missing answers are NaN, and raters may have rated different surfaces. Axes that the layout does not name are
    ignored. An axis whose `high` is our low word is turned round, and the scale is mapped linearly to 0-8.

    Args:
        root (`str` or `Path`): the folder.
        layout (`Layout`): with `ratings`.
        surfaces (`tuple[str, ...]`): names of the recorded surfaces.

    Returns:
        `tuple[RaterScores, list[str]]`: the answers on recorded surfaces, and notes on what was missing or ignored.

    Raises:
        ValueError: naming file, line, value and remedy, if no table matches, a column is missing, an answer is no
            number, off the scale or given twice, or names of surfaces do not match on both sides.
    """
    root, ratings = Path(root), layout.ratings
    answers, ignored = [], {}
    for path, inside, fields in matching_places(root, files_below(root), ratings, f"{layout.path}: [ratings]"):
        table = Source(ratings, path, inside).table()
        found = (
            _wide(table, ratings, fields, ignored) if ratings.form == "wide" else _long(table, ratings, fields, ignored)
        )
        answers += found
    answers, notes = _on_recorded(answers, layout, surfaces)
    values = _numbers(answers, ratings)
    notes += _unused_scale(answers, ratings.scale)
    _check_axes(values, ratings, ignored, layout)
    raters = tuple(dict.fromkeys(rater for rater, _, _ in values))
    answered = {surface for _, surface, _ in values}
    rated = tuple(surface for surface in surfaces if surface in answered)
    axes = tuple(sorted(ratings.axes, key=lambda axis: (RATING_AXES + (axis,)).index(axis)))
    scores = np.full((len(raters), len(rated), len(axes)), np.nan, dtype=np.float32)
    places = [{name: i for i, name in enumerate(names)} for names in (raters, rated, axes)]
    for key, value in values.items():
        scores[tuple(place[name] for place, name in zip(places, key, strict=True))] = value
    missing = int(np.isnan(scores).sum())
    if missing:
        notes.append(f"{missing} of {scores.size} answers (raters x surfaces x axes) are missing")
    absent = [axis for axis in RATING_AXES if axis not in axes]
    if absent:
        notes.append(f"the layout names no {' and no '.join(absent)}")
    if ignored:
        notes.append(f"axes that the layout does not name are ignored: {', '.join(map(repr, ignored))}")
    return RaterScores(scores, raters, rated, axes), notes


def _long(table, ratings, fields, ignored):
    """Answers of a table with a row per answer, or per rater and surface."""
    rows = range(table.rows)
    raters = [fields["rater"] for _ in rows] if ratings.rater is None else table.text(ratings.rater)
    surfaces = [fields["surface"] for _ in rows] if ratings.surface is None else table.text(ratings.surface)
    if ratings.answer is None:
        columns = [(axis, table.text(layout.column)) for axis, layout in ratings.axes.items()]
        cells = [(row, axis, texts[row]) for row in rows for axis, texts in columns]
    else:
        ours = {str(layout.column): axis for axis, layout in ratings.axes.items()}
        theirs = [fields["axis"] for _ in rows] if ratings.axis is None else table.text(ratings.axis)
        ignored.update({name: True for name in theirs if name and name not in ours})
        texts = table.text(ratings.answer)
        cells = [(row, ours[theirs[row]], texts[row]) for row in rows if theirs[row] in ours]
    answers = []
    for row, axis, text in cells:
        place = f"{table.where}, {table.place(row)}"
        if text in ratings.missing or not text:
            continue
        if not raters[row] or not surfaces[row]:
            raise ValueError(f"{place}: the answer {text!r} on {axis} has no {'surface' if raters[row] else 'rater'}.")
        answers.append(_Answer(raters[row], surfaces[row], axis, text, place))
    return answers


def _wide(table, ratings, fields, ignored):
    """Answers of a table of one axis, raters x surfaces or the other way round; the first column names the rows."""
    axes = [axis for axis, layout in ratings.axes.items() if str(layout.column) == fields["axis"]]
    if not axes:
        ignored[fields["axis"]] = True
        return []
    answers, rows = [], table.text(0)
    for column in table.names[1:]:
        for row, text in enumerate(table.text(column)):
            if text in ratings.missing or not text:
                continue
            names = (rows[row], column) if ratings.rater == "rows" else (column, rows[row])
            place = f"{table.where}, {table.place(row)}, column {column!r}"
            if not rows[row]:
                raise ValueError(f"{place}: the answer {text!r} stands in a row without a name.")
            answers.append(_Answer(*names, axes[0], text, place))
    return answers


def _on_recorded(answers, layout, surfaces):
    """The answers on recorded surfaces, under the names of the recordings, and notes on the others."""
    renamed = layout.surface_names
    rated = list(dict.fromkeys(answer.surface for answer in answers))
    unused = [name for name in renamed if name not in rated]
    if unused:
        raise ValueError(
            f"{layout.path}: [surface_names] renames {unused}, which the ratings do not hold: {_few(rated)}."
        )
    # "" as a new name means: leave these answers out
    recorded, meant = {*surfaces, ""}, {renamed.get(name, name) for name in rated}
    unknown = [name for name in rated if renamed.get(name, name) not in recorded]
    unrated = [name for name in surfaces if name not in meant]
    if unknown and unrated:
        suggested = _suggested(unknown, unrated)
        lines = "\n".join(f'    "{name}" = "{suggested[name]}"' for name in unknown[:_FEW])
        raise ValueError(
            f"{layout.path}: names of surfaces do not match. Only in the ratings: {_few(unknown)}. Only in the "
            f"recordings: {_few(unrated)}. Say which is which under [surface_names], for example\n{lines}\n"
            'where "" leaves the answers on a surface out.'
        )
    notes = [f"answers on {_few(unknown)} left out: there is no recording"] if unknown else []
    notes += [f"{len(unrated)} recorded surfaces have no answers: {_few(unrated)}"] if unrated else []
    kept = []
    for answer in answers:
        name = renamed.get(answer.surface, answer.surface)
        if name and name in recorded:
            kept.append(_Answer(answer.rater, name, answer.axis, answer.text, answer.place))
    return kept, notes


def _few(names):
    return ", ".join(map(repr, names[:_FEW])) + (f" and {len(names) - _FEW} more" if len(names) > _FEW else "")


def _suggested(names, candidates):
    """What each of the names probably means, or "": no candidate twice, which would merge two surfaces' answers."""
    free, suggested = list(candidates), dict.fromkeys(names, "")
    for closest in (0.9, 0.6):  # what is spelt almost alike comes first
        for name in names:
            if not suggested[name]:
                suggested[name] = _nearest(name, free, closest)
                free = [other for other in free if other != suggested[name]]
    return suggested


def _nearest(name, candidates, closest):
    """The candidate that a name probably means, or "": the same numbers, or else a close spelling without others."""
    numbers = _numbers_in(name)
    same = [other for other in candidates if numbers and _numbers_in(other) == numbers]
    without = [other for other in candidates if not (numbers and _numbers_in(other))]
    spelt = {other.casefold(): other for other in same or without}
    near = difflib.get_close_matches(name.casefold(), spelt, n=1, cutoff=closest)
    return spelt[near[0]] if near else same[0] if len(same) == 1 else ""


def _numbers_in(name):
    return [int(digits) for digits in re.findall(r"\d+", name)]


def _numbers(answers, ratings):
    """(rater, surface, axis) -> answer on the 0-8 scale."""
    values, places, outside = {}, {}, []
    low, high = ratings.scale
    for answer in answers:
        key = answer.rater, answer.surface, answer.axis
        if key in values:
            raise ValueError(
                f"{answer.place}: {answer.axis} of surface {key[1]!r} by {key[0]!r} was answered before, at "
                f"{places[key]}. Keep one of the two answers."
            )
        value = _number(answer)
        if not low <= value <= high:
            outside.append(f"{value:g} at {answer.place}")
        places[key] = answer.place
        share = (value - low) / (high - low)
        bottom, top = RATING_SCALE
        values[key] = bottom + (top - bottom) * (1 - share if ratings.axes[answer.axis].turned else share)
    if outside:
        raise ValueError(
            f"{len(outside)} answers lie outside `scale` = [{low:g}, {high:g}]: {'; '.join(outside[:_FEW])}. Correct "
            "`scale`, or add what stands for no answer to `missing`."
        )
    return values


def _unused_scale(answers, scale):
    """A note where answers on all axes together leave more than half of the scale unused."""
    numbers = [_number(answer) for answer in answers]
    if len(numbers) < LEAST_ANSWERS:
        return
    low, high = min(numbers), max(numbers)
    if high - low < LEAST_USED * (scale[1] - scale[0]):
        yield (
            f"the answers run from {low:g} to {high:g}, less than half of `scale` = [{scale[0]:g}, {scale[1]:g}]: is "
            "`scale` right?"
        )


def _number(answer):
    try:
        value = float(answer.text.replace(",", "."))
    except ValueError:
        value = float("nan")
    if value != value:
        raise ValueError(
            f"{answer.place}: the answer {answer.text!r} on {answer.axis} is no number. Correct it, or add it to "
            "`missing`."
        )
    return value


def _check_axes(values, ratings, ignored, layout):
    for axis, theirs in ratings.axes.items():
        if not any(key[2] == axis for key in values):
            there = f"; the tables have {_few(list(ignored))}" if ignored else ""
            raise ValueError(f"{layout.path}: [ratings.axes] {axis} = {theirs.column!r} has no answer{there}.")
