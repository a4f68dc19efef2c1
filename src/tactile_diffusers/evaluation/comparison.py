"""Reports of several checkpoints side by side: what ratings do in each."""

import numpy as np

from ..signal import RATING_AXES
from .figures import figure_panels, share_limits
from .labels import default_guidance
from .obedience import comparisons, matrix_difference
from .tables import markdown_table

#: Headings and digits of the table.
_LABELS = {
    "surfaces": ("training surfaces", 0),
    "changes": "changes that are those of real surfaces",
    "matrix": "response matrix, largest difference from real",
    "diagonal": "its diagonal",
    "nine_band_db": "unseen surfaces, dB",
    "ridge": "ridge regression, same data",
    "ktd_excess": "KTD over real",
    "ftd_excess": "FTD over real",
    "diversity_of_rating": "spread of takes over that of real textures of such ratings",
    "shift": "latent shift at ±2, %",
}


def comparison_markdown(reports, pictures="."):
    """A table of all reports and the pictures.

    Args:
        reports (`dict[str, dict]`): name -> report.json.
        pictures (`str`): folder of the pictures, as the text links to it.

    Raises:
        ValueError: if a report lacks the sections control or generation, or they are of different held-out surfaces.
    """
    for name, report in reports.items():
        if not (report.get("control") and report.get("generation")):
            raise ValueError(f"The report {name!r} has no sections control and generation: evaluate them.")
    facts = {
        (r["data"]["name"], r["data"]["split"], r["data"]["surfaces"], r["data"]["segments"]) for r in reports.values()
    }
    if len(facts) > 1:
        raise ValueError(f"The reports are of different held-out surfaces: {sorted(facts)}. Evaluate on the same data.")
    data, split, surfaces, segments = facts.pop()
    machines = sorted({f"{r['machine']['processor']}, {r['machine']['threads']} thread(s)" for r in reports.values()})
    note = (
        f"On {segments} segments of {surfaces} {split} surfaces of `{data}` ({'; '.join(machines)}), guidance as each "
        "pipeline has it by default. A change is right within 20 % of that between real surfaces with such ratings, or "
        "within its 95 % interval; the diagonal is roughness, bumpiness, slipperiness, that of real textures is "
        f"{_diagonal(next(iter(reports.values()))['control']['response_real'])}."
    )
    table = markdown_table({name: _row(report) for name, report in reports.items()}, labels=_LABELS)
    figures = []
    if any(report.get("paper") for report in reports.values()):
        figures.append(f"![spectra over one axis at a time]({pictures}/axes.png)")
    if differ_in_surfaces(reports):
        figures.append(f"![figures over the number of training surfaces]({pictures}/surfaces.png)")
    return "\n\n".join([note, table, *figures]) + "\n"


def differ_in_surfaces(reports):
    """Whether checkpoints were compared with training sets of different size."""
    return len({report["data"]["training_surfaces"] for report in reports.values()}) > 1


def _row(report):
    guidance = default_guidance(report)
    control, generation, unseen = report["control"], report["generation"][guidance], report["unseen_surfaces"]
    found = comparisons(control[guidance]["axes"], control["truth"]["fewest_surfaces"]["mean"])
    ends = [
        entry["latent_shift_percent"]["mean"]
        for values in control[guidance]["axes"].values()
        for value, entry in values.items()
        if abs(float(value)) == 2 and entry["latent_shift_percent"]["mean"] is not None
    ]
    return {
        "surfaces": report["data"]["training_surfaces"],
        "changes": f"{sum(item['right'] for item in found)} of {len(found)}",
        "matrix": matrix_difference(control[guidance]["response"], control["response_real"]),
        "diagonal": _diagonal(control[guidance]["response"]),
        "nine_band_db": unseen["nine_band_db"]["model"],
        "ridge": unseen["nine_band_db"].get("ridge"),
        "ktd_excess": generation["ktd_excess"],
        "ftd_excess": generation["ftd_excess"],
        "diversity_of_rating": generation.get("diversity_of_rating"),
        "shift": f"{min(ends):.0f}–{max(ends):.0f}" if ends else None,
    }


def _diagonal(matrix):
    means = [matrix[axis][axis]["mean"] for axis in range(len(RATING_AXES))]
    return ", ".join("–" if mean is None else f"{mean:.2f}" for mean in means)


def plot_axis_spectra(reports, output_path):
    """Nine-band spectra over one axis at a time, a row of panels for each report that has the section paper."""
    import matplotlib

    shown = {name: report["paper"]["spectra_db"] for name, report in reports.items() if report.get("paper")}
    colours = matplotlib.colormaps["coolwarm"]
    if not shown:
        return
    with figure_panels(output_path, len(shown), len(RATING_AXES), (12, 3.2 * len(shown))) as panels:
        for row, (name, axes) in zip(panels, shown.items(), strict=True):
            for panel, axis in zip(row, RATING_AXES, strict=True):
                values = sorted(axes[axis], key=float)
                low, high = float(values[0]), float(values[-1])
                for value in values:
                    bands = axes[axis][value]
                    centres = [_centre(band) for band in bands]
                    means = [np.nan if leaf["mean"] is None else leaf["mean"] for leaf in bands.values()]
                    colour = colours((float(value) - low) / (high - low))
                    panel.semilogx(centres, means, color=colour, label=f"{float(value):+.1f}")
                panel.set(title=f"{name}: {axis}", xlabel="Hz", ylabel="dB re 1 N²")
                panel.grid(alpha=0.3)
            share_limits(row)
        panels[0, 0].legend(fontsize=6, ncols=2, title="rating, z", title_fontsize=7)


def _centre(band):
    low, high = (float(edge) for edge in band.removesuffix(" Hz").split("-"))
    return (low * high) ** 0.5


def plot_surfaces(reports, output_path):
    """Error on unseen surfaces and largest difference of the response matrix over the number of training surfaces."""
    if not differ_in_surfaces(reports):
        return
    rows = {name: _row(report) for name, report in reports.items()}
    with figure_panels(output_path, 1, 2, (9, 3.6)) as panels:
        for panel, key, label in zip(
            panels[0], ("nine_band_db", "matrix"), ("unseen surfaces, dB", _LABELS["matrix"]), strict=True
        ):
            for name, row in rows.items():
                value = row[key]["mean"] if isinstance(row[key], dict) else row[key]
                if value is not None:
                    panel.semilogx(row["surfaces"], value, marker="o", color="C0")
                    panel.annotate(
                        name, (row["surfaces"], value), fontsize=7, xytext=(4, 3), textcoords="offset points"
                    )
                if key == "nine_band_db" and row["ridge"] and row["ridge"]["mean"] is not None:
                    panel.semilogx(row["surfaces"], row["ridge"]["mean"], marker="x", color="C1")
            panel.set(xlabel="training surfaces", ylabel=label)
            panel.grid(alpha=0.3)
