"""The page of measured hands: its table, and two pictures."""

import numpy as np

from tactile_diffusers.io.files import atomic_path
from tactile_diffusers.signal import DEVICE_RATE
from tactile_diffusers.signal.waveform_shape import waveform_shape

from .measured import QUOTED, SOURCES

#: What is drawn: materials of surfaces, in the order in which they come.
SEGMENTS = (
    *("glass", "rubber", "abrasive", "fabric", "wood", "paper", "metal", "plastic"),
    *("glass", "rubber", "abrasive", "fabric"),
)
EXCERPT = slice(DEVICE_RATE // 2, DEVICE_RATE // 2 + 3 * DEVICE_RATE // 10)


def markdown(rows, facts, version):
    """The page of `compare`'s rows and facts."""
    inside = sum(row.inside for row in rows)
    lines = [
        f"# Virtual surfaces, recipe {version}, beside measured hands",
        "",
        f"{inside} of {len(rows)} rows are inside: the range that holds 95 % of simulated sets of 50 surfaces (median "
        "[range]) holds the measured value, or overlaps the measured range.",
        "",
        "| law | measured | simulated | inside | source | note |",
        "|---|---:|---:|---|---|---|",
    ]
    for row in rows:
        low, high = row.measured
        measured = f"> {low:g}" if np.isinf(high) else f"{low:.2f}" if low == high else f"{low:.2f} to {high:.2f}"
        simulated = "{:.2f} [{:.2f}, {:.2f}]".format(*row.simulator)
        note = "; ".join(filter(None, [row.note, "" if row.inside else row.reason]))
        cells = [row.law, measured, simulated, "yes" if row.inside else "**no**", row.source, note]
        lines.append(f"| {' | '.join(cells)} |")
    lines += ["", "## Sources", "", *(f"- {name}: {text}." for name, text in SOURCES.items())]
    return "\n".join(lines) + "\n" + TEXT.format(**facts)


TEXT = """
## Physics or judgement

Surfaces that vibrate more also grip more, because relief catches the skin; glass and rubber are smooth and grip by
adhesion. So the percepts that follow from physics correlate by {percepts:.2f} in roughness and slipperiness, and by
{plain_percepts:.2f} without glass and rubber. What raters share beside the physics dilutes the first to
{impressions:.2f}. They judge the two together (the setting `rating_correlation`), which makes it {pooled:.2f} in
ratings, and {plain_pooled:.2f} without glass and rubber. Over all classes the larger part is judgement.

## Onset and speed

A finger that starts to move loads the contact, then slips from static friction. Recordings hold this. The paper's
limits leave it out of most segments: {onset_time:.1%} hold any of the first 0.3 s of motion, {onset_travel:.1%} any of
its first 3 mm.

Raters judge a surface, not a stroke: their ratings do not depend on speed. The judged roughness of fine surfaces does;
it follows vibration power (Bensmaia & Hollins 2003).

## Waveforms

![histograms of kurtosis, crest factor and skew](shapes.png)

Segments of fresh surfaces, one each. Values beyond the ends are counted at the ends.

![twelve simulated segments](segments.png)

Lateral force on twelve surfaces, 20-1000 Hz, at one scale.
"""


def save(figure, path):
    """Writes a figure as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    with atomic_path(path) as temporary:
        FigureCanvasAgg(figure).print_png(temporary)


def draw_shapes(textures, path):
    """Histograms of kurtosis, crest factor and skew of segments, with the measured medians."""
    from matplotlib.figure import Figure

    figure, shapes = Figure(figsize=(9, 2.8), dpi=80, layout="constrained"), waveform_shape(textures)
    measured = {"fingers on fabrics": "fabrics", "finger stroke": "stroke"}
    ranges = {"kurtosis": (2, 12), "crest_factor": (2, 10), "skew": (-1, 1.5)}
    for panel, (name, (low, high)) in zip(figure.subplots(1, 3), ranges.items(), strict=True):
        panel.hist(np.clip(shapes[name], low, high), np.linspace(low, high, 41), color="0.7")
        panel.axvline(np.median(shapes[name]), color="black", linewidth=1.2, label="simulated, median")
        for number, (label, key) in enumerate(measured.items()):
            if f"{key}_{name}" in QUOTED:
                panel.axvline(QUOTED[f"{key}_{name}"], color=f"C{number}", linewidth=1.2, label=label)
        panel.set_title(name.replace("_", " "), fontsize=9)
        panel.tick_params(labelsize=7)
        panel.legend(fontsize=7)
    figure.axes[0].set_ylabel("segments", fontsize=8)
    save(figure, path)


def draw_segments(surfaces, textures, path, stroke=None):
    """0.3 s of twelve simulated segments at one scale, beside the measured stroke if it is given."""
    from matplotlib.figure import Figure

    by_material = {}
    for surface, texture in zip(surfaces, textures, strict=True):
        by_material.setdefault(surface.parameters.material, []).append(texture)
    shown = [(name, by_material[name].pop(0)) for name in SEGMENTS if by_material.get(name)]
    if stroke is not None:
        shown.append(("MEASURED: a finger at 40 mm/s", stroke))
    count = -(-len(shown) // 3)
    figure = Figure(figsize=(9, 1.25 * count), dpi=68, layout="constrained")
    panels = figure.subplots(count, 3, sharex=True, sharey=True, squeeze=False).ravel()
    for panel, (name, texture) in zip(panels, shown, strict=False):
        wave = 1e3 * texture[EXCERPT]
        panel.plot(np.arange(len(wave)) / DEVICE_RATE, wave, linewidth=0.5, color="C1" if "MEAS" in name else "C0")
        facts = 1e3 * np.std(texture), waveform_shape(texture)["kurtosis"]
        panel.set_title("{}: {:.1f} mN, kurtosis {:.1f}".format(name, *facts), fontsize=7)
        panel.tick_params(labelsize=6)
        panel.grid(alpha=0.3)
    for panel in panels[len(shown) :]:
        panel.axis("off")
    for panel in panels[: len(shown)][-3:]:
        panel.tick_params(labelbottom=True)
    panels[0].set_ylim(-50, 50)
    figure.supylabel("lateral force, mN", fontsize=8)
    figure.supxlabel("s", fontsize=8)
    save(figure, path)
