"""The analysis against simulated participants of known sensitivity, and against answers made by hand."""

import numpy as np
import pytest
from study import (
    Population,
    abx_proportion_correct,
    analyse,
    check_responses,
    participant_trials,
    power,
    report_markdown,
    write_report,
)
from study.analysis import bootstrap
from study.simulated import SIMILARITY_PER_DPRIME, simulate, simulated_trials

from tactile_diffusers.signal import RATING_AXES

DPRIME = {"other_take": 0.8, "generated": 2.0, "reconstructed": 1.2, "mean_spectrum": 3.0}
RATING_SHARE = {"generated": 0.7, "mean_spectrum": 0.0}


def _population(**changes):
    """Participants alike in sensitivity, and with gains too small for the ends of the scale to matter."""
    quiet = {"dprime_spread": 0.0, "rating_gain": 1.0, "rating_gain_spread": 0.0, "rating_noise": 0.5}
    return Population(**{"dprime": DPRIME, "rating_share": RATING_SHARE, **quiet, **changes})


def _report(key, participants=12, seed=0, population=None, tasks=("abx", "similarity", "rating")):
    trials = simulated_trials(key, participants, 0, tasks)
    done = simulate(key, trials, population or _population(), np.random.default_rng(seed))
    answers, missing = check_responses(trials, done)
    return analyse(key, answers, missing, seed), answers


def _inside(leaf, value):
    low, high = leaf["interval"]
    return low <= value <= high


@pytest.mark.slow
def test_known_sensitivity_lies_in_the_interval(make_key):
    """Of 20 studies with 4 conditions each."""
    key, hits, errors = make_key(), [], []
    for seed in range(20):
        report, _ = _report(key, seed=seed, tasks=("abx",))
        for condition, dprime in DPRIME.items():
            leaf = report["abx"][condition]["dprime"]
            hits.append(_inside(leaf, dprime))
            errors.append(leaf["mean"] - dprime)
            assert _inside(report["abx"][condition]["proportion_correct"], abx_proportion_correct(dprime)) == hits[-1]
    # 80 draws of 0.95, four of them correlated, are below 0.85 less than once in a thousand
    assert np.mean(hits) >= 0.85
    assert abs(np.mean(errors)) < 0.08


@pytest.mark.slow
def test_known_slopes_lie_in_the_interval(make_key):
    key, hits = make_key(), []
    wanted = {"reference": 1.0, "generated": 0.7, "mean_spectrum": 0.0}
    for seed in range(8):
        report, _ = _report(key, seed=seed, tasks=("rating",))
        for condition, slope in wanted.items():
            hits += [_inside(report["ratings"][condition][axis]["slope"], slope) for axis in RATING_AXES]
    assert np.mean(hits) >= 0.85  # 72 draws of 0.95
    for axis in RATING_AXES:
        found = {condition: report["ratings"][condition][axis]["slope"]["mean"] for condition in wanted}
        assert found["reference"] > found["generated"] > found["mean_spectrum"]


def test_answers_made_by_hand(key):
    """A participant who always finds X, calls everything 50 alike and answers 4 plus what was asked for."""
    trials = participant_trials(key, 1, seed=0)
    copy_of = dict(zip(key["id"], key["copy_of"], strict=True))
    asked = key.set_index("id")

    def answer(row):
        if row["task"] == "abx":
            return "A" if copy_of[row["stimulus_x"]] == row["stimulus_a"] else "B"
        return "50" if row["task"] == "similarity" else f"{4 + asked.at[row['stimulus_a'], 'asked_' + row['axis']]:.6f}"

    filled = trials.assign(response=trials.apply(answer, axis=1))
    answers, missing = check_responses(trials, filled)
    report = analyse(key, answers, missing)
    assert not report["simulated"] and report["participants"] == 1
    for condition in DPRIME:
        entry = report["abx"][condition]
        assert entry["proportion_correct"]["mean"] == 1 and entry["proportion_correct"]["interval"] is None
        assert report["abx_participants"]["p001"][condition]["trials"] == 24
        assert report["similarity"][condition]["similarity"]["mean"] == 50
    for axis in RATING_AXES:
        entry = report["ratings"]["reference"][axis]
        assert entry["slope"]["mean"] == pytest.approx(1, abs=1e-5)  # answers have six decimals
        assert entry["correlation"]["mean"] == pytest.approx(1, abs=1e-5)
        assert report["ratings"]["generated"][axis]["difference"]["mean"] == pytest.approx(0, abs=1e-5)
        assert entry["difference"]["mean"] is None
        assert entry["spread"] is None and report["reliability"][axis]["alpha"] is None


def test_bootstrap_covers_the_mean_and_knows_its_limits():
    rng = np.random.default_rng(0)
    hits = [_inside(bootstrap(rng.standard_normal(30), seed), 0.0) for seed in range(100)]
    assert np.mean(hits) >= 0.88  # 100 draws of 0.95 are below once in 500
    assert bootstrap([1.0, 2.0])["interval"] is None and bootstrap([np.nan])["mean"] is None
    assert bootstrap([0.5] * 4)["interval"] == [0.5, 0.5]


def test_tasks_left_out_are_left_out_of_the_report(key, tmp_path):
    report, answers = _report(key, participants=3, tasks=("similarity",))
    assert report["abx"] is None and report["ratings"] is None and report["reliability"] is None
    write_report(tmp_path / "report", report, key, answers)
    assert sorted(path.name for path in (tmp_path / "report").iterdir()) == [
        "report.json",
        "report.md",
        "similarity.png",
    ]


def test_simulated_participants_are_called_so_everywhere(key, tmp_path):
    report, answers = _report(key, participants=3)
    assert report["simulated"] and answers["participant"].str.startswith("simulated").all()
    assert "SIMULATED" in report_markdown(report).splitlines()[2]
    write_report(tmp_path, report, key, answers)
    for name in ("abx.png", "similarity.png", "ratings.png"):
        assert (tmp_path / name).stat().st_size > 10_000


def test_power_grows_with_sensitivity(make_key):
    key = make_key(surfaces=3, conditions=("reference", "other_take", "generated", "ridge"))
    population = _population(dprime={"other_take": 0.8, "generated": 0.8, "ridge": 4.0}, rating_share={})
    shares = power(key, 8, 0, population, tasks=("abx", "similarity"), repeats=20)
    assert shares["abx_unlike_other_take"]["ridge"] > 0.9 and shares["similarity_unlike_other_take"]["ridge"] > 0.9
    # nothing to find: false alarms; 20 draws of 0.06 exceed 5 once in a thousand
    assert shares["abx_unlike_other_take"]["generated"] <= 0.25
    assert "slope_unlike_zero" not in shares


def test_power_refuses_unknown_conditions(key):
    with pytest.raises(ValueError, match="`dprime` names 'velvet'"):
        power(key, 3, 0, Population({"velvet": 1.0}), repeats=1)
    with pytest.raises(ValueError, match="`dprime` names 'reference'"):  # it differs from itself by nothing
        power(key, 3, 0, Population({"reference": 1.0}), repeats=1)
    with pytest.raises(ValueError, match="`repeats` must be a whole number"):
        power(key, 3, 0, Population(), repeats=0)


def test_similarity_is_compared_with_another_take(key):
    report, answers = _report(key, population=_population(similarity_noise=3.0))
    for condition, dprime in DPRIME.items():
        leaf = report["similarity"][condition]["similarity"]
        # 12 participants x 6 surfaces, noise 3: standard error 0.35
        assert leaf["mean"] == pytest.approx(100 - SIMILARITY_PER_DPRIME * dprime, abs=1.5)
    expected = -SIMILARITY_PER_DPRIME * (DPRIME["generated"] - DPRIME["other_take"])
    assert report["similarity"]["generated"]["difference"]["mean"] == pytest.approx(expected, abs=2)
    assert report["similarity"]["other_take"]["difference"]["mean"] is None
    assert report["similarity"]["other_surface"]["similarity"]["mean"] < 40
    assert report["answers"] == answers["task"].value_counts().to_dict()


def test_axes_are_those_that_the_key_asks_for(make_key, tmp_path):
    """Five, of which two nobody here knows: all are rated, analysed and drawn, in a balanced order."""
    axes = ("roughness", "bumpiness", "slipperiness", "fineness", "warmth")
    key = make_key(surfaces=8, axes=axes)
    report, answers = _report(key, 6, tasks=("rating",))
    assert set(answers.groupby("participant")["axis"].first()) == set(axes)
    assert tuple(report["reliability"]) == axes == tuple(report["ratings"]["reference"])
    for axis in axes:
        assert _inside(report["ratings"]["generated"][axis]["slope"], RATING_SHARE["generated"])
    write_report(tmp_path, report, key, answers)
    assert "reference take: warmth" in (tmp_path / "report.md").read_text()
    assert (tmp_path / "ratings.png").is_file()
