"""Pictures of a data card, drawn from its numbers. NaN is None in them, as in card.json."""

from contextlib import contextmanager

import numpy as np

from ...signal import RATING_AXES
from .advice import LEAST_ALPHA
from .selection import KEPT
from .turnarounds import TREATMENTS

_DPI = 90
#: Colours that people with any colour vision tell apart (Okabe and Ito 2008, "Color Universal Design").
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7", "#F0E442", "#000000")
#: More names than this on an axis cannot be read: they are left out.
MOST_NAMES = 60
#: More explorers than this get no colour or row of their own.
MOST_EXPLORERS = 7
#: Shares of the time (%) below this are too narrow for their number.
LEAST_LABELLED = 6
#: Length of the magnified piece of a waveform, s.
ZOOM_SECONDS = 0.1


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
    """What "N" and "1" (uncalibrated) are called beside numbers."""
    return "count" if unit == "1" else unit


def channel_labels(unit):
    """What limits are on, with its unit."""
    return {"normal_force": f"normal force, {unit}", "speed": "speed, mm/s"}


def draw_all(card, textures, folder):
    """Draws every picture that the numbers of a card allow.

    Args:
        card (`dict`): the numbers.
        textures (`np.ndarray`): (examples, samples) of `card["examples"]`.
        folder (`Path`): where the PNGs go.

    Returns:
        `list[str]`: their names.
    """
    unit = unit_name(card["recordings"]["unit"])
    pictures = {
        "kept.png": (draw_kept, card["kept"]),
        "segments.png": (draw_segments, card["surfaces"]),
        "surfaces.png": (draw_surfaces, card["surfaces"], card["spectra"]["edges"], unit),
        "spectra.png": (draw_spectra, card["spectra"], unit),
        "waveforms.png": (draw_waveforms, card["examples"], textures, card["preparation"]["sampling_rate"], unit),
    }
    if any(card["histograms"].values()):
        pictures["limits.png"] = (draw_limits, card["histograms"], unit)
    if card["turnarounds"]["effects"]:
        pictures["turnarounds.png"] = (draw_turnarounds, card["turnarounds"], card["spectra"]["edges"])
    if card["ratings"]:
        pictures["ratings.png"] = (draw_ratings, card["ratings"])
    for name, (draw, *arguments) in pictures.items():
        draw(*arguments, folder / name)
    return list(pictures)


def draw_kept(kept, path):
    """Where the time went, by reason: of all recordings, and of each explorer."""
    explorers = kept["explorers"] if 1 < len(kept["explorers"]) <= MOST_EXPLORERS else {}
    rows = {"all": kept["seconds"], **explorers}
    totals = {name: sum(seconds.values()) for name, seconds in rows.items()}
    reasons = sorted((reason for reason in kept["reasons"] if kept["seconds"][reason]), key=lambda r: r != KEPT)
    with _panels(path, 1, 1, (9, 1.8 + 0.4 * len(rows))) as panels:
        panel, left = panels[0, 0], np.zeros(len(rows))
        for reason, colour in zip(reasons, _cycle(len(reasons)), strict=True):
            shares = np.array([100 * rows[name][reason] / totals[name] for name in rows])
            panel.barh(range(len(rows)), shares, left=left, color=colour, label=reason, height=0.7)
            for row in np.flatnonzero(shares > LEAST_LABELLED):
                middle = left[row] + shares[row] / 2
                panel.text(middle, row, f"{shares[row]:.0f} %", ha="center", va="center", fontsize=8, bbox=_BACKED)
            left += shares
        panel.set_yticks(range(len(rows)), [f"{name}, {_duration(totals[name])}" for name in rows])
        panel.invert_yaxis()
        panel.set(xlim=(0, 100), xlabel="share of the time, %", title="what was kept, and why the rest was dropped")
        panel.figure.legend(loc="outside lower center", ncols=3, fontsize=8)


_BACKED = {"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 1.0}


def _duration(seconds):
    return f"{seconds:.0f} s" if seconds < 600 else f"{seconds / 60:.0f} min"


def _cycle(count):
    return [COLOURS[number % len(COLOURS)] for number in range(count)]


def draw_segments(surfaces, path):
    """Segments of each surface, by explorer; a cross where there is none."""
    rows = sorted(surfaces, key=lambda row: -row["segments"])
    explorers = sorted({who for row in rows for who in row["explorers"]})
    with _panels(path, 1, 1, (11, 3.6)) as panels:
        panel, places, bottom = panels[0, 0], np.arange(len(rows)), np.zeros(len(rows))
        width = 0.85 if len(rows) <= MOST_NAMES else 1.0
        if len(explorers) > MOST_EXPLORERS:
            panel.bar(
                places,
                [row["segments"] for row in rows],
                width=width,
                color=COLOURS[0],
                label=f"{len(explorers)} explorers",
            )
            explorers = []
        for who, colour in zip(explorers, _cycle(len(explorers)), strict=True):
            counts = np.array([row["explorers"].get(who, 0) for row in rows])
            panel.bar(places, counts, bottom=bottom, width=width, color=colour, label=who)
            bottom += counts
        none = [place for place, row in enumerate(rows) if not row["segments"]]
        if none:
            panel.plot(none, np.zeros(len(none)), "kx", label=f"no segment: {len(none)} surfaces", clip_on=False)
        panel.set(xlim=(-0.6, len(rows) - 0.4), ylabel="segments", title="segments of each surface, by explorer")
        panel.yaxis.get_major_locator().set_params(integer=True)
        _name_surfaces(panel, "x", rows)
        panel.grid(axis="y", alpha=0.3)
        panel.legend(fontsize=8)


def _name_surfaces(panel, axis, rows):
    """Names along an axis, or only their number if there are too many to read."""
    set_ticks, set_label = getattr(panel, f"set_{axis}ticks"), getattr(panel, f"set_{axis}label")
    if len(rows) > MOST_NAMES:
        set_ticks([])
        set_label(f"{len(rows)} surfaces")
    else:
        names = [name if len(name := row["name"]) <= 24 else f"{name[:13]}…{name[-10:]}" for row in rows]
        set_ticks(range(len(rows)), names, fontsize=6.5, **({"rotation": 90} if axis == "x" else {}))


def draw_surfaces(surfaces, edges, unit, path):
    """Nine bands, level and friction coefficient of each surface that has segments, the loudest on top."""
    rows = sorted((row for row in surfaces if row["segments"]), key=lambda row: -row["level_db"])
    known = any(row["friction"] is not None for row in rows)
    height = 1.6 + 0.13 * min(max(len(rows), 10), MOST_NAMES)
    ratios = (3, 2, 2) if known else (3, 2)
    with _panels(path, 1, len(ratios), (10.5, height), sharey=True, width_ratios=ratios) as panels:
        bands, levels = panels[0, :2]
        image = bands.imshow([row["bands_db"] for row in rows], aspect="auto", cmap="viridis", interpolation="nearest")
        bands.set_xticks(range(len(edges) - 1), [f"{low:.0f}–\n{high:.0f}" for low, high in _pairs(edges)], fontsize=7)
        bands.set(xlabel="band, Hz", title=f"band levels, dB re 1 {unit}")
        bands.figure.colorbar(image, ax=bands, pad=0.01)
        _name_surfaces(bands, "y", rows)
        _draw_by_explorer(levels, rows, "level_db")
        levels.set(xlabel=f"dB re 1 {unit}", title="level")
        if known:
            _draw_by_explorer(panels[0, 2], rows, "friction")
            panels[0, 2].set(xlabel="mean lateral / mean normal force", title="friction coefficient")
        for panel in panels[0, 1:]:
            panel.locator_params(axis="x", nbins=5)
            panel.grid(alpha=0.3)
            panel.legend(fontsize=7)


def _pairs(edges):
    return zip(edges[:-1], edges[1:], strict=True)


def _draw_by_explorer(panel, rows, key):
    """Mean and spread of each surface as a bar, and the means of single explorers as dots."""
    middle, spread = (_numbers([row[name] for row in rows]) for name in (key, f"{key}_std"))
    panel.errorbar(middle, range(len(rows)), xerr=spread, fmt="none", ecolor="grey", elinewidth=2, alpha=0.6)
    explorers = sorted({who for row in rows for who in row["explorers"]})
    if len(explorers) > MOST_EXPLORERS or len(rows) > MOST_NAMES:
        panel.plot(middle, range(len(rows)), "ko", markersize=2, label="all explorers")
        return
    for who, colour, marker in zip(explorers, _cycle(len(explorers)), "osD^v<>", strict=False):
        values = _numbers([row[f"{key}_explorers"].get(who) for row in rows])
        panel.plot(values, range(len(rows)), marker, color=colour, markersize=3, label=who)


def _numbers(values):
    """An array of floats; None becomes NaN."""
    return np.array(values, dtype=np.float64)


def draw_spectra(spectra, unit, path):
    """Mean spectrum over surfaces with its spread, and of thirds by level."""
    with _panels(path, 1, 1, (8, 4)) as panels:
        panel, frequencies = panels[0, 0], spectra["frequencies"]
        if spectra["thirds_db"]:
            spread = spectra["p10_db"], spectra["p90_db"]
            panel.fill_between(frequencies, *spread, color="grey", alpha=0.3, label="10–90 % of surfaces")
        panel.semilogx(frequencies, spectra["mean_db"], color="black", linewidth=1.5, label="mean over surfaces")
        styles = zip(spectra["thirds_db"].items(), COLOURS, ("--", "-.", ":"), strict=False)
        for (name, values), colour, style in styles:
            panel.semilogx(frequencies, values, color=colour, linestyle=style, label=name)
        for edge in (spectra["edges"][0], spectra["edges"][-1]):
            panel.axvline(edge, color="black", linewidth=0.6)
        inside = _numbers(spectra["p90_db"])
        panel.set(
            xlim=(0.7 * spectra["edges"][0], frequencies[-1]),
            ylim=(inside.max() - 75, inside.max() + 5),
            xlabel="Hz",
            ylabel=f"dB re 1 {unit}²/Hz",
            title="spectra of textures (vertical lines: the band)",
        )
        _plain_frequencies(panel)
        panel.grid(alpha=0.3, which="both")
        panel.legend(fontsize=8)


def _plain_frequencies(panel):
    low, high = panel.get_xlim()
    panel.set_xticks([hertz for hertz in (20, 50, 100, 200, 500, 1000, 2000) if low <= hertz <= high])
    panel.xaxis.set_major_formatter("{x:g}")
    panel.xaxis.set_minor_formatter("")


def draw_limits(histograms, unit, path):
    """Time spent at each normal force and speed, with the limits of segments."""
    labels = channel_labels(unit)
    shown = {name: histogram for name, histogram in histograms.items() if histogram}
    with _panels(path, 1, len(shown), (5.2 * len(shown), 3.4)) as panels:
        for panel, (name, histogram) in zip(panels[0], shown.items(), strict=True):
            edges, explorers = histogram["edges"], histogram["seconds"]
            panel.stairs(np.sum(list(explorers.values()), axis=0), edges, fill=True, color="0.8", label="all")
            if 1 < len(explorers) <= MOST_EXPLORERS:
                for (who, seconds), colour in zip(explorers.items(), COLOURS, strict=False):
                    panel.stairs(seconds, edges, color=colour, linewidth=1.2, label=who)
            title = "no limits"
            if histogram["limits"]:
                title = f"{100 * histogram['share_inside']:.0f} % of the time inside the limits"
                for limit in histogram["limits"]:
                    panel.axvline(limit, color="black", linestyle="--", linewidth=1)
            panel.set(xlabel=labels[name], ylabel="s", xlim=(edges[0], edges[-1]), title=title)
            panel.grid(alpha=0.3)
            panel.legend(fontsize=8)


def draw_waveforms(entries, textures, sampling_rate, unit, path):
    """Whole segments, and a magnified piece from their middle."""
    scale, name = (1.0, "counts") if unit == "count" else (1e3, f"m{unit}")
    with _panels(path, len(entries), 2, (11, 1.2 + 1.8 * len(entries)), width_ratios=(2, 1)) as panels:
        for (whole, zoom), entry, texture in zip(panels, entries, textures, strict=True):
            time = np.arange(len(texture)) / sampling_rate
            start = len(texture) // 2
            piece = slice(start, start + int(ZOOM_SECONDS * sampling_rate))
            whole.plot(time, scale * texture, color=COLOURS[0], linewidth=0.5)
            whole.axvspan(time[start], time[piece][-1], color=COLOURS[1], alpha=0.35, linewidth=0)
            whole.set(xlim=(0, time[-1]), ylabel=f"lateral force, {name}")
            whole.set_title(
                f"{entry['which']}: {entry['surface']}, {entry['level_db']:.1f} dB re 1 {unit}", fontsize=10
            )
            zoom.plot(1e3 * (time[piece] - time[start]), scale * texture[piece], color=COLOURS[0], linewidth=0.9)
            zoom.set_xlim(0, 1e3 * ZOOM_SECONDS)
            for panel in (whole, zoom):
                panel.grid(alpha=0.3)
        panels[-1, 0].set_xlabel("s")
        panels[-1, 1].set_xlabel("ms")
        panels[0, 1].set_title("the marked 100 ms", fontsize=10)


def draw_turnarounds(turnarounds, edges, path):
    """Nine bands of segments with turnarounds against others, by treatment, with 95 % intervals over surfaces."""
    with _panels(path, 1, 1, (7.5, 3.6)) as panels:
        panel, places = panels[0, 0], np.arange(len(edges) - 1)
        effects = turnarounds["effects"].items()
        for (treatment, effect), colour, marker, offset in zip(effects, COLOURS, "os", (-0.08, 0.08), strict=False):
            bands, half = _numbers(effect["bands_db"]), _numbers(effect["half_interval_db"])
            style = {"fmt": marker, "color": colour, "markersize": 4, "capsize": 2}
            panel.errorbar(places + offset, bands, half, label=TREATMENTS[treatment], **style)
        panel.axhline(0, color="black", linewidth=0.8)
        panel.set_xticks(places, [f"{low:.0f}–\n{high:.0f}" for low, high in _pairs(edges)], fontsize=8)
        panel.set(xlabel="band, Hz", ylabel="difference of level, dB", title="segments with turnarounds against others")
        panel.grid(alpha=0.3)
        panel.legend(fontsize=8)


def draw_ratings(ratings, path):
    """Raw answers and reliability per axis; below, pooled ratings and their correlations."""
    axes, pooled = ratings["answers"]["axes"], ratings["pooled"]
    above = -(-(len(axes) + 1) // 4)
    with _panels(path, above + 1, 4, (12, 2.9 * (above + 1))) as panels:
        places = iter(panels[:above].flat)
        for (axis, entry), panel in zip(axes.items(), places, strict=False):
            panel.bar(range(len(entry["counts"])), entry["counts"], color=COLOURS[0])
            missing = f", {100 * entry['missing_share']:.0f} % missing" if entry["missing_share"] else ""
            panel.set(title=f"{axis}{missing}", xlabel="answer, 0–8", ylabel="answers")
            panel.set_xticks(range(len(entry["counts"])))
        _draw_reliability(next(places), axes)
        for panel in places:
            panel.set_axis_off()
        for panel, axis in zip(panels[-1], RATING_AXES, strict=False):
            panel.stairs(pooled["counts"][axis], pooled["edges"], fill=True, color=COLOURS[2])
            panel.set(title=f"{axis}, pooled", xlabel="rating, z", ylabel="surfaces")
            panel.yaxis.get_major_locator().set_params(integer=True)
        _draw_matrix(panels[-1, -1], _numbers(pooled["correlation"]))


def _draw_reliability(panel, axes):
    for key, label, marker, colour in (
        ("alpha", "Cronbach's alpha", "o", COLOURS[0]),
        ("mean_correlation", "mean correlation of two raters", "s", COLOURS[1]),
    ):
        panel.plot(
            _numbers([entry[key] for entry in axes.values()]), range(len(axes)), marker, color=colour, label=label
        )
    panel.axvline(LEAST_ALPHA, color="black", linestyle="--", linewidth=1)
    panel.set_yticks(range(len(axes)), axes, fontsize=8)
    lowest = min(
        [0.0, *(value for entry in axes.values() for value in (entry["alpha"], entry["mean_correlation"]) if value)]
    )
    panel.set(
        xlim=(lowest - 0.05, 1.05),
        ylim=(len(axes) - 0.4, -0.6 - 0.3 * len(axes)),
        title=f"reliability (dashed: alpha {LEAST_ALPHA:g})",
    )
    panel.grid(alpha=0.3)
    panel.legend(fontsize=7, loc="upper left")


def _draw_matrix(panel, matrix):
    panel.imshow(matrix, cmap="RdBu_r", vmin=-1, vmax=1)
    for (i, j), value in np.ndenumerate(matrix):
        colour = "white" if abs(value) > 0.6 else "black"
        panel.text(j, i, "–" if np.isnan(value) else f"{value:.2f}", ha="center", va="center", color=colour)
    panel.set_xticks(range(3), RATING_AXES, fontsize=8)
    panel.set_yticks(range(3), RATING_AXES, fontsize=8, rotation=90, va="center")
    panel.set_title("correlation of pooled axes")
