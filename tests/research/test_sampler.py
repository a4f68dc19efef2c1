"""The study of samplers, on a tiny pipeline."""

import json

import pytest
import sampler
import solver_study


@pytest.mark.slow
def test_solvers_are_compared(checkpoint, prepared, tmp_path, monkeypatch):
    """A small version of the whole comparison, trained models included."""
    whole = solver_study.mixture_errors
    monkeypatch.setattr(solver_study, "mixture_errors", lambda: whole(steps=(4, 10, 20, 160)))
    monkeypatch.setattr(solver_study, "REFERENCE_STEPS", 20)
    monkeypatch.setattr(solver_study, "STEPS", (3, 4, 10))
    monkeypatch.setattr(solver_study.trained_errors, "__defaults__", (None, None, None, (3, 4, 10), True))
    out = tmp_path / "b"
    arguments = f"--checkpoint {checkpoint} --data {prepared} --output {out} --segments 3 --quiet"
    assert sampler.main(arguments.split()) == 0
    report = json.loads((out / "scheduler.json").read_text())
    assert set(report["trained"]) == {"lctg", "dale", "real_ktd", "rules"}
    assert report["trained"]["lctg"]["order 2, both_ends"]["4"]["nine_band_db"]["mean"] > 0
    assert report["analytic"]["orders"]["rotation_2"]["uniform"] > 1.8
    assert "Trained LCTG" in (out / "scheduler.md").read_text() and (out / "scheduler.png").stat().st_size > 20_000
