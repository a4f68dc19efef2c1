"""Pictures of a data card, drawn from its numbers. NaN is None in them, as in card.json."""

from contextlib import contextmanager

import numpy as np

from ...signal import RATING_AXES

_DPI = 90
SURFACES, RATINGS = "surfaces.png", "ratings.png"
#: Colours that people with any colour vision tell apart (Okabe and Ito 2008, "Color Universal Design").
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#F0E442", "#000000")
#: More names than this on an axis cannot be read: they are left out.
MOST_NAMES = 60
#: More explorers than this get no colour or row of their own.
MOST_EXPLORERS = 7


@contextmanager
def _panels(path, rows, columns, size, **options):
    """Yields an array of panels, then writes the PNG with 256 colours: a third of the size, and no visible loss."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL import Image

    figure = Figure(figsize=size, dpi=_DPI, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    yield figure.subplots(rows, columns, squeeze=False, **options)
    canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    image.quantize(256, Image.Quantize.MAXCOVERAGE).save(path, optimize=True)


def unit_name(unit):
    """Name of a unit of force: "1" (uncalibrated) is a count."""
    return "count" if unit == "1" else unit


def draw_all(card, folder):
    """Draws every picture that the numbers of a card allow, as PNGs in `folder`; returns their names."""
    draw_surfaces(card["surfaces"], card["bands"]["edges"], unit_name(card["recordings"]["unit"]), folder / SURFACES)
    if card["ratings"]:
        draw_ratings(card["ratings"], folder / RATINGS)
    return [SURFACES, RATINGS] if card["ratings"] else [SURFACES]


def draw_surfaces(surfaces, edges, unit, path):
    """Nine bands, level and friction coefficient of each surface that has segments, the loudest on top."""
    rows = sorted((row for row in surfaces if row["segments"]), key=lambda row: -row["level_db"])
    known = any(row["friction"] is not None for row in rows)
    height = 1.6 + 0.13 * min(max(len(rows), 10), MOST_NAMES)
    ratios = (3, 2, 2) if known else (3, 2)
    with _panels(path, 1, len(ratios), (10.5, height), sharey=True, width_ratios=ratios) as panels:
        bands, levels = panels[0, :2]
        image = bands.imshow([row["bands_db"] for row in rows], aspect="auto", cmap="viridis", interpolation="nearest")
        names = [f"{low:.0f}–\n{high:.0f}" for low, high in zip(edges[:-1], edges[1:], strict=True)]
        bands.set_xticks(range(len(names)), names, fontsize=7)
        bands.set(xlabel="band, Hz", title=f"band levels, dB re 1 {unit}")
        bands.figure.colorbar(image, ax=bands, pad=0.01)
        if len(rows) > MOST_NAMES:
            bands.set_yticks([])
            bands.set_ylabel(f"{len(rows)} surfaces")
        else:
            short = [name if len(name := row["name"]) <= 24 else f"{name[:13]}…{name[-10:]}" for row in rows]
            bands.set_yticks(range(len(rows)), short, fontsize=6.5)
        _draw_by_explorer(levels, rows, "level_db")
        levels.set(xlabel=f"dB re 1 {unit}", title="level")
        if known:
            _draw_by_explorer(panels[0, 2], rows, "friction")
            panels[0, 2].set(xlabel="mean lateral / mean normal force", title="friction coefficient")
        for panel in panels[0, 1:]:
            panel.locator_params(axis="x", nbins=5)
            panel.grid(alpha=0.3)
            panel.legend(fontsize=7)


def _draw_by_explorer(panel, rows, key):
    """Mean and standard deviation of each surface as a bar, and the means of single explorers as dots."""
    middle, deviation = (_numbers([row[name] for row in rows]) for name in (key, f"{key}_std"))
    panel.errorbar(middle, range(len(rows)), xerr=deviation, fmt="none", ecolor="grey", elinewidth=2, alpha=0.6)
    explorers = sorted({who for row in rows for who in row["explorers"]})
    if len(explorers) > MOST_EXPLORERS or len(rows) > MOST_NAMES:
        panel.plot(middle, range(len(rows)), "ko", markersize=2, label="all explorers")
        return
    for who, colour, marker in zip(explorers, COLOURS, "osD^v<>", strict=False):
        values = _numbers([row[f"{key}_explorers"].get(who) for row in rows])
        panel.plot(values, range(len(rows)), marker, color=colour, markersize=3, label=who)


def _numbers(values):
    """An array of floats; None becomes NaN."""
    return np.array(values, dtype=np.float64)


def draw_ratings(ratings, path):
    """Raw answers of each axis, and below the pooled ratings of surfaces."""
    axes, pooled = ratings["answers"]["axes"], ratings["pooled"]
    columns = max(len(axes), len(RATING_AXES))
    with _panels(path, 2, columns, (3 * columns, 5.6)) as panels:
        for panel, (axis, entry) in zip(panels[0], axes.items(), strict=False):
            panel.bar(range(len(entry["counts"])), entry["counts"], color=COLOURS[0])
            panel.set(title=axis, xlabel="answer, 0–8", ylabel="answers")
        for panel, axis in zip(panels[1], RATING_AXES, strict=False):
            panel.stairs(pooled["counts"][axis], pooled["edges"], fill=True, color=COLOURS[2])
            panel.set(title=f"{axis}, pooled", xlabel="rating, z", ylabel="surfaces")
        for panel in (*panels[0, len(axes) :], *panels[1, len(RATING_AXES) :]):
            panel.set_axis_off()
