"""The report as a whole, on a tiny pipeline and a few virtual surfaces: contract, resuming, determinism, refusals."""

import json
from dataclasses import replace
from pathlib import Path

import evaluate
import numpy as np
import pytest
import torch
from matplotlib.figure import Figure
from report import virtual_truth
from report.baselines import SLUGS
from report.page import report_markdown
from report.running import run_sections
from report.sections import QUICK, SECTIONS, make_context, speed
from report.sections.generation import matching_rows
from report.sections.reconstruction import fewest_steps, power_percent
from report.tables import markdown_table, text

from tactile_diffusers.data import HoldOut, PreparedDataset, SegmentLimits, prepare_recordings
from tactile_diffusers.evaluation.metrics.statistics import is_leaf
from tactile_diffusers.pipelines.folders import folder_digest
from tactile_diffusers.virtual import generate_recordings

SECONDS = 2048 / 2500  # the shortest segment that an embedding and the tiny networks share
TINY = replace(
    QUICK,
    steps=(1, 10),
    per_surface=2,
    takes=2,
    judge_takes=1,
    control_values=(-2.0, -1.0, 1.0, 2.0),
    control_takes=3,
    response_takes=2,
    truth_candidates=300,
    truth_surfaces=12,
    truth_seconds=4.0,
    regression_surfaces=20,
    paper_step=2.0,
    paper_takes=2,
    protocol_segments=2,
    protocol_repeats=2,
    repeats=1,
)
FEW = replace(TINY, control_values=(-1.0, 1.0), response_takes=1)
METRICS = (
    "nine_band_db lsd_db gfc rmse_n snr_db power_difference_n2 level_error_db band_error_db_20_60 "
    "band_error_db_60_150 band_error_db_400_650 band_error_db_650_1000 out_of_band_db ftd ktd "
    "ktd_excess power_bias_percent power_difference_percent"
).split()


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """24 virtual surfaces, 8 of them for testing, in segments of the tiny networks' length."""
    folder = tmp_path_factory.mktemp("report")
    generate_recordings(folder / "r.h5", surfaces=24, seconds=10, explorers=2, seed=2, quiet=True)
    limits = SegmentLimits(seconds=SECONDS)
    prepare_recordings(folder / "r.h5", folder / "p.h5", limits=limits, validation=2, test=8, quiet=True)
    return folder / "p.h5"


@pytest.fixture
def blank_pictures(monkeypatch):
    """Drawing takes most of the time of a report on a tiny pipeline; one test draws."""
    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **options: Path(path).touch())


def leaves(entry, path=()):
    """All leaves below an entry of a report: pairs of path and leaf."""
    if is_leaf(entry):
        yield path, entry
    elif isinstance(entry, dict | list):
        for key, value in entry.items() if isinstance(entry, dict) else enumerate(entry):
            yield from leaves(value, (*path, key))


def _report(pipe, prepared, folder, names=tuple(SECTIONS), seed=0, settings=TINY, split="test"):
    checkpoint = folder / "checkpoint"
    if not checkpoint.exists():
        pipe.save_pretrained(checkpoint)
    context = make_context(pipe, prepared, split, settings, seed, folder / "out")
    return run_sections(context, names, checkpoint)


def test_report_keeps_its_contract(evaluable_pipe, prepared, tmp_path, monkeypatch):
    # tiny networks do hundreds of steps in real time; a step that costs 10 ms keeps the test short
    monkeypatch.setattr(speed, "decoding_seconds", lambda pipe, steps, repeats, frames: np.full(repeats, 0.01 * steps))
    report = _report(evaluable_pipe(), prepared, tmp_path)
    json.dumps(report, allow_nan=False)
    assert report["data"]["embedding_version"] == 2
    judged = report["second_judge"]["rows"]
    assert {"other_take", "lctg", "no_network", "model", "nearest_surface", "knn_blend", "ridge"} <= set(judged)
    for entry in (found for row in judged.values() for kinds in row.values() for found in kinds.values()):
        assert 0 <= entry["all"]["mean"] <= 1 and is_leaf(entry["eventful"]) and len(entry["features"]) == 5
    assert judged["other_take"]["signal"]["alone"]["over_chance"]["mean"] == 0
    for key in "checkpoint data seed machine versions reconstruction generation control unseen_surfaces speed".split():
        assert report[key] is not None, key
    assert report["training"]["optimiser_steps"] is None
    reconstruction, step = report["reconstruction"], report["reconstruction"]["steps"]["10"]
    for entry in (step, *reconstruction["baselines"].values()):
        assert all(is_leaf(entry[metric]) for metric in METRICS)
    assert is_leaf(step["seconds_per_segment"]) and is_leaf(step["efficiency_score"])
    assert list(reconstruction["baselines"]) == list(SLUGS) == list(report["generation"]["baselines"])
    assert reconstruction["steps_within_5_percent"]["mean"] > 0 < reconstruction["kilobits_per_second"]["mean"]
    assert list(reconstruction["decoders"]) == ["lctg", "no_network"] and is_leaf(
        reconstruction["network"]["all_layers"]["ktd"]
    )
    excess = step["ktd"]["mean"] - reconstruction["real"]["ktd"]["mean"]
    assert step["ktd_excess"]["mean"] == pytest.approx(excess)
    silence = reconstruction["baselines"]["silence"]
    assert silence["snr_db"]["mean"] == pytest.approx(0, abs=1e-9)
    assert silence["power_bias_percent"]["mean"] == pytest.approx(100)
    assert silence["rmse_n"]["mean"] == pytest.approx(reconstruction["real"]["rms_n"]["mean"])
    generation = report["generation"]["1.0"]
    metrics = "ftd ktd ftd_excess diversity nearest_correlation copied_share precision recall"
    assert all(is_leaf(generation[metric]) for metric in metrics.split())
    over_real = generation["ktd"]["mean"] - report["generation"]["real"]["ktd"]["mean"]
    assert generation["ktd_excess"]["mean"] == pytest.approx(over_real)
    assert generation["ftd"]["mean"] is None is generation["ftd_excess"]["mean"]  # too few textures for a covariance
    assert generation["rmse_protocol_n"]["n"] == 4
    control = report["control"]
    permuted, axes = control["permuted"], control["1.0"]["axes"]
    assert set(control["judge_r2"]) == {"roughness", "bumpiness", "slipperiness"}
    for matrix in (control["response_real"], control["1.0"]["response"], permuted["response"]):
        assert np.array([[leaf["mean"] for leaf in row] for row in matrix]).shape == (3, 3)
    for axis in control["judge_r2"]:
        for value, other in (("-2.0", "1.0"), ("-1.0", "2.0"), ("1.0", "-2.0"), ("2.0", "-1.0")):
            entry, wrong = axes[axis][value], permuted["axes"][axis][value]
            for name in "level_db shape_db log_friction".split():
                assert is_leaf(entry[name]) and entry[f"{name}_truth"]["mean"] is not None
            assert wrong["level_db"] == axes[axis][other]["level_db"] != entry["level_db"]
            assert wrong["level_db_truth"] == entry["level_db_truth"]
    unseen = report["unseen_surfaces"]
    assert set(unseen["nine_band_db"]) == {"model", *SLUGS}
    ours, fitted = unseen["nine_band_db"]["model"]["mean"], report["regression"]["same_data"]
    ridge = unseen["nine_band_db"]["ridge"], unseen["nine_band_over_model_db"]["ridge"]
    for whole, more in (ridge, (fitted["nine_band_db"], fitted["nine_band_over_model_db"])):
        assert more["mean"] == pytest.approx(whole["mean"] - ours) and more["n"] == whole["n"]
    assert unseen["permuted"]["nine_band_db"] != unseen["nine_band_db"]["model"]
    counts = {"model", "permuted", "knn_blend", "ridge", "regression", "none", "null"}
    assert set(control["counts"]) == counts | {"knn_blend_equal", "regression_equal"}
    assert is_leaf(control["counts"]["ridge"]["right_more"])
    assert set(control["curves"]) == {"model", "knn_blend"}
    for axis, curve in control["curves"]["model"].items():
        assert list(curve["values"])[0] == "-6.0" and len(curve["values"]) == 13, axis
        for measures in (*curve["values"].values(), curve["reversal"]):
            assert all(np.isfinite(measures[name]["mean"]) for name in ("level_db", "centroid_hz", "log_friction"))
    assert report["paper"]["latent_shift_percent"]["roughness"]["0.0"]["mean"] == pytest.approx(0, abs=1e-3)
    assert report["speed"]["segment"]["real_time_steps"]["mean"] == int(SECONDS / 0.01)
    found = list(leaves(report))
    assert len(found) > 500
    for path, leaf in found:
        assert leaf["interval"] is None or leaf["interval"][0] <= leaf["mean"] <= leaf["interval"][1], path
    for name in "overlays second_judge control curves latent_shift spectra".split():
        assert (tmp_path / "out" / f"{name}.png").stat().st_size > 5000
    written = report_markdown(report)
    assert "KTD over real" in written and "another take" in written and "nan" not in written.lower()


@pytest.mark.usefixtures("blank_pictures")
def test_the_hard_split_has_generation_and_control(evaluable_pipe, tmp_path):
    """A class, a finger and two raters that training does not see; what is real there is of them alone."""
    generate_recordings(tmp_path / "r.h5", surfaces=30, seconds=6, explorers=2, seed=2, quiet=True)
    hold_out = HoldOut(("*-wood",), ("explorer-1",), ("rater-1", "rater-2"))
    sizes, limits = dict(validation=2, test=2), SegmentLimits(seconds=SECONDS)
    prepare_recordings(tmp_path / "r.h5", tmp_path / "p.h5", limits=limits, hold_out=hold_out, quiet=True, **sizes)
    report = _report(evaluable_pipe(), tmp_path / "p.h5", tmp_path, ["generation", "control"], 0, FEW, "hard")
    assert report["data"]["split"] == "hard" and report["data"]["surfaces"] >= 2
    assert is_leaf(report["generation"]["1.0"]["ktd"]) and report["unseen_surfaces"]["nine_band_db"]["model"]["mean"]
    assert report["control"]["1.0"]["axes"]["roughness"]["1.0"]["level_db_truth"]["mean"] is not None
    written = report_markdown(report)
    assert "like those of the split hard, recipe" in written
    assert "hard (not in training: surfaces *-wood; explorers explorer-1; raters rater-1, rater-2);" in written


@pytest.mark.usefixtures("blank_pictures")
@pytest.mark.parametrize(
    ("hold_out", "named"),
    [
        (HoldOut(explorers=("explorer-1",)), "explorers explorer-1"),
        (HoldOut(raters=("rater-1", "rater-2")), "raters rater-1, rater-2"),
    ],
)
def test_a_hard_split_of_fingers_or_raters_has_generation_figures(evaluable_pipe, prepared, tmp_path, hold_out, named):
    """Training has the surfaces too, but none of the recordings: of raters, only what is in no training recording."""
    limits, sizes = SegmentLimits(seconds=SECONDS), dict(validation=2, test=8)
    path = tmp_path / "p.h5"
    prepare_recordings(prepared.parent / "r.h5", path, limits=limits, hold_out=hold_out, quiet=True, **sizes)
    report = _report(evaluable_pipe(), path, tmp_path, ["generation", "second_judge", "control"], 0, FEW, "hard")
    generation, train = report["generation"], PreparedDataset(path, "train")
    assert is_leaf(generation["1.0"]["ktd"]) and report["unseen_surfaces"]["nine_band_db"]["model"]["mean"]
    assert generation["real"]["nearest_correlation"]["mean"] < 0.9  # a training segment would have 1
    assert f"of the split hard (not in training: {named});" in report_markdown(report)
    data = make_context(evaluable_pipe(), path, "hard", FEW, 0, tmp_path).data
    assert not np.isin(data.dataset.recording_ids[[*data.rows, *data.other_rows]], train.recording_ids).any()
    # all surfaces, but those too short for two segments; of raters, those of validation and test
    assert 20 < report["data"]["surfaces"] <= 24 if hold_out.explorers else report["data"]["surfaces"] == 10


@pytest.mark.usefixtures("blank_pictures")
def test_another_recipe_is_evaluated_as_recordings_and_named(evaluable_pipe, prepared, tmp_path, monkeypatch):
    made = virtual_truth.RECIPE_VERSION
    monkeypatch.setattr(virtual_truth, "RECIPE_VERSION", made + 1)
    report = _report(evaluable_pipe(), prepared, tmp_path, ["control", "regression"], settings=FEW)
    assert (report["data"]["recipe"], report["data"]["fresh_surfaces"]) == (made, False)
    assert "many_surfaces" not in report["regression"]
    assert report["control"]["truth"]["effective_surfaces"]["roughness +1"]["n"] == 24  # all of the file
    assert f"all recorded ones, recipe {made}, those of training too" in report_markdown(report)


@pytest.mark.usefixtures("blank_pictures")
def test_done_sections_are_read_not_run_again(evaluable_pipe, prepared, tmp_path, monkeypatch):
    pipe, runs = evaluable_pipe(dale=False), []
    monkeypatch.setitem(SECTIONS, "speed", lambda context: runs.append(context) or {"speed": len(runs)})

    def run(seed=0):
        return _report(pipe, prepared, tmp_path, ["speed"], seed)["speed"]

    assert [run(), run(), run(seed=1)] == [1, 1, 2]
    path = tmp_path / "out" / "sections" / "speed.json"
    path.write_text(path.read_text()[:-20])
    assert run(seed=1) == 3
    with torch.no_grad():
        next(pipe.lctg.parameters()).add_(1.0)
    pipe.save_pretrained(tmp_path / "checkpoint")
    assert run(seed=1) == 4


@pytest.mark.usefixtures("blank_pictures")
def test_second_judge_judges_decoders_without_ratings(evaluable_pipe, prepared, tmp_path):
    report = _report(evaluable_pipe(dale=False), prepared, tmp_path, ["second_judge"])
    assert {"other_take", "lctg", "no_network"} <= set(report["second_judge"]["rows"])
    assert not {"model", "ridge", "nearest_surface"} & set(report["second_judge"]["rows"])
    assert "another real take (chance)" in report_markdown(report)


@pytest.mark.usefixtures("blank_pictures")
def test_split_is_said_and_another_one_is_measured_anew(evaluable_pipe, prepared, tmp_path):
    pipe = evaluable_pipe(dale=False)
    settings = replace(TINY, steps=(1,))
    found = {
        split: _report(pipe, prepared, tmp_path, ["reconstruction"], settings=settings, split=split)
        for split in ("test", "validation")
    }
    for split, surfaces in (("test", 8), ("validation", 2)):
        report = found[split]
        assert report["data"]["split"] == split and f"of the split {split};" in report_markdown(report)
        assert report["data"]["surfaces"] == surfaces
        assert report["reconstruction"]["real"]["rms_n"]["n"] == report["data"]["segments"] <= 2 * surfaces
    first, second = (report["reconstruction"]["real"]["rms_n"]["mean"] for report in found.values())
    assert first != second


@pytest.mark.parametrize("split", ["train", "tests"])
def test_a_split_that_is_not_held_out_is_refused(evaluable_pipe, prepared, tmp_path, split):
    with pytest.raises(ValueError, match=f"`split` must be held out.*got '{split}'"):
        make_context(evaluable_pipe(), prepared, split, TINY, 0, tmp_path)


def test_too_few_surfaces_are_refused_with_the_option_that_helps(evaluable_pipe, prepared, tmp_path):
    limits = SegmentLimits(seconds=SECONDS)
    prepare_recordings(prepared.parent / "r.h5", tmp_path / "p.h5", limits=limits, validation=2, test=1, quiet=True)
    with pytest.raises(ValueError, match="two surfaces or more .*`--test 2` or more of examples/prepare_data.py"):
        _report(evaluable_pipe(dale=False), tmp_path / "p.h5", tmp_path)


def test_surfaces_that_training_has_too_are_refused(evaluable_pipe, prepared, tmp_path, monkeypatch):
    where = "report.held_out.PreparedDataset"
    monkeypatch.setattr(where, lambda data, split: PreparedDataset(data, "train"))
    with pytest.raises(ValueError, match="has 14 surfaces of the split 'train' in training too, first '"):
        make_context(evaluable_pipe(), prepared, "test", TINY, 0, tmp_path)


@pytest.mark.usefixtures("blank_pictures")
def test_a_seed_gives_the_same_report_and_order_changes_nothing(evaluable_pipe, prepared, tmp_path):
    def plain(report):
        timed = {"seconds_per_segment", "efficiency_score"}
        return {
            path: leaf["mean"] for path, leaf in leaves(report) if leaf["mean"] is not None and not timed & set(path)
        }

    (tmp_path / "a").mkdir(), (tmp_path / "b").mkdir()
    names, settings = ["reconstruction", "paper"], replace(TINY, steps=(1,))
    first, second = (
        plain(_report(evaluable_pipe(), prepared, tmp_path / f, order, settings=settings))
        for f, order in (("a", names), ("b", names[::-1]))
    )
    assert first == pytest.approx(second, rel=1e-9)


def test_fewest_steps_are_those_within_5_percent_of_the_best():
    sweep = {count: {"nine_band_db": {"mean": mean}} for count, mean in (("1", 2.0), ("5", 1.04), ("25", 1.0))}
    assert fewest_steps(sweep) == 5
    assert fewest_steps({"1": {"nine_band_db": {"mean": None}}}) is None


def test_power_is_compared_in_percent_of_the_mean_power():
    """Powers 1, 1, 4 and 4 made into 2, 0, 4 and 4: nothing on average, 2 of 10 apart."""
    wave = np.sqrt(2) * np.sin(np.arange(1000) * 2 * np.pi / 50)
    real = np.sqrt([[1.0], [1.0], [4.0], [4.0]]) * wave
    made = np.sqrt([[2.0], [0.0], [4.0], [4.0]]) * wave
    found = power_percent(made, real, np.array([0, 1, 2, 3]))
    assert found["power_bias_percent"]["mean"] == pytest.approx(0, abs=1e-9)
    assert found["power_difference_percent"]["mean"] == pytest.approx(100 * 2 / 10)
    assert power_percent(np.sqrt(1.5) * real, real, np.arange(4))["power_bias_percent"]["mean"] == pytest.approx(50)


@pytest.mark.usefixtures("blank_pictures")
def test_pipeline_without_dale_reports_reconstruction_only(evaluable_pipe, prepared, tmp_path):
    names = [name for name in SECTIONS if name != "speed"]
    report = _report(evaluable_pipe(dale=False), prepared, tmp_path, names, settings=replace(TINY, steps=(1,)))
    assert report["reconstruction"] and report["generation"] is None and report["control"] is None
    assert "Reconstruction" in report_markdown(report)


@pytest.mark.parametrize("what", ["band", "rate", "length"])
def test_checkpoint_and_data_must_fit(evaluable_pipe, pipe, make_extractor, prepared, tmp_path, what):
    other = evaluable_pipe(dale=False)
    narrow = make_extractor(band=(30.0, 900.0), preemphasis_frequencies=None, preemphasis_db=None)
    other.register_modules(feature_extractor=make_extractor(delivery_rate=5000) if what == "rate" else narrow)
    message = {
        "band": "band is .30.0, 900.0. Hz",
        "rate": "sampling rate of 10000 Hz",
        "length": "segments of 0.2048 s",
    }[what]
    with pytest.raises(ValueError, match=message):
        make_context(pipe if what == "length" else other, prepared, "test", TINY, 0, tmp_path)


def test_halves_of_the_held_out_segments_share_no_sample(evaluable_pipe, prepared, tmp_path):
    context = make_context(evaluable_pipe(), prepared, "test", TINY, 0, tmp_path)
    first, second = context.data.rows, context.data.other_rows
    held_out = PreparedDataset(prepared, "test")
    assert (held_out.surface_ids[first] == held_out.surface_ids[second]).all()
    starts, recordings, length = held_out.starts, held_out.recording_ids, held_out.segment_samples
    pairs = [(a, b) for a in first for b in second if recordings[a] == recordings[b]]
    assert not any(abs(starts[a] - starts[b]) < length for a, b in pairs)
    assert len({*first, *second}) == 2 * len(first)
    rows = matching_rows(context)
    assert sorted(context.requests[1][rows]) == sorted(context.data.surfaces)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["--data", "nowhere.h5"], "not a file"),
        (["--split", "train"], "invalid choice"),
        (["--steps", "0"], "at least 1"),
    ],
)
def test_command_refuses_bad_arguments(prepared, tmp_path, capsys, changes, message):
    with pytest.raises(SystemExit) as caught:
        evaluate.parse_arguments(["--data", str(prepared), "--output", str(tmp_path), *changes])
    assert caught.value.code == 2 and message in capsys.readouterr().err


def test_table_has_every_column_and_a_dash_for_what_is_missing():
    rows = {"a": {"x": 1.0}, "b": {"x": float("nan"), "y": 2}}
    assert markdown_table(rows).splitlines() == ["| | x | y |", "|---|---|---|", "| a | 1.00 | – |", "| b | – | 2 |"]
    shown = markdown_table(rows, labels={"y": ("why", 0)})
    assert shown.splitlines()[0] == "| | why |" and shown.splitlines()[-1] == "| b | 2 |"
    assert text(0.0012345) == "0.00123" and text(None) == "–"


def test_a_report_inside_of_the_checkpoint_makes_it_no_other(evaluable_pipe, tmp_path):
    """It was: what was done was done again, and `publish.py` refused the report."""
    evaluable_pipe().save_pretrained(str(tmp_path))
    before = folder_digest(tmp_path)
    for name in ("report.json", "report/report.json", "report/sections/speed.json", "checkpoint-500/lctg/config.json"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("{}")
    assert folder_digest(tmp_path) == before
    (tmp_path / "lctg" / "config.json").write_text("{}")
    assert folder_digest(tmp_path) != before
