"""Warnings of a data card: what is wrong or weak in the data, and what to do about it.

Limits marked "recipe" are choices of ours that no source settles.
"""

#: Reason of the time that segments are cut from; all others are reasons why time was dropped.
KEPT = "used"
#: Fewer segments leave a surface's levels and spectrum uncertain; fewer raters leave its rating to chance (recipe).
FEW_SEGMENTS, FEW_RATERS = 10, 5
#: Share of the time kept; shares of answers at one end of the scale, and of missing answers (recipe).
LEAST_KEPT, MOST_AT_ONE_END, MOST_MISSING = 0.2, 0.25, 0.1
#: Ratings with a smaller Cronbach's alpha are doubtful (Nunnally 1978, "Psychometric theory": a modest 0.7).
LEAST_ALPHA = 0.7
#: A rater who correlates less with the others may have used the scale the other way round; axes that correlate more
#: are hardly two axes; a rating that correlates this much with its physical cause in the wrong direction (recipe).
CONTRARY, LARGEST_CORRELATION, WRONG_WAY = -0.3, 0.8, 0.5
#: Ratings whose largest correlation with the recordings comes about by chance more often may not belong to them.
CHANCE = 0.05
#: Turnarounds that raise a segment by more, in the median, are a large part of it (recipe).
TURNAROUND_DB = 1.0
#: Friction coefficients of fingers lie between; measured ones from 0.2 to 3.
FRICTION_RANGE = (0.05, 5.0)


def warnings_of(card):
    """Everything in a card that is worth acting on.

    Args:
        card (`dict`): the numbers.

    Returns:
        `list[dict]`: "name" of the warning and "text": the finding and the remedy.
    """
    found = [*_of_recordings(card), *_of_surfaces(card)]
    if card["ratings"] is None:
        found.append(("no_ratings", "there are no ratings: LCTG can be trained, DALE cannot. Add the group /ratings."))
    else:
        found += [*_of_answers(card["ratings"]["answers"]), *_of_pooled(**card["ratings"])]
    return [{"name": name, "text": text} for name, text in found]


def _listed(names, most=5):
    names = list(names)
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _of_recordings(card):
    source, kept, bands = card["recordings"], card["kept"], card["bands"]
    count, channels, seconds = source["recordings"], source["channels"], kept["seconds"]
    if source["unit"] == "1":
        yield (
            "uncalibrated",
            "the force is uncalibrated: levels are relative. Multiply by the sensor's newtons per count.",
        )
    if lateral := channels.get("lateral"):
        text = f"{lateral} of {count} recordings have lateral force only: the friction coefficient is unknown there."
        yield "lateral_only", f"{text} Record the normal force, too."
    if without := count - channels.get("velocity", 0):
        text = f"{without} of {count} recordings have no velocity: speed is not limited, turnarounds are not found."
        yield "no_velocity", f"{text} Record position or velocity."
    if kept["kept_share"] < LEAST_KEPT:
        most = max((reason for reason in seconds if reason != KEPT), key=seconds.get)
        text = f'only {100 * kept["kept_share"]:.1f} % of the time is kept; most of the rest is "{most}" '
        yield "little_kept", f"{text}({seconds[most]:.0f} s). Widen that limit, or ask explorers to stay within it."
    if lost := seconds["saturated"]:
        yield "saturation", f"the sensor is saturated for {lost:.2f} s, which is dropped. Raise the sensor's range."
    if lost := seconds["missing (NaN)"]:
        yield "missing_samples", f"{lost:.2g} s are missing (NaN) and dropped. Check the source for gaps."
    if without := [who for who, reasons in kept["explorers"].items() if not reasons[KEPT]]:
        text = f"{len(without)} of {len(kept['explorers'])} explorers have no segment: {_listed(without)}."
        yield "explorer_without_segment", f"{text} Look at the reasons in the table."
    if len(kept["explorers"]) == 1:
        yield "one_explorer", "there is one explorer: differences between fingers are not in the data. Add a second."
    held = [card["preparation"]["segments"][split]["surfaces"] for split in ("validation", "test")]
    if any(held) and min(held) < 2:  # where nothing was held out, the card alone is wanted
        text = f"{held[0]} validation and {held[1]} test surfaces: evaluation needs 2 of each."
        yield "few_held_out", f"{text} Prepare with --test 2 --validation 2, and train on that."
    if (bands["turnaround_db"] or 0) > TURNAROUND_DB:
        text = f"{100 * bands['turnaround_share']:.0f} % of the segments hold a turnaround, which raises them by "
        yield "turnarounds", f"{text}{bands['turnaround_db']:.1f} dB. Prepare with --turnarounds mask."


def _of_surfaces(card):
    surfaces, (low, high) = card["surfaces"], FRICTION_RANGE
    rows, count = [row for row in surfaces if row["segments"]], len(surfaces)
    if none := [row for row in surfaces if not row["segments"] and row["split"] != "hard"]:  # held out, not lacking
        reasons = _listed(sorted({row["mostly_dropped"] for row in none}))
        text = f"{len(none)} of {count} surfaces have no segment: {_listed(row['name'] for row in none)}. Most of "
        yield "surface_without_segment", f'{text}their time is "{reasons}": explore them again, or widen the limits.'
    if few := [row["name"] for row in rows if row["segments"] < FEW_SEGMENTS]:
        text = f"{len(few)} of {count} surfaces have fewer than {FEW_SEGMENTS} segments: {_listed(few)}."
        yield "few_segments", f"{text} Explore them longer."
    if count == 1:
        yield "one_surface", "there is one surface: nothing can be learned about ratings. Add others."
    if unknown := [row["name"] for row in rows if row["friction"] is None]:
        text = f"the friction coefficient of {len(unknown)} of {len(rows)} surfaces is unknown: slipperiness loses its "
        yield "unknown_friction", f"{text}main cue. Record normal force and velocity."
    if strange := [row["name"] for row in rows if row["friction"] is not None and not low <= row["friction"] <= high]:
        text = f"the friction coefficient of {_listed(strange)} lies outside {low:g}–{high:g}, the range of fingers."
        yield "strange_friction", f"{text} Check zero, unit and axes of the force sensor."


def _of_answers(answers):
    axes = answers["axes"]
    if unrated := answers["surfaces_unrated"]:
        yield "unrated", f"{len(unrated)} surfaces are not rated: {_listed(unrated)}. Check their names in the ratings."

    def on_axes(key, is_bad, form):
        """Axes with a bad value, and the value; None is unknown, and bad for a reliability alone."""
        values = {axis: entry[key] for axis, entry in axes.items() if is_bad(entry[key])}
        return ", ".join(f"{axis} {'unknown' if v is None else form.format(v)}" for axis, v in values.items())

    if low := on_axes("alpha", lambda alpha: alpha is None or alpha < LEAST_ALPHA, "{:.2f}"):
        yield "low_reliability", f"low Cronbach's alpha: {low}; {LEAST_ALPHA} is wanted. Ask more raters."
    if few := on_axes("most_raters", lambda raters: raters < FEW_RATERS, "{}"):
        yield "few_raters", f"raters a surface, at most: {few}. Ask at least {FEW_RATERS}."
    if missing := on_axes("missing_share", lambda share: (share or 0) > MOST_MISSING, "{:.0%}"):
        yield "missing_answers", f"answers missing: {missing}. Check how the source codes them."
    for end in ("low", "high"):
        if clipped := on_axes(f"{end}_end_share", lambda share: (share or 0) > MOST_AT_ONE_END, "{:.0%}"):
            text = f"answers at the {end}est end of the scale: {clipped}. Differences beyond are lost."
            yield "clipped_ratings", f"{text} Check how the scale was mapped to 0–8."
    for axis, entry in axes.items():
        if contrary := [who for who, r in entry["with_others"].items() if r is not None and r < CONTRARY]:
            text = f"{_listed(contrary)}: correlation with the other raters on {axis} below {CONTRARY}."
            yield "contrary_raters", f"{text} Check the direction of their scale, or leave them out."


def _of_pooled(pooled, relation, answers):
    axes, matrix = list(pooled["std"]), pooled["correlation"]
    for i, j in ((1, 0), (2, 0), (2, 1)):
        if abs(matrix[i][j] or 0) > LARGEST_CORRELATION:
            text = f"{axes[j]} and {axes[i]} correlate with {matrix[i][j]:.2f}: their effects cannot be separated."
            yield "correlated_axes", f"{text} Add surfaces on which they differ."
    if relation is None:
        return
    for quantity, axis, sign in (("level", "roughness", 1), ("friction coefficient", "slipperiness", -1)):
        rho = relation["spearman"].get(quantity, {}).get(axis)
        if rho is not None and sign * rho < -WRONG_WAY:
            text = (
                f"rated {axis} {'falls' if sign > 0 else 'rises'} with the {quantity} (correlation {rho:.2f}), where "
            )
            yield f"{axis}_turned", f"{text}the opposite is usual. Check `high` of that axis in the layout."
    if relation["unrelated"] > CHANCE:
        text = f"over {relation['surfaces']} surfaces the largest correlation of ratings and recordings, "
        text += f"{relation['largest']:.2f}, comes about by chance with probability {relation['unrelated']:.2f}."
        yield "unrelated", f"{text} Check that both name the same surfaces."
