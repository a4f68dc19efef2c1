"""Rows of the tables of control: does a change of a rating have the effect that it has between real surfaces?"""

import numpy as np

from .changes import QUANTITIES, comparisons, counted
from .labels import default_guidance
from .tables import text

#: Rows of the table of changes.
_CANDIDATES = {
    "null": "real surfaces, one half for the other",
    "model": "**generated**",
    "knn_blend": "blend of 5 nearest surfaces",
    "ridge": "ridge regression and noise",
    "regression": "best polynomial of the rating",
    "knn_blend_equal": "blend of 5 nearest of {equal} other surfaces, as many as the bundled model learned from",
    "regression_equal": "best polynomial on these",
    "permuted": "generated, ratings permuted",
    "none": "no change at all",
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
            name = name.format(equal=(report.get("settings") or {}).get("equal_surfaces"))
            rows[name] = row = {key: _of(entry[key]) for key in ("changes", *QUANTITIES)}
            if "closer" in entry and slug != "model":
                row["closer"], row["right_more"] = _of(entry["closer"]), text(entry.get("right_more"), interval=True)
                row["alone"] = f"{text(entry['only_ours']['mean'], 0)} / {text(entry['only_other']['mean'], 0)}"
    return rows


def curve_rows(report):
    """How far the response to one rating turns back beyond ±2: a row for each axis, of the model and of the blend."""
    curves = report["control"]["curves"]
    return {
        f"{axis}, {_CANDIDATES[source]}": by_axis[axis]["reversal"]
        for axis in next(iter(curves.values()))
        for source, by_axis in curves.items()
    }


def matrix_difference(response, real):
    """Largest difference of an entry of two 3 x 3 response matrices of leaves; None where either is unknown."""
    means = [[[leaf["mean"] for leaf in row] for row in matrix] for matrix in (response, real)]
    difference = np.abs(np.subtract(*np.array(means, dtype=float))).max()
    return float(difference) if np.isfinite(difference) else None


def effect_rows(report):
    """Figures for each guidance scale, under permuted ratings and of regressions.

    What another section measures is left out where it was not run; how real the textures are is another table.
    """
    control, unseen = (report[key] or {} for key in ("control", "unseen_surfaces"))
    rows = {}
    for name, entry in control.items():
        if "axes" not in entry or "response" not in entry:
            continue
        row = {"changes": share_right(entry, control)}
        row["matrix"] = matrix_difference(entry["response"], control["response_real"])
        of_unseen = unseen.get("permuted") if name == "permuted" else unseen.get("guidance", {}).get(name)
        row["nine_band_db"] = of_unseen and of_unseen["nine_band_db"]
        rows["**ratings permuted**" if name == "permuted" else f"guidance {name}"] = row
    names = {"same_data": "the training surfaces", "many_surfaces": "fresh surfaces"}
    for key, entry in (report.get("regression") or {}).items():
        facts = f"of degree {entry['degree']['mean']:.0f} on {entry['surfaces']['mean']:.0f} of {names[key]}"
        rows[f"regression {facts}"] = {
            "nine_band_db": entry["nine_band_db"],
            "nine_band_over_model_db": text(entry.get("nine_band_over_model_db"), interval=True),
        }
    return rows


def control_facts(report):
    """What the text around the tables of control says: a dict of strings."""
    control, truth = report["control"], report["control"]["truth"]
    sizes = {name: size["mean"] or 0 for name, size in truth["effective_surfaces"].items()}
    few = [name for name, size in sizes.items() if size < truth["fewest_surfaces"]["mean"]]
    far = [n for n, away in truth["rating_offset"].items() if abs(away["mean"] or 0) > truth["largest_offset"]["mean"]]
    return {
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


def response_rows(report):
    """Slopes of estimated on requested ratings, a row for each source and estimated axis."""
    control, ours = report["control"], report["control"][default_guidance(report)]
    axes = list(ours["axes"])
    sources = {"real": control["response_real"], "generated": ours["response"]}
    sources |= {slug: entry["response"] for slug, entry in control["baselines"].items()}
    return {
        f"{source}: estimated {axis}": {f"requested {name}": leaf for name, leaf in zip(axes, row, strict=True)}
        for source, matrix in sources.items()
        for axis, row in zip(axes, matrix, strict=True)
    }
