"""Rows of the tables of control: does a change of a rating have the effect that it has between real surfaces?"""

import numpy as np

from ..signal import RATING_AXES
from .labels import default_guidance
from .tables import text

#: Ratings at which changes are compared.
VALUES = ("-2.0", "-1.0", "1.0", "2.0")
#: A change is right within this share of the real one, or within the 95 % interval of either.
TOLERANCE = 0.2
QUANTITIES = {
    "level_db_change": "level, dB",
    "shape_db": "nine-band shape, dB",
    "log_friction_change": "log friction",
    "latent_shift_dprime": "latent displacement, d′",
}


def comparisons(axes, fewest):
    """Every change of "axes" in a report's section "control" beside the real one; few effective surfaces are left out.

    A dict each: "axis", "value", "quantity", "ours", "real", "chance" (half of the 95 % interval of the real one, or of
    ours if that is wider) and "right".
    """
    rows = []
    for axis in RATING_AXES:
        for value in (value for value in VALUES if value in axes[axis]):
            for name in QUANTITIES:
                ours, real = axes[axis][value][name], axes[axis][value][f"{name}_truth"]
                if None in (ours["mean"], real["mean"]) or (real["n"] or 0) < fewest:
                    continue
                chance = max(_half(ours), _half(real))
                right = abs(ours["mean"] - real["mean"]) <= max(TOLERANCE * abs(real["mean"]), chance)
                row = {"axis": axis, "value": float(value), "quantity": name, "ours": ours["mean"]}
                rows.append(row | {"real": real["mean"], "chance": chance, "right": bool(right)})
    return rows


def _half(leaf):
    return 0.0 if leaf["interval"] is None else (leaf["interval"][1] - leaf["interval"][0]) / 2


def share_right(entry, control):
    """How many changes of a set of conditions are right, such as "29 of 36"."""
    compared = comparisons(entry["axes"], control["truth"]["fewest_surfaces"]["mean"])
    return f"{sum(row['right'] for row in compared)} of {len(compared)}"


def matrix_difference(response, real):
    """Largest difference of an entry of two 3 x 3 response matrices of leaves; None where either is unknown."""
    means = [[[leaf["mean"] for leaf in row] for row in matrix] for matrix in (response, real)]
    difference = np.abs(np.subtract(*np.array(means, dtype=float))).max()
    return float(difference) if np.isfinite(difference) else None


def effect_rows(report):
    """Figures for each guidance scale, under permuted ratings, of real textures and of regressions."""
    control, unseen, generation = report["control"], report["unseen_surfaces"], report["generation"]
    sets = ("ftd", "diversity", "copied_share", "precision", "recall")
    rows = {"real, held out": {key: generation["real"][key] for key in sets}}
    for name in [*(key for key in control if key in generation and key != "baselines"), "permuted"]:
        entry = control[name]
        row = {
            "changes": share_right(entry, control),
            "matrix": matrix_difference(entry["response"], control["response_real"]),
            "spearman": min((leaf["moved"]["mean"] or 0 for leaf in entry["spearman"].values()), default=None),
        }
        if name == "permuted":
            rows["**ratings permuted**"] = row | {"nine_band_db": unseen["permuted"]["nine_band_db"]}
        else:
            row["nine_band_db"] = unseen["guidance"][name]["nine_band_db"]
            row |= {key: generation[name][key] for key in (*sets, "ktd_excess", "diversity_of_rating")}
            rows[f"guidance {name}"] = row
    names = {"same_data": "the same surfaces", "many_surfaces": "fresh surfaces"}
    for key, entry in (report.get("regression") or {}).items():
        facts = f"of degree {entry['degree']['mean']:.0f} on {entry['surfaces']['mean']:.0f} of {names[key]}"
        rows[f"regression {facts}"] = {"nine_band_db": entry["nine_band_db"]}
    return rows


def control_facts(report):
    """What the text around the tables of control says: a dict of strings."""
    control, guidance = report["control"], default_guidance(report)
    truth, spearman = control["truth"], control[guidance]["spearman"]
    sizes = {name: size["mean"] or 0 for name, size in truth["effective_surfaces"].items()}
    few = [name for name, size in sizes.items() if size < truth["fewest_surfaces"]["mean"]]
    far = [n for n, away in truth["rating_offset"].items() if abs(away["mean"] or 0) > truth["largest_offset"]["mean"]]
    moved = {axis: entry["moved_name"].removesuffix("_db").replace("_", " ") for axis, entry in spearman.items()}
    return {
        "guidance": guidance,
        "moved": ", ".join(f"{axis}: {name}" for axis, name in moved.items()),
        "fewest": f"{min(sizes.values()):.0f}",
        "extrapolated": ", ".join(few) or "none",
        "inside": ", ".join(far) or "none",
        "judge": ", ".join(f"{axis} {text(value, interval=True)}" for axis, value in control["judge_r2"].items()),
    }


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
