"""`examples/evaluate.py` on a tiny pipeline."""

import json

import evaluate
import pytest


def test_evaluate_writes_report_and_pictures(checkpoint, prepared, tmp_path, capsys):
    """Two training surfaces too few for a judge, too few textures for a covariance: empty numbers, not a crash."""
    out = tmp_path / "report"
    arguments = f"--checkpoint {checkpoint} --data {prepared} --output {out} --steps 1 2 --quick --quiet".split()
    assert evaluate.main(arguments + ["--sections", "reconstruction"]) == 0
    report = json.loads((out / "report.json").read_text())
    assert list(report["reconstruction"]["steps"]) == ["1", "2"] and report["generation"] is None
    # random weights know nothing of the surfaces: far from real textures in every respect
    assert report["reconstruction"]["steps"]["1"]["nine_band_db"]["mean"] > 3
    assert report["reconstruction"]["steps"]["1"]["ftd"]["mean"] is None
    assert (out / "overlays.png").stat().st_size > 5000
    assert (out / "report.md").read_text() in capsys.readouterr().out + "\n"


@pytest.mark.parametrize(
    "extra",
    [
        *("--steps 0", "--per-surface 0"),
        *("--data nowhere.h5", "--checkpoint nowhere"),
    ],
)
def test_evaluate_refuses_before_any_work(extra, prepared, tmp_path):
    with pytest.raises(SystemExit) as stop:
        evaluate.main(f"--data {prepared} --output {tmp_path / 'report'} {extra}".split())
    assert stop.value.code == 2 and not (tmp_path / "report").exists()
