"""`examples/compare.py`: reports side by side, and refusals."""

import copy
import json

import compare
import pytest
from report.changes import QUANTITIES

from tactile_diffusers.evaluation.metrics.statistics import number
from tactile_diffusers.signal import RATING_AXES


def _report(response=1.0):
    """The least that is compared: changes of `response` times the real ones."""
    entry = {"shape_difference_db": number(2.0 * abs(1 - response))}
    shift = {value: number(30.0 * response) for value in ("-2.0", "2.0")}
    for name in QUANTITIES:
        entry |= {name: number(2.0 * response), f"{name}_truth": number(2.0, 50)}
    axes = {axis: {value: entry for value in ("-2.0", "2.0")} for axis in RATING_AXES}
    matrix = [[number(0.7 * response * (row == column)) for column in range(3)] for row in range(3)]
    spectra = {value: {"20-40 Hz": number(-50.0), "40-80 Hz": number(-60.0)} for value in ("-2.0", "2.0")}
    return {
        "data": {"name": "p.h5", "split": "test", "surfaces": 9, "segments": 36, "training_surfaces": 70},
        "machine": {"processor": "cpu", "threads": 1},
        "pipeline": {"guidance_scale": 1.0},
        "control": {
            "truth": {"fewest_surfaces": number(20)},
            "response_real": [[number(0.7 * (row == column)) for column in range(3)] for row in range(3)],
            "1.0": {"axes": axes, "response": matrix},
        },
        "generation": {"1.0": {"ktd_excess": number(6.0), "ftd_excess": number(3.0)}},
        "unseen_surfaces": {"nine_band_db": {"model": number(2.3), "ridge": number(2.2)}},
        "paper": {
            "spectra_db": dict.fromkeys(RATING_AXES, spectra),
            "latent_shift_percent": dict.fromkeys(RATING_AXES, shift),
        },
    }


@pytest.fixture
def folder(tmp_path):
    """`folder(name, **report)` writes a report and returns its folder."""

    def write(name, **changes):
        (tmp_path / name).mkdir()
        (tmp_path / name / "report.json").write_text(json.dumps(copy.deepcopy(_report()) | changes))
        return tmp_path / name

    return write


def test_obedient_and_deaf_checkpoints_are_told_apart(folder, tmp_path, capsys):
    deaf = _report(0.1)
    few = _report()["data"] | {"training_surfaces": 10}
    ours, other = folder("ours"), folder("other", control=deaf["control"], paper=deaf["paper"], data=few)
    words = f"--report ours={ours} other={other} --output {tmp_path / 'out'}"
    assert compare.main(words.split()) == 0
    printed = capsys.readouterr().out
    lines = {line.split("|")[1].strip(): line for line in printed.splitlines() if line.startswith("| o")}
    assert "18 of 18" in lines["ours"] and " 0 of 18 " in lines["other"]
    assert "| 0.00 |" in lines["ours"] and "| 0.63 |" in lines["other"]  # 0.7 - 0.07
    assert "30–30" in lines["ours"] and "3–3" in lines["other"]
    assert (tmp_path / "out/axes.png").read_bytes()[:4] == b"\x89PNG"


def test_reports_that_cannot_be_compared_are_refused(folder, tmp_path, capsys):
    other = _report()["data"] | {"segments": 12}
    ours, elsewhere, empty = folder("ours"), folder("elsewhere", data=other), folder("empty", control=None)
    newer = folder("newer", data=_report()["data"] | {"embedding_version": 2})
    for folders, message in (
        ((ours, elsewhere), "different held-out surfaces"),
        ((ours, newer), "of different embeddings, versions {1, 2}"),
        ((empty,), "no sections control"),
    ):
        named = " ".join(f"n{i}={path}" for i, path in enumerate(folders))
        assert compare.main(f"--report {named} --output {tmp_path / 'out'}".split()) == 2
        assert message in capsys.readouterr().err


@pytest.mark.parametrize("report", ["nothing", "ours=missing", "=there"])
def test_bad_reports_are_named(report, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        compare.parse_arguments(["--report", report, "--output", str(tmp_path)])
    assert stop.value.code == 2 and "--report" in capsys.readouterr().err
