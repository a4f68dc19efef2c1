"""Warnings of a data card: what is wrong or weak in the data, and what to do about it.

Limits marked "recipe" are choices of ours that no source settles.
"""

from .measure import KEPT

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
    found = [*_of_source(card["recordings"]), *_of_selection(card["kept"])]
    found += [*_of_surfaces(card["surfaces"]), *_of_preparation(card["preparation"]["segments"], card["bands"])]
    if card["ratings"] is None:
        found.append(("no_ratings", "there are no ratings: DALE cannot be trained, LCTG can. Add the group /ratings."))
    else:
        found += [*_of_answers(card["ratings"]["answers"]), *_of_pooled(card["ratings"])]
    return [{"name": name, "text": text} for name, text in found]


def listed(names, most=5):
    """The first few names of a list, and how many more there are."""
    names = list(names)
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _of_source(source):
    recordings, channels = source["recordings"], source["channels"]
    if source["unit"] == "1":
        text = (
            "the force is uncalibrated (unit 1): levels are relative to one count, and limits in newtons mean nothing. "
        )
        yield "uncalibrated", text + "Multiply by the sensor's newtons per count to compare levels with other data."
    if lateral := channels.get("lateral"):
        text = (
            f"{lateral} of {recordings} recordings have lateral force only: limits of normal force are skipped there, "
        )
        yield "lateral_only", text + "and the friction coefficient is unknown. Record normal force if you can."
    if without := recordings - channels.get("velocity", 0):
        text = f"{without} of {recordings} recordings have no velocity: limits of speed are skipped there, and "
        yield "no_velocity", text + "turnarounds cannot be found. Record position or velocity."


def _of_selection(kept):
    seconds, explorers = kept["seconds"], kept["explorers"]
    if kept["kept_share"] < LEAST_KEPT:
        largest = max((reason for reason in kept["reasons"] if reason != KEPT), key=seconds.get)
        text = f'only {100 * kept["kept_share"]:.1f} % of the time is kept; most of the rest is "{largest}" '
        text += f"({seconds[largest]:.0f} s). Widen that limit, or ask explorers to stay within it."
        yield "little_kept", text
    if lost := seconds["saturated"]:
        yield "saturation", f"the sensor is saturated for {lost:.2f} s, which is dropped. Raise the sensor's range."
    if lost := seconds["missing (NaN)"]:
        lost = f"{lost:.2f} s are" if lost >= 0.01 else "single samples are"
        text = f"{lost} missing (NaN) and dropped, with their neighbours. Check the source for gaps."
        yield "missing_samples", text
    if without := [who for who, reasons in explorers.items() if not reasons[KEPT]]:
        text = f"{len(without)} of {len(explorers)} explorers have no segment: {listed(without)}. "
        yield "explorer_without_segment", text + "Look at the reasons in the table."
    if len(explorers) == 1:
        text = "there is one explorer: the data do not show how textures differ between fingers. Add a second."
        yield "one_explorer", text


def _of_surfaces(surfaces):
    rows, count = [row for row in surfaces if row["segments"]], len(surfaces)
    if none := [row for row in surfaces if not row["segments"] and row["split"] != "hard"]:  # held out, not lacking
        text = f"{len(none)} of {count} surfaces have no segment: {listed(row['name'] for row in none)}. Most of their "
        text += f'time is "{listed(sorted({row["mostly_dropped"] for row in none}))}": '
        yield "surface_without_segment", text + "explore them again, or widen the limits."
    if few := [row["name"] for row in rows if row["segments"] < FEW_SEGMENTS]:
        text = f"{len(few)} of {count} surfaces have fewer than {FEW_SEGMENTS} segments: {listed(few)}. Their levels "
        yield "few_segments", text + "and spectra are uncertain: explore them longer."
    if count == 1:
        yield "one_surface", "there is one surface: nothing can be learned about ratings. Add others."
    if unknown := [row["name"] for row in rows if row["friction"] is None]:
        text = (
            f"the friction coefficient is unknown for {len(unknown)} of {len(rows)} surfaces: DALE trains without it "
        )
        yield "unknown_friction", text + "there, and slipperiness loses its main cue. Record normal force and velocity."
    low, high = FRICTION_RANGE
    if strange := [row["name"] for row in rows if row["friction"] is not None and not low <= row["friction"] <= high]:
        text = f"the friction coefficient of {listed(strange)} lies outside {low:g}–{high:g}, the range of fingers. "
        yield "strange_friction", text + "Check zero, unit and axes of the force sensor."


def _of_preparation(segments, bands):
    held = [segments[split]["surfaces"] for split in ("validation", "test")]
    if any(held) and min(held) < 2:  # where nothing was held out, the card alone is wanted
        text = f"{held[0]} validation and {held[1]} test surfaces: evaluation needs 2 of each. "
        yield "few_held_out", text + "Prepare with --test 2 --validation 2, and train on that."
    change = bands["turnaround_db"]
    if change is not None and change > TURNAROUND_DB:
        text = f"{100 * bands['turnaround_share']:.0f} % of the segments hold a turnaround, which raises them by "
        yield "turnarounds", text + f"{change:.1f} dB in the median. Prepare with --turnarounds exclude or mask."


def _of_answers(answers):
    axes = answers["axes"]
    if unrated := answers["surfaces_unrated"]:
        yield "unrated", f"{len(unrated)} surfaces are not rated: {listed(unrated)}. Check their names in the ratings."
    low = {axis: entry["alpha"] for axis, entry in axes.items() if not (entry["alpha"] or 0) >= LEAST_ALPHA}
    if low:
        text = _axes({axis: "unknown" if alpha is None else f"{alpha:.2f}" for axis, alpha in low.items()})
        yield "low_reliability", f"low Cronbach's alpha: {text}; {LEAST_ALPHA} is wanted. Ask more raters."
    if few := {axis: entry["most_raters"] for axis, entry in axes.items() if entry["most_raters"] < FEW_RATERS}:
        yield "few_raters", f"raters a surface, at most: {_axes(few)}. Ask at least {FEW_RATERS}."
    if missing := _shares(axes, "missing_share", MOST_MISSING):
        yield "missing_answers", f"answers missing: {missing}. Check how the source codes them."
    for end, key in (("lowest", "low_end_share"), ("highest", "high_end_share")):
        if clipped := _shares(axes, key, MOST_AT_ONE_END):
            text = (
                f"answers at the {end} end of the scale: {clipped}. Differences beyond are lost: check how the scale "
            )
            yield "clipped_ratings", text + "was mapped to 0–8."
    for axis, entry in axes.items():
        if contrary := [who for who, r in entry["with_others"].items() if r is not None and r < CONTRARY]:
            text = f"{listed(contrary)}: correlation with the other raters on {axis} below {CONTRARY}. Check the "
            yield "contrary_raters", text + "direction of their scale, or leave them out."


def _axes(values):
    return ", ".join(f"{axis} {value}" for axis, value in values.items())


def _shares(axes, key, most):
    """Axes on which a share is above `most`, with that share."""
    return _axes({axis: f"{100 * entry[key]:.0f} %" for axis, entry in axes.items() if (entry[key] or 0) > most})


def _of_pooled(ratings):
    axes, matrix, relation = list(ratings["pooled"]["counts"]), ratings["pooled"]["correlation"], ratings["relation"]
    for i, j in ((1, 0), (2, 0), (2, 1)):
        if abs(matrix[i][j] or 0) > LARGEST_CORRELATION:
            text = f"{axes[j]} and {axes[i]} correlate with {matrix[i][j]:.2f}: their effects cannot be separated. "
            yield "correlated_axes", text + "Add surfaces on which they differ."
    if relation is None:
        return
    for quantity, axis, sign in (("level", "roughness", 1), ("friction coefficient", "slipperiness", -1)):
        rho = relation["spearman"].get(quantity, {}).get(axis)
        if rho is not None and sign * rho < -WRONG_WAY:
            text = (
                f"rated {axis} {'falls' if sign > 0 else 'rises'} with the {quantity} (correlation {rho:.2f}), where "
            )
            yield f"{axis}_turned", text + "the opposite is usual. Check `high` of that axis in the layout."
    if relation["unrelated"] > CHANCE:
        text = (
            f"over {relation['surfaces']} surfaces ratings and recordings look unrelated: their largest correlation, "
        )
        text += f"{relation['largest']:.2f}, comes about by chance with probability {relation['unrelated']:.2f}. "
        yield "unrelated", text + "Check that both name the same surfaces."
