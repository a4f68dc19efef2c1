"""The report of a study: Markdown and pictures."""

import json

import numpy as np
from report.baselines import NAMES
from report.figures import figure_panels
from report.tables import markdown_table, title

from tactile_diffusers.io.files import write_text

from .analysis import LEAST_PARTICIPANTS, RESAMPLES, abx_proportion_correct, abx_scores, describe, similarity_scores
from .stimuli import GENERATED, OTHER_TAKE, RECONSTRUCTED, REFERENCE
from .trials import OTHER_SURFACE, RATING, SCALES, ends_of

SIMULATED_NOTE = "SIMULATED participants: no person felt anything. This shows what the design can find, no result."
LABELS = {
    REFERENCE: "reference take",
    OTHER_TAKE: "another take",
    RECONSTRUCTED: "reconstructed",
    GENERATED: "generated from ratings",
    **{slug: name for slug, name in NAMES.items() if slug != OTHER_TAKE},
    OTHER_SURFACE: "reference of another surface",
}
#: Task -> heading, columns of the table, and a note.
_TASKS = {
    "abx": (
        "ABX",
        {
            "proportion_correct": "proportion correct",
            "dprime": "d′",
            "difference": "proportion minus that of another take",
        },
        "Against the reference take of the same surface; 0.5 is guessing. d′ is that of the mean proportion "
        "(differencing model, Macmillan and Creelman). Another take may be told apart as well, so compare with it: a "
        "difference whose interval lies above 0 is told apart more easily. A negative d′ is a result below guessing.",
    ),
    "similarity": (
        "Similarity",
        {"similarity": ("similarity, 0–100", 1), "difference": ("minus that of another take", 1)},
        "To the reference take. Another take is the highest that can be expected, another surface the low end.",
    ),
    "ratings": (
        "Ratings",
        {
            "slope": "slope",
            "difference": "slope minus that of the reference take",
            "correlation": "correlation",
            "spread": "spread over participants",
        },
        "Answers (0–8) against the requested ratings (z-scores of the surface), over surfaces. The slope of real takes "
        "is the best that this device and these participants allow. Where levels are matched, every texture has the "
        "level of its surface, so a baseline that knows no ratings has the slope that levels alone give.",
    ),
}


def label(condition):
    """The name of a condition in tables."""
    return LABELS.get(condition, condition)


def _ordered(conditions):
    """Real textures first, then ours, then baselines, then the low end."""
    order = list(LABELS)
    return sorted(conditions, key=lambda condition: order.index(condition) if condition in order else len(order))


def write_report(folder, report, key, answers):
    """Writes report.json, report.md and the pictures of the tasks that were done; `report` is of `analyse`."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "report.json", json.dumps(report, indent=1, allow_nan=False) + "\n")
    plots = {"abx": _plot_abx, "similarity": _plot_similarity, "ratings": _plot_ratings}
    for name, plot in plots.items():
        if report[name] is not None:
            plot(report, describe(key, answers), folder / f"{name}.png")
    write_text(folder / "report.md", report_markdown(report))


def report_markdown(report):
    """The report as Markdown with tables and links to the pictures."""
    counts = ", ".join(f"{count} {task}" for task, count in report["answers"].items())
    head = f"**{SIMULATED_NOTE}**\n\n" if report["simulated"] else ""
    head += (
        f"{report['participants']} participants; answers: {counts}; {report['missing']} trials not answered. Brackets: "
        f"95 % intervals by bootstrap over participants ({RESAMPLES} resamples, bias-corrected and accelerated, "
        f"widened for few participants), from {LEAST_PARTICIPANTS} participants on. They hold for these surfaces. No "
        "correction for many comparisons."
    )
    parts = [title("Study", 1) + head]
    for task, (heading, columns, note) in _TASKS.items():
        if report[task]:
            table = markdown_table(_rows(report[task], task), labels=columns, interval=True)
            parts.append(f"{title(heading, 2)}{note}\n\n{table}\n\n![{task}]({task}.png)")
    if report["ratings"]:
        columns = {"mean_correlation": "mean correlation of pairs", "alpha": "Cronbach's alpha", "pairs": "pairs"}
        parts.append(title("Agreement of participants", 2) + markdown_table(report["reliability"], labels=columns))
    return "\n\n".join(parts) + "\n"


def _rows(entries, task):
    conditions = _ordered(entries)
    if task != "ratings":
        return {label(condition): entries[condition] for condition in conditions}
    axes = _axes(entries)
    pairs = ((axis, condition) for axis in axes for condition in conditions if axis in entries[condition])
    return {f"{label(condition)}: {axis}": entries[condition][axis] for axis, condition in pairs}


def _axes(entries):
    """Axes that are the keys of each condition's entry, each once."""
    return list(dict.fromkeys(axis for entry in entries.values() for axis in entry))


def _heading(report, text):
    return f"{text}\nsimulated participants, no human result" if report["simulated"] else text


def _plot_conditions(panel, leaves, scores):
    """A mean with its interval for each condition, and the participants as dots beside it."""
    names = _ordered(leaves)
    for place, name in enumerate(names):
        own = scores[name].dropna().to_numpy()
        beside = place - 0.15 + 0.1 * np.linspace(-1, 1, len(own)) * (len(own) > 1)
        panel.plot(beside, own, ".", color="grey", alpha=0.6, markersize=5)
        leaf = leaves[name]
        bounds = leaf["interval"] or [leaf["mean"]] * 2
        reach = np.abs(np.array(bounds) - leaf["mean"])[:, None]
        panel.errorbar([place + 0.12], [leaf["mean"]], reach, fmt="o", color="C0", capsize=4)
    panel.set_xticks(range(len(names)), [label(name).replace(" (", "\n(") for name in names], rotation=20, ha="right")


def _plot_abx(report, described, path):
    leaves = {condition: entry["proportion_correct"] for condition, entry in report["abx"].items()}
    with figure_panels(path, 1, 1, (1.6 + 1.5 * len(leaves), 4.6)) as panels:
        panel, scores, ticks = panels[0, 0], abx_scores(described), [0, 1, 2, 3, 4]
        _plot_conditions(panel, leaves, scores)
        panel.axhline(0.5, color="black", linestyle="--", linewidth=1)
        low = min(0.4, scores.min(axis=None)) - 0.03
        panel.set(ylim=(low, 1.03), ylabel="proportion correct", title=_heading(report, "ABX"))
        right = panel.twinx()
        right.set(ylim=panel.get_ylim(), ylabel="d′")
        right.set_yticks(abx_proportion_correct(ticks), ticks)


def _plot_similarity(report, described, path):
    leaves = {condition: entry["similarity"] for condition, entry in report["similarity"].items()}
    low, high = SCALES["similarity"]
    with figure_panels(path, 1, 1, (1.6 + 1.5 * len(leaves), 4.6)) as panels:
        _plot_conditions(panels[0, 0], leaves, similarity_scores(described))
        heading = _heading(report, "similarity to the reference take")
        panels[0, 0].set(ylim=(low - 3, high + 3), ylabel="similarity", title=heading)


def _plot_ratings(report, described, path):
    """Mean answer of the participants to each texture against the requested rating, and the line through them."""
    rated = described[described["task"] == RATING]
    means = rated.groupby(["axis", "condition", "stimulus_a"])[["asked", "value"]].mean()
    low, high = SCALES[RATING]
    axes = _axes(report["ratings"])
    with figure_panels(path, 1, len(axes), (14 / 3 * len(axes), 5.2)) as panels:
        for panel, axis in zip(panels[0], axes, strict=True):
            for name in (name for name in _ordered(report["ratings"]) if axis in report["ratings"][name]):
                requested, answers = means.loc[(axis, name)].to_numpy().T
                [dots] = panel.plot(requested, answers, "o", markersize=4, label=label(name))
                if np.ptp(requested) > 0:
                    ends = np.array([requested.min(), requested.max()])
                    line = np.polyval(np.polyfit(requested, answers, 1), ends)
                    panel.plot(ends, line, color=dots.get_color(), linewidth=1)
            zero, full = ends_of(axis)
            panel.set(ylim=(low - 0.2, high + 0.2), xlabel=f"requested {axis}, z")
            panel.set_ylabel(f"answer: {low:g} {zero}, {high:g} {full}")
        panels[0, 0].figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=6)
        panels[0, (len(axes) - 1) // 2].set_title(_heading(report, "ratings: mean over participants"))


_POWER_NOTE = (
    "Share of simulated studies whose 95 % interval over participants leaves out what there would be if there were "
    "nothing to find: guessing, no difference from another take, no slope. For a condition that is assumed to equal "
    "another take it is the rate of false alarms, about 0.05 from eight participants on. Change the assumptions below "
    "by `--dprime` and `--rating_share`."
)
_POWER_COLUMNS = {
    "abx_above_chance": "ABX above guessing",
    "abx_unlike_other_take": "ABX unlike another take",
    "similarity_unlike_other_take": "similarity unlike another take",
}


def power_markdown(facts, population, conditions):
    """Power of a design as Markdown.

    Args:
        facts (`dict`): "participants", "repeats" and "power" (of `simulated.power`).
        population (`Population`): the assumptions.
        conditions (`Sequence[str]`): of the study.
    """
    shares = facts["power"]
    counts = f"{facts['participants']} participants, {facts['repeats']} simulated studies."
    parts = [f"{title('Power of the design', 1)}**{SIMULATED_NOTE}**\n\n{counts} {_POWER_NOTE}"]
    compared = _ordered({condition for measure in _POWER_COLUMNS for condition in shares.get(measure, {})})
    if compared:
        rows = {label(n): {measure: shares.get(measure, {}).get(n) for measure in _POWER_COLUMNS} for n in compared}
        parts.append(markdown_table(rows, labels=_POWER_COLUMNS))
    slopes = {}
    for place, share in shares.get("slope_unlike_zero", {}).items():
        condition, axis = place.split(": ")
        slopes.setdefault(condition, {})[axis] = share
    if slopes:
        labels = {axis: f"slope of {axis} unlike 0" for axis in _axes(slopes)}
        parts.append(markdown_table({label(name): slopes[name] for name in _ordered(slopes)}, labels=labels))
    assumed = {
        label(name): {"dprime": population.dprime_of(name), "rating_share": population.rating_share_of(name)}
        for name in _ordered({*conditions, OTHER_SURFACE})
    }
    del assumed[label(OTHER_SURFACE)]["rating_share"], assumed[label(REFERENCE)]["dprime"]
    labels = {"dprime": "d′ from the reference", "rating_share": "share of the rating that is felt"}
    parts.append(title("Assumptions", 2) + markdown_table(assumed, labels=labels))
    return "\n\n".join(parts) + "\n"
