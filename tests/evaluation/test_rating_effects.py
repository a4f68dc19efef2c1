"""Whether a change is right: beside planted ones, and from a report."""

import numpy as np
import pytest
from report.changes import (
    QUANTITIES,
    TOLERANCE,
    against_real,
    comparisons,
    counted,
    no_change,
    null_counts,
    paired,
)
from report.control_tables import change_rows, effect_rows, matrix_difference

from tactile_diffusers.evaluation.metrics.statistics import number
from tactile_diffusers.evaluation.truth import RatedTextures
from tactile_diffusers.signal import RATING_AXES

FEWEST = 20


def _axes(**changes):
    """Conditions in which everything is as real, 2 of 2; `changes` are of roughness +1.0."""
    entry = {name: number(2.0, 100) for name in QUANTITIES} | {"shape_difference_db": number(0.0)}
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
        assert (row["value"], row["error"], row["real"], row["chance"], row["right"]) == (1.0, 0.0, 2.0, 0.0, True)


@pytest.mark.parametrize("real", [2.0, -2.0])
@pytest.mark.parametrize("share", [-TOLERANCE, TOLERANCE])
def test_changes_are_right_within_a_share_of_the_real_one_alone(real, share):
    for inside, expected in ((0.99, True), (1.01, False)):
        ours = number(real * (1 + inside * share), 100)
        assert _right(level_db_change=ours, level_db_change_truth=number(real, 50)) == expected
    assert not _right(level_db_change=number(-real, 100), level_db_change_truth=number(real, 50))


def test_a_difference_within_the_interval_of_the_real_change_cannot_be_told():
    for half, expected in ((1.01, True), (0.99, False)):
        real = number(2.0, 50, (2 - half, 2 + half))
        assert _right(level_db_change=number(3.0, 100, (2.9, 3.1)), level_db_change_truth=real) == expected
        # a generator whose takes scatter is not right for that
        scattered = number(3.0, 100, (3 - half, 3 + half))
        assert not _right(level_db_change=scattered, level_db_change_truth=number(2.0, 50, (1.9, 2.1)))


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


def _rated(rng, surfaces=400, noise=0.5):
    """Surfaces whose level rises, whose friction falls and whose spectrum tilts with roughness; two textures each."""
    ids = np.repeat(np.arange(surfaces), 2)
    ratings = rng.standard_normal((surfaces, 3))
    rough = ratings[ids, 0] + noise * rng.standard_normal(len(ids))
    measures = {"level_db": 4 * rough, "shape_db": rough[:, None] * TILT, "log_friction": -0.3 * rough}
    return RatedTextures(measures, ids, ratings, np.ones(surfaces))


TILT = np.linspace(-2, 2, 9)
PLUS_ONE = {("roughness", 1.0): np.array([1.0, np.nan, np.nan])}


def _of_one(entry):
    """`comparisons` of a single condition, roughness +1."""
    rows = comparisons({"roughness": {"1.0": entry}, "bumpiness": {}, "slipperiness": {}}, FEWEST)
    return {row["quantity"]: row["right"] for row in rows}


def test_a_change_of_the_right_size_in_the_wrong_direction_is_wrong():
    truth = _rated(np.random.default_rng(0))
    (request,) = PLUS_ONE.values()
    real = {name: truth.change(name, request)[0] for name in ("level_db", "shape_db", "log_friction")}
    entry = against_real(real, truth, request)
    assert _of_one(entry) == dict.fromkeys(QUANTITIES, True) and entry["shape_difference_db"]["mean"] < 1e-9
    turned = against_real({name: -value for name, value in real.items()}, truth, request)
    assert turned["shape_db"]["mean"] == pytest.approx(
        entry["shape_db"]["mean"]
    )  # as large, which the sizes alone pass
    assert _of_one(turned) == dict.fromkeys(QUANTITIES, False)
    shuffled = against_real(real | {"shape_db": np.roll(real["shape_db"], 4)}, truth, request)
    assert _of_one(shuffled) == dict.fromkeys(QUANTITIES, True) | {"shape_db": False}
    (still,) = no_change({"roughness": {"1.0": entry}})["roughness"].values()
    assert _of_one(still) == dict.fromkeys(QUANTITIES, False)


def test_change_and_its_interval_are_those_of_a_difference():
    """A population mean that moves with every surface cancels: the interval is of the change alone."""
    truth = _rated(np.random.default_rng(1), noise=0.0)
    (request,) = PLUS_ONE.values()
    value, (low, high) = truth.change("level_db", request)
    mean = truth.ratings[:, 0].mean()
    assert value == pytest.approx(4 * (truth.mean_rating(request)[0] - mean)) and low < value < high
    nothing, interval = truth.change("level_db", np.full(3, np.nan))
    assert nothing == 0 and np.allclose(interval, 0)


def test_halves_of_real_surfaces_are_nearly_always_right_and_share_none():
    rng = np.random.default_rng(2)
    truth = _rated(rng, surfaces=2000)
    first, second = truth.halves(rng)
    assert len(first.ratings) == len(second.ratings) == 1000
    assert not {*map(tuple, first.ratings)} & {*map(tuple, second.ratings)}
    assert np.array_equal(np.unique(second.surface_ids), np.arange(1000))
    counts = null_counts(truth, PLUS_ONE, FEWEST, rng)
    # by a normal error 1.39 / 1.96 of the interval is covered, 83 %, and the tolerance of 20 % adds to it
    assert counts["changes"]["n"] == 3 and counts["changes"]["mean"] > 2.4 and counts["shape_db"]["n"] == 1


def test_paired_comparison_is_over_the_same_conditions():
    """Ours is right in all of 6, the other in none; one condition that the other lacks is left out."""
    ours = comparisons(_axes(), FEWEST)
    wrong = {name: number(5.0) for name in QUANTITIES} | {"shape_difference_db": number(3.0)}
    other = comparisons({axis: {"1.0": entry["1.0"] | wrong} for axis, entry in _axes().items()}, FEWEST)
    pair = paired(ours, other[1:])
    count = 3 * len(QUANTITIES) - 1
    assert (pair["closer"]["mean"], pair["closer"]["n"]) == (count, count)
    assert pair["right_more"]["mean"] == 1 and pair["right_more"]["interval"] == [1, 1]
    assert (pair["only_ours"]["mean"], pair["only_other"]["mean"]) == (count, 0)
    same = paired(ours, ours)
    assert same["closer"]["n"] == 0 == same["right_more"]["mean"]


def test_the_interval_of_a_paired_comparison_leaves_out_an_axis():
    """Ours alone is right in all of roughness and none else: one axis in three, which three axes cannot settle."""
    wrong = {name: number(5.0) for name in QUANTITIES} | {"shape_difference_db": number(3.0)}
    other = _axes()
    other["roughness"]["1.0"] |= wrong
    pair = paired(comparisons(_axes(), FEWEST), comparisons(other, FEWEST))
    assert pair["right_more"]["mean"] == pytest.approx(1 / 3)
    # Student's t of 2 degrees of freedom, 4.30, times the standard error of three values, 1/3
    assert pair["right_more"]["interval"] == pytest.approx([-1.0, 1.0])


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
    good = {"axes": _axes(), "response": _matrix(np.eye(3))}
    wrong = _axes()
    for axis in RATING_AXES:
        wrong[axis]["1.0"] |= {name: number(-2.0, 100) for name in QUANTITIES} | {"shape_difference_db": number(4.0)}
    bad = {"axes": wrong, "response": _matrix(np.zeros((3, 3)))}
    rows = {"model": comparisons(_axes(), FEWEST), "permuted": comparisons(wrong, FEWEST)}
    counts = {name: counted(some) | paired(rows["model"], some) for name, some in rows.items()}
    return {
        "control": {
            "counts": counts | {"null": {name: number(2.5, 3, None, 2, 3) for name in ("changes", *QUANTITIES)}},
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
        "regression": {
            name: {"nine_band_db": number(error), "degree": number(3), "surfaces": number(count)}
            for name, error, count in (("same_data", 2.5, 70), ("many_surfaces", 2.25, 5000))
        },
    }


def test_figures_of_a_report_stand_beside_the_permuted_ones():
    rows = effect_rows(_report())
    *guided, permuted, best, fresh = rows
    assert guided == ["guidance 1.0", "guidance 2.0"] and "permuted" in permuted
    assert best == "regression of degree 3 on 70 of the training surfaces" and "5000 of fresh surfaces" in fresh
    changes = 3 * len(QUANTITIES)
    assert rows["guidance 1.0"]["changes"] == f"{changes} of {changes}" and rows["guidance 1.0"]["matrix"] == 0
    assert rows[permuted]["changes"] == f"0 of {changes}" and rows[permuted]["matrix"] == 1
    assert rows[permuted]["nine_band_db"]["mean"] == 6.0
    assert rows[best]["nine_band_db"]["mean"] == 2.5 and rows[fresh]["nine_band_db"]["mean"] == 2.25
    shown = change_rows(_report())
    assert shown["**generated**"]["changes"] == f"{changes} of {changes}" and "closer" not in shown["**generated**"]
    permuted = shown["generated, ratings permuted"]
    assert (permuted["closer"], permuted["alone"]) == (f"{changes} of {changes}", f"{changes} / 0")
    assert shown["real surfaces, one half for the other"]["changes"] == "2.5 of 3 (2–3)"


def test_sections_that_were_not_run_are_left_out():
    report = _report() | {"unseen_surfaces": None, "regression": None}
    rows = effect_rows(report)
    assert list(rows) == ["guidance 1.0", "guidance 2.0", "**ratings permuted**"]
    assert rows["guidance 1.0"]["nine_band_db"] is None is rows["**ratings permuted**"]["nine_band_db"]
