"""Reports of several checkpoints side by side: the effect of ratings in each."""

import numpy as np

from ..signal import RATING_AXES
from .control_tables import matrix_difference, share_right
from .labels import default_guidance
from .report_figures import figure_panels, leaf_mean, share_limits
from .report_rows import latent_shift
from .tables import markdown_table

_TICKS_HZ = (30, 100, 300, 1000)
#: Headings and digits of the table.
_LABELS = {
    "surfaces": ("training surfaces", 0),
    "alpha": "Cronbach's alpha of ratings",
    "changes": "changes as between real surfaces",
    "matrix": "response matrix, largest difference from real",
    "diagonal": "its diagonal",
    "diagonal_real": "that of real segments",
    "nine_band_db": "unseen surfaces, dB",
    "ridge": "ridge regression, same data",
    "ktd_excess": "KTD over real",
    "ftd_excess": "FTD over real",
    "diversity_of_rating": "diversity over that of real textures of such ratings",
    "shift": "latent shift at ±2, %",
}


def comparison_markdown(reports):
    """A table of all reports and a link to the picture.

    Args:
        reports (`dict[str, dict]`): name -> report.json.

    Raises:
        ValueError: if a report lacks the sections control or generation, or they are of different held-out surfaces.
    """
    for name, report in reports.items():
        if not (report.get("control") and report.get("generation")):
            raise ValueError(f"The report {name!r} has no sections control and generation: evaluate them.")
    # data sets of the same surfaces whose raters agree more, or less, have other names
    facts = {tuple(r["data"][key] for key in ("split", "surfaces", "segments")) for r in reports.values()}
    if len(facts) > 1:
        raise ValueError(f"The reports are of different held-out surfaces: {sorted(facts)}. Evaluate on the same data.")
    if len(versions := {report["data"].get("embedding_version", 1) for report in reports.values()}) > 1:
        raise ValueError(f"The reports have distances of different embeddings, versions {versions}: evaluate again.")
    split, surfaces, segments = facts.pop()
    data = "`, `".join(sorted({report["data"]["name"] for report in reports.values()}))
    machines = sorted({f"{r['machine']['processor']}, {r['machine']['threads']} thread(s)" for r in reports.values()})
    note = (
        f"{segments} segments of {surfaces} {split} surfaces of `{data}` ({'; '.join(machines)}), default guidance. A "
        "change is right within 20 % of that between real surfaces with such ratings, or within its 95 % interval. "
        "Diagonals and alpha: roughness, bumpiness, slipperiness."
    )
    parts = [note, markdown_table({name: report_row(report) for name, report in reports.items()}, labels=_LABELS)]
    if len(_with_spectra(reports)) > 1:
        parts.append("![spectra over one axis at a time](axes.png)")
    return "\n\n".join(parts) + "\n"


def check_report(report):
    """Refuses a report of which no table or picture can be made.

    Raises:
        ValueError, KeyError, TypeError, AttributeError: saying what is missing or of another kind.
    """
    comparison_markdown({"one": report})
    for axes in _with_spectra({"one": report}).values():
        for axis in RATING_AXES:
            for value, bands in axes[axis].items():
                numbers = [float(value), *map(_centre, bands)]
                numbers += [leaf["mean"] for leaf in bands.values() if leaf["mean"] is not None]
                if not np.isfinite(numbers).all():
                    raise ValueError(f"the spectra over {axis} hold what is no number")


def report_row(report):
    """The row of a report: column of the table -> text, number or leaf."""
    guidance = default_guidance(report)
    control, generation, unseen = report["control"], report["generation"][guidance], report["unseen_surfaces"]
    ours = control[guidance]
    return {
        "surfaces": report["data"]["training_surfaces"],
        "alpha": _listed((report["data"].get("rater_alpha") or {}).values()) or None,
        "changes": share_right(ours, control),
        "matrix": matrix_difference(ours["response"], control["response_real"]),
        "diagonal": _diagonal(ours["response"]),
        "diagonal_real": _diagonal(control["response_real"]),
        "nine_band_db": unseen["nine_band_db"]["model"],
        "ridge": unseen["nine_band_db"].get("ridge"),
        "ktd_excess": generation["ktd_excess"],
        "ftd_excess": generation["ftd_excess"],
        "diversity_of_rating": generation.get("diversity_of_rating"),
        "shift": latent_shift(report) if report.get("paper") else None,
    }


def _diagonal(matrix):
    return _listed(matrix[axis][axis]["mean"] for axis in range(len(RATING_AXES)))


def _listed(values):
    return ", ".join("–" if value is None else f"{value:.2f}" for value in values)


def _with_spectra(reports):
    """Spectra over one axis at a time of the reports that have the section paper."""
    return {name: report["paper"]["spectra_db"] for name, report in reports.items() if report.get("paper")}


def plot_axis_spectra(reports, output_path):
    """Nine-band spectra over one axis at a time, a row of panels for each of two or more reports with section paper."""
    import matplotlib

    shown, colours = _with_spectra(reports), matplotlib.colormaps["coolwarm"]
    if len(shown) < 2:
        return
    with figure_panels(output_path, len(shown), len(RATING_AXES), (12, 3.2 * len(shown))) as panels:
        for row, (name, axes) in zip(panels, shown.items(), strict=True):
            for panel, axis in zip(row, RATING_AXES, strict=True):
                values = sorted(axes[axis], key=float)
                low, high = float(values[0]), float(values[-1])
                for value in values:
                    bands, colour = axes[axis][value], colours((float(value) - low) / (high - low))
                    means = list(map(leaf_mean, bands.values()))
                    panel.semilogx(list(map(_centre, bands)), means, color=colour, label=f"{float(value):+.1f}")
                panel.set(title=f"{name}: {axis}", xlabel="Hz", ylabel="dB re 1 N²")
                panel.set_xticks(_TICKS_HZ, labels=[str(tick) for tick in _TICKS_HZ])
                panel.minorticks_off()
        share_limits(panels.ravel())  # with one scale, a checkpoint that hardly responds is seen
        panels[0, 0].legend(fontsize=6, ncols=2, title="rating, z", title_fontsize=7)


def _centre(band):
    low, high = (float(edge) for edge in band.removesuffix(" Hz").split("-"))
    return (low * high) ** 0.5
