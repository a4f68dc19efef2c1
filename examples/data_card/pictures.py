"""Pictures of a data card, drawn from its numbers. NaN is None in them, as in card.json."""

import numpy as np

#: Colours that people with any colour vision tell apart (Okabe and Ito 2008, "Color Universal Design").
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#000000")
#: More names than this on an axis cannot be read: they are left out, as is a table of them.
MOST_NAMES = 60
#: More explorers than this get no colour or column of their own.
MOST_EXPLORERS = len(COLOURS)


def unit_name(unit):
    """Name of a unit of force: "1" (uncalibrated) is a count."""
    return "count" if unit == "1" else unit


def draw_surfaces(card, path):
    """Nine bands, level and friction coefficient of each surface that has segments, the loudest on top."""
    from matplotlib.figure import Figure

    rows = sorted((row for row in card["surfaces"] if row["segments"]), key=lambda row: -row["level_db"])
    edges, unit = card["bands"]["edges"], unit_name(card["recordings"]["unit"])
    figure = Figure(figsize=(10.5, 1.6 + 0.13 * min(max(len(rows), 10), MOST_NAMES)), dpi=90, layout="constrained")
    bands, levels, friction = figure.subplots(1, 3, sharey=True, width_ratios=(3, 2, 2))
    image = bands.imshow([row["bands_db"] for row in rows], aspect="auto", interpolation="nearest")
    names = [f"{low:.0f}–\n{high:.0f}" for low, high in zip(edges[:-1], edges[1:], strict=True)]
    bands.set_xticks(range(len(names)), names, fontsize=7)
    bands.set(xlabel="band, Hz", title=f"band levels, dB re 1 {unit}")
    figure.colorbar(image, ax=bands, pad=0.01)
    if len(rows) > MOST_NAMES:
        bands.set_yticks([])
        bands.set_ylabel(f"{len(rows)} surfaces")
    else:
        bands.set_yticks(range(len(rows)), [row["name"][-24:] for row in rows], fontsize=6.5)
    _draw_by_explorer(levels, rows, "level_db")
    levels.set(xlabel=f"dB re 1 {unit}", title="level")
    _draw_by_explorer(friction, rows, "friction")
    friction.set(xlabel="mean lateral / mean normal force", title="friction coefficient")
    figure.savefig(path)


def _draw_by_explorer(panel, rows, key):
    """Mean and standard deviation of each surface as a bar, and the means of single explorers as dots."""
    # as floats, None is NaN
    mean, deviation = (np.array([row[name] for row in rows], float) for name in (key, f"{key}_std"))
    panel.errorbar(mean, range(len(rows)), xerr=deviation, fmt="k.", markersize=3, ecolor="lightgrey", elinewidth=2)
    explorers = sorted({who for row in rows for who in row["explorers"]})
    if 1 < len(explorers) <= MOST_EXPLORERS:
        for who, colour in zip(explorers, COLOURS, strict=False):
            values = np.array([row[f"{key}_explorers"].get(who) for row in rows], float)
            panel.plot(values, range(len(rows)), "o", color=colour, markersize=3, label=who)
        panel.legend(fontsize=7)
    panel.grid(alpha=0.3)


def draw_ratings(ratings, path):
    """How often each answer was given, axis by axis."""
    from matplotlib.figure import Figure

    axes = ratings["answers"]["axes"]
    figure = Figure(figsize=(3 * len(axes), 2.8), dpi=90, layout="constrained")
    for panel, (axis, entry) in zip(figure.subplots(1, len(axes), squeeze=False)[0], axes.items(), strict=True):
        panel.bar(range(len(entry["counts"])), entry["counts"], color=COLOURS[0])
        panel.set(title=axis, xlabel="answer, 0–8", ylabel="answers")
    figure.savefig(path)
