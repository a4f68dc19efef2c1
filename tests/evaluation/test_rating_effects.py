"""Whether a change is right: beside planted ones, and from a report."""

import numpy as np
import pytest

from tactile_diffusers.evaluation.control_tables import (
    QUANTITIES,
    TOLERANCE,
    comparisons,
    effect_rows,
    matrix_difference,
)
from tactile_diffusers.evaluation.metrics.statistics import number
from tactile_diffusers.signal import RATING_AXES

FEWEST = 20


def _axes(**changes):
    """Conditions in which everything is as real, 2 of 2; `changes` are of roughness +1.0."""
    entry = {name: number(2.0, 100) for name in QUANTITIES}
    entry |= {f"{name}_truth": number(2.0, 50) for name in QUANTITIES}
    return {axis: {"1.0": entry | (changes if axis == "roughness" else {})} for axis in RATING_AXES}


def _right(**changes):
    (row,) = [
        row
        for row in comparisons(_axes(**changes), FEWEST)
        if (row["axis"], row["quantity"]) == ("roughness", "level_db_change")
    ]
    return row["right"]


def test_everything_is_compared_and_as_real_is_right():
    rows = comparisons(_axes(), FEWEST)
    assert [(row["axis"], row["quantity"]) for row in rows] == [(a, name) for a in RATING_AXES for name in QUANTITIES]
    for row in rows:
        assert (row["value"], row["ours"], row["real"], row["chance"], row["right"]) == (1.0, 2.0, 2.0, 0.0, True)


@pytest.mark.parametrize("real", [2.0, -2.0])
@pytest.mark.parametrize("share", [-TOLERANCE, TOLERANCE])
def test_changes_are_right_within_a_share_of_the_real_one_alone(real, share):
    for inside, expected in ((0.99, True), (1.01, False)):
        ours = number(real * (1 + inside * share), 100)
        assert _right(level_db_change=ours, level_db_change_truth=number(real, 50)) == expected
    assert not _right(level_db_change=number(-real, 100), level_db_change_truth=number(real, 50))


@pytest.mark.parametrize("whose", ["level_db_change", "level_db_change_truth"])
def test_a_difference_within_the_wider_interval_cannot_be_told(whose):
    for half, expected in ((1.01, True), (0.99, False)):
        leaves = {"level_db_change": (3.0, 100), "level_db_change_truth": (2.0, 50)}
        changes = {
            name: number(mean, n, (mean - half, mean + half) if name == whose else (mean - 0.1, mean + 0.1))
            for name, (mean, n) in leaves.items()
        }
        assert _right(**changes) == expected


@pytest.mark.parametrize(
    "change",
    [
        *({"level_db_change_truth": number(2.0, size)} for size in (FEWEST - 0.1, 1, None)),
        *({name: number()} for name in ("log_friction_change", "log_friction_change_truth")),
    ],
)
def test_too_few_surfaces_and_unknown_changes_are_left_out(change):
    (name,) = change
    found = {(row["axis"], row["quantity"]) for row in comparisons(_axes(**change), FEWEST)}
    every = {(axis, quantity) for axis in RATING_AXES for quantity in QUANTITIES}
    assert every - found == {("roughness", name.removesuffix("_truth"))}


def _matrix(values):
    return [[number(value, 100) for value in row] for row in values]


def test_difference_of_matrices_is_that_of_the_worst_entry():
    real = np.array([[0.9, 0.1, 0.0], [0.2, 0.8, 0.0], [0.0, -0.1, 0.7]])
    other = real.copy()
    other[2, 1] -= 0.25
    other[0, 0] += 0.2
    assert matrix_difference(_matrix(other), _matrix(real)) == pytest.approx(0.25)
    assert matrix_difference(_matrix(real), _matrix(real)) == 0


def _report():
    """Guidance 1.0 and 2.0 as real, permuted ratings wrong everywhere."""
    keys = "ktd_excess ftd diversity diversity_of_rating copied_share precision recall".split()
    spearman = {axis: {"moved": number(value, 9)} for axis, value in zip(RATING_AXES, (1.0, 0.9, 0.8), strict=True)}
    good = {"axes": _axes(), "response": _matrix(np.eye(3)), "spearman": spearman}
    wrong = _axes()
    for axis in RATING_AXES:
        wrong[axis]["1.0"] = wrong[axis]["1.0"] | {name: number(-2.0, 100) for name in QUANTITIES}
    bad = {"axes": wrong, "response": _matrix(np.zeros((3, 3))), "spearman": spearman}
    bad["spearman"] = {axis: {"moved": number()} for axis in RATING_AXES}
    return {
        "control": {
            "truth": {"fewest_surfaces": number(FEWEST)},
            "response_real": _matrix(np.eye(3)),
            "judge_r2": {},
            "baselines": {},
            **{"1.0": good, "2.0": good, "permuted": bad},
        },
        "unseen_surfaces": {
            "nine_band_db": {"model": number(3.0), "ridge": number(2.5), "knn_blend": number(2.8), "other": number(1)},
            "guidance": {scale: {"nine_band_db": number(3.0)} for scale in ("1.0", "2.0")},
            "permuted": {"nine_band_db": number(6.0)},
        },
        "generation": {
            "baselines": {},
            "real": {key: number(0.1) for key in keys},
            **{scale: {key: number(i) for i, key in enumerate(keys)} for scale in ("1.0", "2.0")},
        },
        "regression": {
            name: {"nine_band_db": number(error), "degree": number(3), "surfaces": number(count)}
            for name, error, count in (("same_data", 2.5, 70), ("many_surfaces", 2.25, 5000))
        },
    }


def test_figures_of_a_report_stand_beside_the_permuted_ones():
    rows = effect_rows(_report())
    real, *guided, permuted, best, fresh = rows
    assert guided == ["guidance 1.0", "guidance 2.0"] and "permuted" in permuted and "real" in real
    assert best == "regression of degree 3 on 70 of the same surfaces" and "5000 of fresh surfaces" in fresh
    changes = 3 * len(QUANTITIES)
    assert rows["guidance 1.0"]["changes"] == f"{changes} of {changes}" and rows["guidance 1.0"]["matrix"] == 0
    assert rows["guidance 1.0"]["spearman"] == 0.8  # the worst axis
    assert rows["guidance 1.0"]["diversity_of_rating"]["mean"] == 3 and rows[real]["recall"]["mean"] == 0.1
    assert rows[permuted]["changes"] == f"0 of {changes}" and rows[permuted]["matrix"] == 1
    assert rows[permuted]["spearman"] == 0 and rows[permuted]["nine_band_db"]["mean"] == 6.0
    assert rows[best]["nine_band_db"]["mean"] == 2.5 and rows[fresh]["nine_band_db"]["mean"] == 2.25
