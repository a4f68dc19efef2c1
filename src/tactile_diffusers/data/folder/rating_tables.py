"""Tables of raters' answers, long or wide, as `RaterScores` on the 0-8 scale."""

import re
from difflib import SequenceMatcher
from pathlib import Path

import numpy as np
import pandas as pd

from ...signal import RATING_AXES
from ...signal.rating_scales import RATING_SCALE
from ..recordings import RaterScores
from .sources import Source, files_below, matching_places
from .tables import few

#: So many answers, or more, that use a smaller share of the scale are probably on another one (recipe).
LEAST_ANSWERS, LEAST_USED = 10, 0.5
#: Names of surfaces less alike than this (`SequenceMatcher.ratio`) are not paired (recipe).
LEAST_ALIKE = 0.6
_KEY = ["rater", "surface", "axis"]


def rated_surfaces(root, layout):
    """Names of the surfaces in the ratings, as they are written there, and those that `[surface_names]` gives them."""
    rated = () if layout.ratings is None else _answers(root, layout)["surface"].unique()
    return {*rated, *layout.surface_names.values()} - {""}


def _answers(root, layout):
    """All answers, as they are written."""
    root, ratings = Path(root), layout.ratings
    places = matching_places(root, files_below(root), ratings, f"{layout.path}: [ratings]")
    read = _wide if ratings.form == "wide" else _long
    parts = [read(_table(Source(ratings, path, inside)), ratings, fields) for path, inside, fields in places]
    return pd.concat(parts, ignore_index=True)


def _table(source):
    """A table of answers; where its header is not where it should be, below a title for example, it is found."""
    table, ratings = source.table(), source.files
    named = {ratings.rater, ratings.surface, ratings.axis, ratings.answer}
    named |= {axis.column for axis in ratings.axes.values() if ratings.form == "long" and ratings.answer is None}
    named = {column for column in named if isinstance(column, str)}
    return table if named <= set(table.names) else source.table(header=None)


def read_ratings(root, layout, surfaces, explorers=()):
    """The answers on the recorded `surfaces` that `[ratings]` of a layout describes, `RaterScores`, and notes.

    Missing answers are NaN, and raters may have rated different surfaces. Axes that the layout does not name are
    ignored. An axis whose `high` is our low word is turned round, and the scale is mapped linearly to 0-8.

    Raises:
        ValueError: naming file, line, value and remedy, if no table matches, a column is missing, an answer is no
            number, off the scale or given twice, or names of surfaces do not match on both sides.
    """
    ratings, answers = layout.ratings, _answers(root, layout)
    answers = answers[(answers["text"] != "") & ~answers["text"].isin(ratings.missing)]
    ours = {str(axis.column): name for name, axis in ratings.axes.items()}
    ignored = [name for name in answers["axis"].unique() if name and name not in ours]
    answers = answers[answers["axis"].isin(list(ours))]
    answers = answers.assign(axis=answers["axis"].map(ours))
    for row in answers[(answers["rater"] == "") | (answers["surface"] == "")].head(1).itertuples():
        raise ValueError(
            f"{row.place}: the answer {row.text!r} on {row.axis} has no {'surface' if row.rater else 'rater'}."
        )
    answers, notes = _on_recorded(answers, layout, surfaces, explorers)
    for axis, theirs in ratings.axes.items():
        if not (answers["axis"] == axis).any():
            there = f"; the tables have {few(ignored)}" if ignored else ""
            raise ValueError(f"{layout.path}: [ratings.axes] {axis} = {theirs.column!r} has no answer{there}.")
    answers = answers.assign(number=_numbers(answers, ratings))
    low, high = ratings.scale
    least, most = answers["number"].min(), answers["number"].max()
    if len(answers) >= LEAST_ANSWERS and most - least < LEAST_USED * (high - low):
        used = f"the answers run from {least:g} to {most:g}, less than half of `scale` = [{low:g}, {high:g}]"
        notes.append(f"{used}: is `scale` right?")
    axes = tuple(sorted(ratings.axes, key=lambda axis: (RATING_AXES + (axis,)).index(axis)))
    scores = _scores(answers, ratings, surfaces, axes)
    if missing := int(np.isnan(scores.values).sum()):
        notes.append(f"{missing} of {scores.values.size} answers (raters x surfaces x axes) are missing")
    if absent := [axis for axis in RATING_AXES if axis not in axes]:
        notes.append(f"the layout names no {' and no '.join(absent)}")
    if ignored:
        notes.append(f"axes that the layout does not name are ignored: {few(ignored)}")
    return scores, notes


def _long(table, ratings, fields):
    """Answers of a table with a row per answer, or per rater and surface; the axis is called as in the table."""

    def texts(column, name):
        return fields[name] if column is None else table.text(column)

    frame = pd.DataFrame({"place": [f"{table.where}, {table.place(row)}" for row in range(table.rows)]}, dtype=object)
    frame = frame.assign(rater=texts(ratings.rater, "rater"), surface=texts(ratings.surface, "surface"))
    if ratings.answer is not None:
        return frame.assign(axis=texts(ratings.axis, "axis"), text=table.text(ratings.answer))
    columns = [frame.assign(axis=str(axis.column), text=table.text(axis.column)) for axis in ratings.axes.values()]
    return pd.concat(columns).sort_index(kind="stable")  # row by row, so that the first fault is named


def _wide(table, ratings, fields):
    """Answers of a table of one axis, raters x surfaces or the other way round; the first column names the rows."""
    columns = [pd.DataFrame(columns=[*_KEY, "text", "place"], dtype=object)]
    for name in table.names[1:]:
        places = [f"{table.where}, {table.place(row)}, column {name!r}" for row in range(table.rows)]
        answers = pd.DataFrame({"place": places, "text": table.text(name), ratings.rows: table.text(0)}, dtype=object)
        columns.append(answers.assign(**{ratings.columns: name, "axis": fields["axis"]}))
    return pd.concat(columns)


def _on_recorded(answers, layout, surfaces, explorers):
    """The answers on recorded surfaces, under the names of the recordings, and notes on the others."""
    renamed = layout.surface_names
    rated = {name: renamed.get(name, name) for name in answers["surface"].unique()}
    if unused := [name for name in renamed if name not in rated]:
        raise ValueError(
            f"{layout.path}: [surface_names] renames {unused}, which the ratings do not hold: {few(rated)}."
        )
    # "" as a new name means: leave these answers out
    unknown = [name for name, meant in rated.items() if meant not in {*surfaces, ""}]
    unrated = [name for name in surfaces if name not in rated.values()]
    if unknown and unrated:
        words = {word: name for name in unknown for word in re.split("[ _-]+", name)[1:] if not word.isdigit()}
        inner = [(words.get(word), name) for name in explorers for word in re.split("[ _-]+", name)]
        for name, explorer in [pair for pair in inner if pair[0]][:1]:
            raise ValueError(
                f"{layout.path}: `pattern` splits names of surfaces: a part of {name!r} of the ratings is in the "
                f"explorer {explorer!r}. Say under [surface_names] what the files call it, all its words, or give each "
                'explorer\'s files a [[files]] of their own, with for example `where` = { explorer = "Ann" }.'
            )
        suggested = pair_names(unknown, unrated)
        lines = "\n".join(f'    "{name}" = "{suggested[name]}"' for name in unknown[:8])
        raise ValueError(
            f"{layout.path}: names of surfaces do not match. Only in the ratings: {few(unknown)}. Only in the "
            f"recordings: {few(unrated)}. Say which is which under [surface_names], for example\n{lines}\n"
            'where "" leaves the answers on a surface out.'
        )
    notes = [f"answers on {few(unknown)} left out: there is no recording"] if unknown else []
    notes += [f"{len(unrated)} recorded surfaces have no answers: {few(unrated)}"] if unrated else []
    answers = answers.assign(surface=answers["surface"].map(rated))
    return answers[answers["surface"].isin(surfaces)], notes


def pair_names(names, candidates):
    """What each name of a surface probably means: name -> a candidate, or "".

    The most alike are paired first, the same numbers before a close spelling. No candidate is given twice, which would
    merge the answers on two surfaces.
    """
    alike = [(_likeness(name, other), name, other) for name in names for other in candidates]
    paired = dict.fromkeys(names, "")
    for likeness, name, other in sorted(alike, key=lambda pair: -pair[0]):
        if likeness >= LEAST_ALIKE and not paired[name] and other not in paired.values():
            paired[name] = other
    return paired


def _likeness(name, other):
    """Share of letters in common; 1 more for the same numbers, 0 for other numbers."""
    numbers, others = ([int(digits) for digits in re.findall(r"\d+", text)] for text in (name, other))
    if numbers and others and numbers != others:
        return 0.0
    return bool(numbers and others) + SequenceMatcher(None, name.casefold(), other.casefold()).ratio()


def _numbers(answers, ratings):
    """The answers as numbers on their own scale, checked."""
    numbers = pd.to_numeric(answers["text"].str.replace(",", "."), errors="coerce")
    for row in answers[numbers.isna()].head(1).itertuples():
        raise ValueError(
            f"{row.place}: the answer {row.text!r} on {row.axis} is no number. Correct it, or add it to `missing`."
        )
    for row in answers[answers.duplicated(_KEY)].head(1).itertuples():
        same = (answers[_KEY] == [row.rater, row.surface, row.axis]).all(axis=1)
        raise ValueError(
            f"{row.place}: {row.axis} of surface {row.surface!r} by {row.rater!r} was answered before, at "
            f"{answers['place'][same].iloc[0]}. Keep one of the two answers."
        )
    low, high = ratings.scale
    outside = answers.assign(number=numbers)[~numbers.between(low, high)]
    if len(outside):
        listed = "; ".join(f"{row.number:g} at {row.place}" for row in outside.head(8).itertuples())
        raise ValueError(
            f"{len(outside)} answers lie outside `scale` = [{low:g}, {high:g}]: {listed}. Correct `scale`, or add what "
            "stands for no answer to `missing`."
        )
    return numbers


def _scores(answers, ratings, surfaces, axes):
    """The answers on the 0-8 scale, in order of the raters' first answers, the recordings and our axes."""
    low, high = ratings.scale
    share = (answers["number"] - low) / (high - low)
    share = share.where(~answers["axis"].map(ratings.is_turned), 1 - share)
    raters = tuple(answers["rater"].unique())
    rated = tuple(name for name in surfaces if name in set(answers["surface"]))
    values = np.full((len(raters), len(rated), len(axes)), np.nan, dtype=np.float32)
    places = [pd.Index(names).get_indexer(answers[key]) for key, names in zip(_KEY, (raters, rated, axes), strict=True)]
    values[tuple(places)] = RATING_SCALE[0] + (RATING_SCALE[1] - RATING_SCALE[0]) * share
    return RaterScores(values, raters, rated, axes)
