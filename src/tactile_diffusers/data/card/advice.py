"""Warnings of a data card: what is wrong or weak in the data, and what to do about it."""

from .selection import KEPT

#: Surfaces with fewer segments have levels and spectra that are known badly (recipe).
FEW_SEGMENTS = 10
#: A smaller share of the time kept means that the limits and the exploration do not fit (recipe).
LEAST_KEPT = 0.2
#: A larger share of the answers at one end of the scale hides differences beyond it (recipe).
MOST_AT_ONE_END = 0.25
#: A larger share of missing answers deserves a look (recipe).
MOST_MISSING = 0.1
#: Ratings with a smaller Cronbach's alpha are doubtful (Nunnally 1978, "Psychometric theory": a modest 0.7).
LEAST_ALPHA = 0.7
#: Fewer raters a surface leave too much chance in its rating (recipe).
FEW_RATERS = 5
#: A rater who correlates less with the mean of the others may have used the scale the other way round (recipe).
CONTRARY = -0.3
#: Axes that correlate more are hardly two axes (recipe).
LARGEST_CORRELATION = 0.8
#: Ratings whose largest correlation with the recordings comes about by chance more often may not belong to them.
CHANCE = 0.05
#: Beyond this, a correlation of the wrong sign between a rating and what causes it is no chance (recipe).
WRONG_WAY = 0.5
#: Turnarounds that raise a segment by more, in the median, are a large part of it (recipe).
TURNAROUND_DB = 1.0
#: Friction coefficients of fingers lie between; measured ones from 0.2 to 3 (FIELD section 5).
FRICTION_RANGE = (0.05, 5.0)


def warnings_of(card):
    """Everything in a card that is worth acting on.

    Args:
        card (`dict`): the numbers.

    Returns:
        `list[dict]`: "name" of the warning and "text": what is found and the remedy.
    """
    found = [*_of_channels(card["recordings"]), *_of_selection(card["kept"]), *_of_surfaces(card["surfaces"])]
    found += [
        *_of_splits(card["preparation"]["segments"]),
        *_of_friction(card["surfaces"]),
        *_of_turnarounds(card["turnarounds"]),
    ]
    if card["ratings"] is None:
        text = "there are no ratings: DALE cannot be trained, LCTG can. Add the group /ratings."
        return [*found, _warning("no_ratings", text)]
    return [*found, *_of_answers(card["ratings"]["answers"]), *_of_pooled(card["ratings"])]


def _of_splits(segments):
    """Evaluation needs two surfaces; where nothing was held out, a card alone is wanted."""
    held = {split: segments[split]["surfaces"] for split in ("validation", "test")}
    if any(held.values()) and min(held.values()) < 2:
        yield _warning(
            "few_held_out",
            f"{held['validation']} validation and {held['test']} test surfaces: evaluation needs 2 of each. Prepare "
            "with --test 2 --validation 2, and train on that.",
        )


def _warning(name, text):
    return {"name": name, "text": text}


def listed(names, most=5):
    """The first few names of a list, and how many more there are."""
    names = list(names)
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _of_channels(source):
    recordings, channels = source["recordings"], source["channels"]
    if source["unit"] == "1":
        yield _warning(
            "uncalibrated",
            "the force is uncalibrated (unit 1): levels are relative to one count, and a limit in newtons means "
            "nothing. Multiply by the sensor's newtons per count to compare levels with other data.",
        )
    if channels.get("lateral"):
        yield _warning(
            "lateral_only",
            f"{channels['lateral']} of {recordings} recordings have lateral force only: limits of normal force are "
            "skipped there, and the friction coefficient is unknown. Record normal force if you can.",
        )
    without = recordings - channels.get("velocity", 0)
    if without:
        yield _warning(
            "no_velocity",
            f"{without} of {recordings} recordings have no velocity: limits of speed are skipped there, and "
            "turnarounds cannot be found. Record position or velocity.",
        )


def _of_selection(kept):
    seconds, explorers = kept["seconds"], kept["explorers"]
    if kept["kept_share"] < LEAST_KEPT:
        largest = max((reason for reason in kept["reasons"] if reason != KEPT), key=seconds.get)
        yield _warning(
            "little_kept",
            f'only {100 * kept["kept_share"]:.1f} % of the time is kept; most of the rest is "{largest}" '
            f"({seconds[largest]:.0f} s). Widen that limit, or ask explorers to stay within it.",
        )
    for reason in kept["reasons"]:
        if "saturat" in reason and seconds[reason]:
            text = f"the sensor is saturated for {seconds[reason]:.2f} s, which is dropped. Raise the sensor's range."
            yield _warning("saturation", text)
        if "missing" in reason and seconds[reason]:
            lost = f"{seconds[reason]:.2f} s are" if seconds[reason] >= 0.01 else "single samples are"
            text = f"{lost} missing (NaN) and dropped, with what is near. Check the source for gaps."
            yield _warning("missing_samples", text)
    without = [who for who, reasons in explorers.items() if not reasons[KEPT]]
    if without:
        text = (
            f"{len(without)} of {len(explorers)} explorers have no segment: {listed(without)}. Look at their reasons."
        )
        yield _warning("explorer_without_segment", text)
    if len(explorers) == 1:
        text = "there is one explorer: how textures differ between fingers is not in these data. Add a second."
        yield _warning("one_explorer", text)


def _of_surfaces(surfaces):
    none = [row for row in surfaces if not row["segments"] and row["split"] != "hard"]  # held out, not lacking
    few = [row["name"] for row in surfaces if 0 < row["segments"] < FEW_SEGMENTS]
    if none:
        reasons = sorted({row["mostly_dropped"] for row in none})
        yield _warning(
            "surface_without_segment",
            f"{len(none)} of {len(surfaces)} surfaces have no segment: {listed(row['name'] for row in none)}. "
            f'Most of their time is "{listed(reasons)}": explore them again, or widen the limits.',
        )
    if few:
        yield _warning(
            "few_segments",
            f"{len(few)} of {len(surfaces)} surfaces have fewer than {FEW_SEGMENTS} segments: {listed(few)}. Their "
            "levels and spectra are uncertain: explore them longer.",
        )
    if len(surfaces) == 1:
        yield _warning("one_surface", "there is one surface: nothing can be learnt about ratings. Add others.")


def _of_friction(surfaces):
    rows = [row for row in surfaces if row["segments"]]
    unknown = [row["name"] for row in rows if row["friction"] is None]
    low, high = FRICTION_RANGE
    strange = [row["name"] for row in rows if row["friction"] is not None and not low <= row["friction"] <= high]
    if unknown:
        yield _warning(
            "unknown_friction",
            f"the friction coefficient is unknown for {len(unknown)} of {len(rows)} surfaces: DALE trains without it "
            "there, and slipperiness loses its main cue. It needs normal force and velocity.",
        )
    if strange:
        yield _warning(
            "strange_friction",
            f"the friction coefficient of {listed(strange)} lies outside {low:g}–{high:g}, where fingers are. Check "
            "zero, unit and axes of the force sensor.",
        )


def _of_turnarounds(turnarounds):
    change = turnarounds["median_db"]
    if change is not None and change > TURNAROUND_DB:
        yield _warning(
            "turnarounds",
            f"{100 * turnarounds['share']:.0f} % of the segments hold a turnaround, which raises them by "
            f"{change:.1f} dB in the median. Prepare with --turnarounds exclude or mask.",
        )


def _of_answers(answers):
    axes, unrated = answers["axes"], answers["surfaces_unrated"]
    if unrated:
        text = f"{len(unrated)} surfaces are not rated: {listed(unrated)}. Check their names in the ratings."
        yield _warning("unrated", text)
    low = {axis: entry["alpha"] for axis, entry in axes.items() if not (entry["alpha"] or 0) >= LEAST_ALPHA}
    if low:
        text = _axes({axis: "unknown" if alpha is None else f"{alpha:.2f}" for axis, alpha in low.items()})
        text = f"not reliable, by Cronbach's alpha: {text}; {LEAST_ALPHA} is wanted. Ask more raters."
        yield _warning("low_reliability", text)
    few = {axis: entry["most_raters"] for axis, entry in axes.items() if entry["most_raters"] < FEW_RATERS}
    if few:
        yield _warning("few_raters", f"raters a surface, at most: {_axes(few)}. Ask at least {FEW_RATERS}.")
    missing = _shares(axes, "missing_share", MOST_MISSING)
    if missing:
        yield _warning("missing_answers", f"answers missing: {missing}. Check how the source codes them.")
    for end, key in (("lowest", "low_end_share"), ("highest", "high_end_share")):
        clipped = _shares(axes, key, MOST_AT_ONE_END)
        if clipped:
            yield _warning(
                "clipped_ratings",
                f"answers that are the {end} of the scale: {clipped}. Differences beyond are lost: check how the scale "
                "was mapped to 0–8.",
            )
    for axis, entry in axes.items():
        contrary = [who for who, value in entry["with_others"].items() if value is not None and value < CONTRARY]
        if contrary:
            yield _warning(
                "contrary_raters",
                f"{listed(contrary)}: correlation with the other raters on {axis} below {CONTRARY}. Check the "
                "direction of their scale, or leave them out.",
            )


def _axes(values):
    return ", ".join(f"{axis} {value}" for axis, value in values.items())


def _shares(axes, key, most):
    """Axes on which a share is above `most`, with that share."""
    return _axes({axis: f"{100 * entry[key]:.0f} %" for axis, entry in axes.items() if (entry[key] or 0) > most})


def _of_pooled(ratings):
    axes, matrix, relation = list(ratings["pooled"]["counts"]), ratings["pooled"]["correlation"], ratings["relation"]
    for i, row in enumerate(matrix):
        for j, value in enumerate(row[:i]):
            if value is not None and abs(value) > LARGEST_CORRELATION:
                text = (
                    f"{axes[j]} and {axes[i]} correlate with {value:.2f}, so that their effects cannot be told apart."
                )
                yield _warning("correlated_axes", f"{text} Add surfaces on which they differ.")
    yield from _of_signs(relation["spearman"] if relation else {})
    if relation and relation["unrelated"] > CHANCE:
        yield _warning(
            "unrelated",
            f"over {relation['surfaces']} surfaces ratings and recordings look unrelated: their largest correlation, "
            f"{relation['largest']:.2f}, comes about by chance with probability {relation['unrelated']:.2f}. Check "
            "that both name the same surfaces.",
        )


def _of_signs(spearman):
    """Ratings that go the wrong way with what causes them: an axis was probably turned round."""
    for quantity, axis, sign in (("level", "roughness", 1), ("friction coefficient", "slipperiness", -1)):
        rho = spearman.get(quantity, {}).get(axis)
        if rho is not None and sign * rho < -WRONG_WAY:
            yield _warning(
                f"{axis}_turned",
                f"rated {axis} {'falls' if sign > 0 else 'rises'} with the {quantity} (correlation {rho:.2f}), where "
                "the opposite is usual. Check `high` of that axis in the layout.",
            )
