"""Changes of a rating beside those between real surfaces: which are right, and which of two candidates comes closer.

Latent displacement is not counted: it is measured with the model's own encoder.
"""

import numpy as np

from tactile_diffusers.evaluation.metrics.statistics import estimate, number

#: Ratings at which changes are compared.
VALUES = ("-2.0", "-1.0", "1.0", "2.0")
#: A change is right within this share of the real one, or within the 95 % interval of the real one.
TOLERANCE = 0.2
#: Leaves that are counted; beside each, the real one under the same name and "_truth".
QUANTITIES = {"level_db_change": "level", "shape_db": "shape", "log_friction_change": "friction"}
#: Halves of the real surfaces that are compared with each other.
NULL_SPLITS = 10
_SCALARS = ("level_db", "log_friction")


def against_real(changes, truth, request, size=None):
    """Leaves of one condition's mean changes beside those between real surfaces, for a request (3,) z-scores.

    `changes` are "level_db", "log_friction" and "shape_db" (9,); `size` are the surfaces that count, by default all.
    """
    size, entry = truth.effective_size(request) if size is None else size, {}
    for name in _SCALARS:
        real, interval = truth.change(name, request)
        entry[f"{name}_change"] = number(changes[name])
        entry[f"{name}_change_truth"] = number(real, size, interval)
    real, (low, high) = truth.change("shape_db", request)
    change, chance = np.abs(real).mean(), float(np.mean(high - low)) / 2
    entry["shape_db"] = number(np.abs(changes["shape_db"]).mean())
    entry["shape_db_truth"] = number(change, size, (change - chance, change + chance))
    # of the vector over the bands: a change of the right size in the wrong direction is not right
    entry["shape_difference_db"] = number(np.abs(changes["shape_db"] - real).mean())
    return entry


def comparisons(axes, fewest):
    """Every change of "axes" in a report's section "control" beside the real one; few effective surfaces are left out.

    A dict each: "axis", "value", "quantity", "error" (absolute; of shape, the mean over bands), "real", "chance" (half
    of the 95 % interval of the real one) and "right", which takes the sign, or the direction over the bands, of the
    real one.
    """
    rows = []
    for axis in axes:
        for value in (value for value in VALUES if value in axes[axis]):
            entry = axes[axis][value]
            for name in QUANTITIES:
                ours, real = entry[name]["mean"], entry[f"{name}_truth"]
                if None in (ours, real["mean"]) or (real["n"] or 0) < fewest:
                    continue
                error = entry["shape_difference_db"]["mean"] if name == "shape_db" else abs(ours - real["mean"])
                low, high = real["interval"] or (0.0, 0.0)
                row = {"axis": axis, "value": float(value), "quantity": name, "error": error, "real": real["mean"]}
                row["chance"] = (high - low) / 2
                row["right"] = bool(error <= max(TOLERANCE * abs(real["mean"]), row["chance"]))
                rows.append(row)
    return rows


def no_change(axes):
    """The same conditions of a generator that ignores ratings."""
    none = {name: number(0.0) for name in QUANTITIES}
    return {
        axis: {
            value: entry | none | {"shape_difference_db": entry["shape_db_truth"]} for value, entry in values.items()
        }
        for axis, values in axes.items()
    }


def counted(rows):
    """Leaves of how many changes are right, and n, how many there are: of "changes", all, and of each quantity."""
    found = {"changes": rows} | {name: [row for row in rows if row["quantity"] == name] for name in QUANTITIES}
    return {name: number(sum(row["right"] for row in some), len(some)) for name, some in found.items()}


def paired(ours, other):
    """Two lists of `comparisons` over the conditions that both have: leaves.

    "closer" counts conditions in which ours has the smaller error, "only_ours" and "only_other" those in which one
    alone is right; "right_more" is the share that ours has right minus that of the other. Conditions of an axis share
    surfaces and noise, and so are no independent trials: there are no p-values. The interval leaves out a whole axis at
    a time; with three axes it is wide.
    """
    by_condition = {(row["axis"], row["value"], row["quantity"]): row for row in other}
    pairs = [(row, by_condition.get((row["axis"], row["value"], row["quantity"]))) for row in ours]
    pairs = [(a, b) for a, b in pairs if b is not None]
    different = [a["error"] < b["error"] for a, b in pairs if a["error"] != b["error"]]
    more = np.array([float(a["right"]) - b["right"] for a, b in pairs])
    over = (
        estimate(lambda mask: more[mask].mean(), [a["axis"] for a, _ in pairs], limits=(-1, 1)) if pairs else number()
    )
    return {
        "closer": number(sum(different), len(different)),
        "only_ours": number(np.sum(more > 0), len(pairs)),
        "only_other": number(np.sum(more < 0), len(pairs)),
        "right_more": over,
    }


def null_counts(truth, conditions, fewest, rng):
    """Leaves of `counted` for real surfaces: one half in place of the generator against the other half.

    Both halves err, the generator's and the truth's: a perfect generator would get more against all surfaces. Min and
    max are over random halves.
    `conditions` are (axis, value) -> (3,) z-scores; those with fewer than `fewest` effective surfaces in both together
    are left out.
    """
    found = []
    for _ in range(NULL_SPLITS):
        halves = truth.halves(rng)
        axes = {axis: {} for axis, _ in conditions}
        for (axis, value), request in conditions.items():
            changes = {name: halves[0].change(name, request)[0] for name in (*_SCALARS, "shape_db")}
            size = truth.effective_size(request)
            axes[axis][str(value)] = against_real(changes, halves[1], request, size)
        found.append(counted(comparisons(axes, fewest)))
    leaves = {}
    for name in found[0]:
        right = [entry[name]["mean"] for entry in found]
        leaves[name] = number(np.mean(right), found[0][name]["n"], None, min(right), max(right))
    return leaves
