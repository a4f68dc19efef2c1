"""The commands evaluate and benchmark, on a tiny pipeline."""

import json

import benchmark
import pytest
import solver_study
import speed as benchmark_speed

from tactile_diffusers import LCTGModel, VDDIMScheduler
from tactile_diffusers.cli import evaluate


def test_evaluate_writes_report_and_pictures(checkpoint, prepared, tmp_path, capsys):
    """Two training surfaces too few for a judge, too few textures for a covariance: empty numbers, not a crash."""
    out = tmp_path / "report"
    arguments = f"--checkpoint {checkpoint} --data {prepared} --output {out} --steps 1 2 --quick --quiet".split()
    arguments += ["--anchor", str(checkpoint)]
    assert evaluate.main(arguments + ["--sections", "reconstruction"]) == 0
    report = json.loads((out / "report.json").read_text())
    assert list(report["reconstruction"]["steps"]) == ["1", "2"] and report["generation"] is None
    # random weights know nothing of the surfaces: far from real textures in every respect
    assert report["reconstruction"]["steps"]["1"]["nine_band_db"]["mean"] > 3
    assert report["reconstruction"]["steps"]["1"]["ftd"]["mean"] is None
    assert (out / "steps.png").stat().st_size > 5000
    assert (out / "report.md").read_text() in capsys.readouterr().out + "\n"
    assert list(report["anchors"]) == ["pipeline"] and list(report["anchors"]["pipeline"]["steps"]) == ["5", "10", "25"]


@pytest.mark.parametrize(
    "extra",
    [
        *("--steps 0", "--per-surface 0", "--baseline-surfaces 1"),
        *("--data nowhere.h5", "--checkpoint nowhere"),
    ],
)
def test_evaluate_refuses_before_any_work(extra, prepared, tmp_path):
    with pytest.raises(SystemExit) as stop:
        evaluate.main(f"--data {prepared} --output {tmp_path / 'report'} {extra}".split())
    assert stop.value.code == 2 and not (tmp_path / "report").exists()


@pytest.mark.parametrize(
    ("extra", "message"),
    [("--embedding nowhere:f", "'nowhere' cannot be imported"), ("--seed 1 --embedding json:dumps2", "has no")],
)
def test_evaluate_says_what_does_not_fit(checkpoint, prepared, tmp_path, capsys, extra, message):
    arguments = f"--checkpoint {checkpoint} --data {prepared} --output {tmp_path / 'r'} --quick --quiet {extra}"
    assert evaluate.main([*arguments.split(), "--sections", "reconstruction"]) == 2
    assert message in capsys.readouterr().err


def test_benchmark_reports_every_part(checkpoint, tmp_path, monkeypatch):
    monkeypatch.setattr(benchmark_speed, "peak_memory", lambda *_: 1.0)  # spawns processes
    monkeypatch.setattr(benchmark_speed, "DURATIONS", (1.0, 2.0))
    assert benchmark.main(["--checkpoint", str(checkpoint), "--output", str(tmp_path / "b"), "--repeats", "1"]) == 0
    report = json.loads((tmp_path / "b" / "benchmark.json").read_text())
    assert set(report["batch"]) == {f"batch {n}" for n in (1, 2, 4, 8, 16, 64)} and len(report["duration"]) == 2
    assert all(row["whole s"] > 0 for row in report["steps"].values())


@pytest.mark.slow
def test_benchmark_compares_solvers(checkpoint, prepared, tmp_path, monkeypatch):
    """A small version of the whole comparison, trained models included."""
    whole = solver_study.mixture_errors
    monkeypatch.setattr(solver_study, "mixture_errors", lambda: whole(steps=(4, 10, 20, 160)))
    monkeypatch.setattr(solver_study, "REFERENCE_STEPS", 20)
    monkeypatch.setattr(solver_study, "STEPS", (3, 4, 10))
    monkeypatch.setattr(solver_study.trained_errors, "__defaults__", (None, None, None, (3, 4, 10), True))
    out = tmp_path / "b"
    arguments = f"--checkpoint {checkpoint} --data {prepared} --output {out} --suite scheduler --segments 3 --quiet"
    assert benchmark.main(arguments.split()) == 0
    report = json.loads((out / "scheduler.json").read_text())
    assert set(report["trained"]) == {"lctg", "dale", "real_ktd", "rules"}
    assert report["trained"]["lctg"]["order 2, both_ends"]["4"]["nine_band_db"]["mean"] > 0
    assert report["analytic"]["orders"]["rotation_2"]["uniform"] > 1.8
    assert "Trained LCTG" in (out / "scheduler.md").read_text() and (out / "scheduler.png").stat().st_size > 20_000


def test_decoder_suite_measures_every_number_of_steps(checkpoint, prepared, tmp_path, capsys):
    own = LCTGModel.from_pretrained(checkpoint, subfolder="lctg")
    own.register_to_config(distilled_steps=2)
    own.save_pretrained(tmp_path / "run" / "lctg_distilled")
    VDDIMScheduler().save_pretrained(tmp_path / "run" / "scheduler")
    words = f"--suite decoder --checkpoint {checkpoint} --data {prepared} --quiet --output {tmp_path / 'out'}".split()
    assert benchmark.main([*words, "--decoders", f"two={tmp_path / 'run'}"]) == 0
    rows = json.loads((tmp_path / "out" / "decoder.json").read_text())["rows"]
    assert [name for name in rows if name.startswith("two")] == ["two, 1 step", "two, 2 steps"]
    errors = {name: row["reconstructed: nine-band error, dB"] for name, row in rows.items()}
    # the same weights, and the first order of the checkpoint's own sampler
    assert errors["two, 2 steps"] == pytest.approx(errors["as trained, 2 steps"], rel=1e-4)
    assert errors["as trained, 1 step"] != pytest.approx(errors["as trained, 2 steps"], rel=1e-4)
    assert all(row["generated: KTD"] == row["generated: KTD"] for row in rows.values())
    with pytest.raises(SystemExit):
        benchmark.main([*words, "--decoders", "two"])
    assert "--decoders: must be NAME=FOLDER" in capsys.readouterr().err
