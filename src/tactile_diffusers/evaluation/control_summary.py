"""Whether a change of a rating has the effect that it has between real surfaces: rows of tables, from a report."""

import numpy as np

from ..signal import RATING_AXES

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
    """Every change beside the real one.

    Args:
        axes (`dict`): "axes" of a set of conditions in a report's section "control".
        fewest (`float`): effective surfaces below which a condition is left out.

    Returns:
        `list[dict]`: "axis", "value", "quantity", "ours", "real", "chance" (half of the 95 % interval of the real one,
        or of ours if that is wider) and "right".
    """
    rows = []
    for axis in RATING_AXES:
        for value in (value for value in VALUES if value in axes[axis]):
            entry = axes[axis][value]
            for name in QUANTITIES:
                ours, real = entry[name], entry[f"{name}_truth"]
                if None in (ours["mean"], real["mean"]) or (real["n"] or 0) < fewest:
                    continue
                chance = max(_half(ours), _half(real))
                difference = abs(ours["mean"] - real["mean"])
                right = difference <= max(TOLERANCE * abs(real["mean"]), chance)
                row = {"axis": axis, "value": float(value), "quantity": name, "ours": ours["mean"]}
                rows.append(row | {"real": real["mean"], "chance": chance, "right": bool(right)})
    return rows


def matrix_difference(response, real):
    """Largest difference of an entry of two 3 x 3 response matrices of leaves; None where either is unknown."""
    matrices = [
        np.array([[leaf["mean"] for leaf in row] for row in matrix], dtype=float) for matrix in (response, real)
    ]
    difference = np.abs(matrices[0] - matrices[1]).max()
    return float(difference) if np.isfinite(difference) else None


def control_rows(report):
    """Figures of a report for each guidance scale, under permuted ratings, and of real textures.

    Args:
        report (`dict`): with the sections control, generation and unseen_surfaces.

    Returns:
        `dict[str, dict]`: row -> {column: text, number or leaf}.
    """
    control, unseen, generation = report["control"], report["unseen_surfaces"], report["generation"]
    fewest = control["truth"]["fewest_surfaces"]["mean"]
    sets = ("ftd", "diversity", "novelty_share", "precision", "recall")
    rows = {"real, held out": {key: generation["real"][key] for key in sets}}
    for name in [*(key for key in control if key in generation and key != "baselines"), "permuted"]:
        entry = control[name]
        compared = comparisons(entry["axes"], fewest)
        row = {
            "changes": f"{sum(item['right'] for item in compared)} of {len(compared)}",
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


def _half(leaf):
    interval = leaf["interval"]
    return 0.0 if interval is None else (interval[1] - interval[0]) / 2
