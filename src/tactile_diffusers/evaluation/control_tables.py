"""Rows of the tables of control: does a change of a rating have the effect that it has between real surfaces?"""

import numpy as np

from ..signal import RATING_AXES
from .changes import QUANTITIES, VALUES, comparisons, counted
from .labels import default_guidance
from .tables import text

#: Rows of the table of changes.
_CANDIDATES = {
    "null": "real surfaces, one half for the other",
    "model": "**generated**",
    "knn_blend": "blend of 5 nearest surfaces",
    "ridge": "ridge regression and noise",
    "regression": "best polynomial of the rating",
    "permuted": "generated, ratings permuted",
    "none": "no change at all",
}
#: Measures of the response curves, and digits.
_CURVES = {
    "level_db": ("level, dB re 1 N", 1),
    "centroid_hz": ("centroid, Hz", 0),
    "log_friction": ("log friction", 2),
    "estimate": ("judge's estimate", 2),
}


def share_right(entry, control):
    """How many changes of a set of conditions are right, such as "29 of 36"."""
    return _of(counted(comparisons(entry["axes"], control["truth"]["fewest_surfaces"]["mean"]))["changes"])


def _of(leaf):
    if leaf["mean"] is None:
        return None
    spread = "" if leaf["min"] is None else f" ({leaf['min']:.0f}–{leaf['max']:.0f})"
    return f"{text(leaf['mean'], 1 if spread else 0)} of {leaf['n']}{spread}"


def change_rows(report):
    """Changes that are right, by quantity, and each candidate beside the generated ones over the same conditions."""
    rows = {}
    for slug, name in _CANDIDATES.items():
        if entry := report["control"]["counts"].get(slug):
            rows[name] = row = {key: _of(entry[key]) for key in ("changes", *QUANTITIES)}
            if "closer" in entry and slug != "model":
                row |= {"closer": _of(entry["closer"]), "closer_p": entry["closer_p"], "right_p": entry["right_p"]}
                row["alone"] = f"{text(entry['only_ours']['mean'], 0)} / {text(entry['only_other']['mean'], 0)}"
    return rows


def curve_rows(report):
    """The response to one rating over the whole accepted range: a row for each axis and measure."""
    rows = {}
    for axis in RATING_AXES:
        for name, (label, digits) in _CURVES.items():
            for source, curves in report["control"]["curves"].items():
                if name == "centroid_hz" and source != "model":
                    continue
                curve = curves[axis]
                row = {value: text(leaves[name], digits) for value, leaves in curve["values"].items()}
                row["reversal"] = text(curve["reversal"][name], interval=True)
                rows[f"{axis}: {label}" + ("" if source == "model" else " (blend)")] = row
    return rows


def curve_columns(report):
    """Headings of `curve_rows`."""
    values = report["control"]["curves"]["model"][RATING_AXES[0]]["values"]
    return {value: f"{float(value):+g}" for value in values} | {"reversal": "turns back beyond ±2"}


def matrix_difference(response, real):
    """Largest difference of an entry of two 3 x 3 response matrices of leaves; None where either is unknown."""
    means = [[[leaf["mean"] for leaf in row] for row in matrix] for matrix in (response, real)]
    difference = np.abs(np.subtract(*np.array(means, dtype=float))).max()
    return float(difference) if np.isfinite(difference) else None


def effect_rows(report):
    """Figures for each guidance scale, under permuted ratings, of real textures and of regressions.

    What another section measures is left out where it was not run.
    """
    control, unseen, generation = (report[key] or {} for key in ("control", "unseen_surfaces", "generation"))
    sets = ("ftd", "diversity", "copied_share", "precision", "recall")
    rows = {"real, held out": {key: generation["real"][key] for key in sets}} if generation else {}
    for name, entry in control.items():
        if "axes" not in entry or "response" not in entry:
            continue
        row = {
            "changes": share_right(entry, control),
            "matrix": matrix_difference(entry["response"], control["response_real"]),
        }
        of_unseen = unseen.get("permuted") if name == "permuted" else unseen.get("guidance", {}).get(name)
        row["nine_band_db"] = of_unseen and of_unseen["nine_band_db"]
        of_sets = generation.get(name, {})
        row |= {key: of_sets.get(key) for key in (*sets, "ktd_excess", "diversity_of_rating")}
        rows["**ratings permuted**" if name == "permuted" else f"guidance {name}"] = row
    names = {"same_data": "the same surfaces", "many_surfaces": "fresh surfaces"}
    for key, entry in (report.get("regression") or {}).items():
        facts = f"of degree {entry['degree']['mean']:.0f} on {entry['surfaces']['mean']:.0f} of {names[key]}"
        rows[f"regression {facts}"] = {
            "nine_band_db": entry["nine_band_db"],
            "nine_band_over_model_db": text(entry.get("nine_band_over_model_db"), interval=True),
        }
    return rows


def control_facts(report):
    """What the text around the tables of control says: a dict of strings."""
    control, guidance = report["control"], default_guidance(report)
    truth = control["truth"]
    sizes = {name: size["mean"] or 0 for name, size in truth["effective_surfaces"].items()}
    few = [name for name, size in sizes.items() if size < truth["fewest_surfaces"]["mean"]]
    far = [n for n, away in truth["rating_offset"].items() if abs(away["mean"] or 0) > truth["largest_offset"]["mean"]]
    return {
        "guidance": guidance,
        "truth": _truth_facts(report["data"]),
        "fewest": f"{min(sizes.values()):.0f}",
        "extrapolated": ", ".join(few) or "none",
        "inside": ", ".join(far) or "none",
        "judge": ", ".join(f"{axis} {text(value, interval=True)}" for axis, value in control["judge_r2"].items()),
    }


def _truth_facts(data):
    """Where real changes come from."""
    recipe = "" if data.get("recipe") is None else f", recipe {data['recipe']}"
    if data.get("fresh_surfaces"):
        return f"fresh ones like those of the split {data['split']}{recipe}"
    if data["split"] == "hard":
        return f"the recorded ones of the split hard{recipe}"
    return f"all recorded ones{recipe}, those of training too, which favours what is fitted to them"


def one_rating_rows(report):
    """Level, spectrum, friction and latents with one rating set, beside real surfaces."""
    control, rows = report["control"], {}
    for axis, values in control[default_guidance(report)]["axes"].items():
        for value in (value for value in values if value in VALUES):
            rows[f"{axis} {float(value):+g}"] = values[value] | {
                f"shape_difference_{slug}": baseline["axes"][axis][value]["shape_difference_db"]
                for slug, baseline in control["baselines"].items()
            }
    return rows


def response_rows(report):
    """Slopes of estimated on requested ratings, a row for each source and estimated axis."""
    control, ours = report["control"], report["control"][default_guidance(report)]
    sources = {"real": control["response_real"], "generated": ours["response"]}
    sources |= {slug: entry["response"] for slug, entry in control["baselines"].items()}
    sources |= {"estimator, real": control["estimator_real"], "estimator, generated": ours["estimator"]}
    return {
        f"{source}: estimated {axis}": {f"requested {name}": leaf for name, leaf in zip(RATING_AXES, row, strict=True)}
        for source, matrix in sources.items()
        for axis, row in zip(RATING_AXES, matrix, strict=True)
    }
