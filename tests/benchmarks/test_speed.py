"""The benchmarks of speed, on a tiny pipeline: every figure is there; how large a time is, no test tells."""

import json
import math
import time

import peer_models
import peers
import pytest
import speed
import speed_error
import torch
from benchmarking import finish, make_parser, parse, seconds_of, timed_columns, timed_table
from report.result_files import stamp

from tactile_diffusers import TactileTexturePipeline
from tactile_diffusers.pipelines.folders import folder_digest


@pytest.fixture
def checkpoint(make_pipeline, tmp_path):
    pipe = make_pipeline(dale_config={"latent_frames": 128, "widths": [64, 96]}, lctg_config={"segment_samples": 2048})
    pipe.save_pretrained(str(tmp_path / "pipeline"))
    return tmp_path / "pipeline"


def _finite(values):
    return all(math.isfinite(value) and value > 0 for value in values)


def test_speed_reports_every_part(checkpoint, tmp_path, monkeypatch):
    monkeypatch.setattr(speed, "run_child", lambda *_: ("", 1.0))  # spawns processes
    monkeypatch.setattr(speed, "DURATIONS", (1.0, 2.0))
    monkeypatch.setattr(speed, "BATCHES", (1, 2))
    assert speed.main(["--checkpoint", str(checkpoint), "--output", str(tmp_path / "b"), "--repeats", "1"]) == 0
    report = json.loads((tmp_path / "b" / "speed.json").read_text())
    assert set(report["Batch, default steps"]) == {"batch 1", "batch 2"} and len(report["Duration"]) == 2
    assert all(row["whole s"] > 0 for row in report["One segment"].values())


@pytest.mark.slow
def test_the_comparison_is_complete(checkpoint, tmp_path, capsys, make_lctg, monkeypatch):
    """A package that is missing is named with the command that installs it; all else is measured."""

    def missing():
        raise ModuleNotFoundError("No module named 'audio_diffusion_pytorch'")

    monkeypatch.setattr(peer_models, "_import_audio_diffusion", missing)
    monkeypatch.setattr(peer_models, "_UNET_CHANNELS", (64, 64, 64, 32))
    monkeypatch.setattr(peer_models, "_UNET_ATTENTIONS", 1)
    monkeypatch.setattr(peer_models, "SEGMENT_SAMPLES", 512)
    pipe = TactileTexturePipeline.from_pretrained(checkpoint)
    pipe.register_modules(lctg_distilled=make_lctg(seed=3, segment_samples=2048, distilled_steps=1))
    pipe.save_pretrained(checkpoint)
    words = f"--checkpoint {checkpoint} --output {tmp_path} --repeats 1 --anchor {checkpoint} --batches 2 1 --quiet"
    assert peers.main(words.split()) == 0
    report = json.loads((tmp_path / "peers.json").read_text())
    assert "not installed" in report["notes"][0] and peer_models.INSTALL in report["notes"][0]
    models, batches = report["models"], report["batches"]
    rows = {peers.OURS, peers.ANCHOR, peers.DEFAULT}
    rows |= {"UNet1DModel, 18 M", "UNet1DModel, at our size"}
    assert set(models) == rows == set(batches["Batch 1"]) == set(batches["Batch 2"])
    sizes = [models[name]["parameters, M"] for name in (peers.OURS, "UNet1DModel, at our size")]
    assert abs(sizes[1] / sizes[0] - 1) <= peer_models.SIZE_TOLERANCE
    # a tenth of LCTG's steps and half of DALE's
    work = {name: row["multiply-adds of a segment, G"] for name, row in models.items()}
    assert work[peers.DEFAULT] < work[peers.OURS] / 2
    assert all(
        _finite(value for key, value in row.items() if key != "spread, %")
        for table in batches.values()
        for row in table.values()
    )
    assert "Beside other models" in capsys.readouterr().out


def test_a_table_names_rows_whose_seconds_vary_too_much():
    rows = {"steady": timed_columns([1.0, 1.0, 1.1]), "loose": timed_columns([1.0, 2.0, 3.0])}
    assert rows["loose"] == {"s": 2.0, "spread, %": 25.0}  # quartiles 1.5 and 2.5
    assert timed_table(rows).endswith("The spread exceeds 20 %: loose.")
    assert "exceeds" not in timed_table({"steady": rows["steady"]})


def test_steps_in_time_are_none_where_more_steps_were_faster():
    step, steps = speed.steps_in_time({5: 0.08, 25: 0.28}, 1.0)  # 0.03 s beside steps of 0.01 s
    assert step == pytest.approx(0.01) and steps == 97
    assert speed.steps_in_time({5: 0.3, 25: 0.2}, 1.0)[1] is None


def test_timings_are_taken_in_turn_and_long_runs_once():
    called = []
    runs = {name: lambda n=name: called.append(n) for name in "ab"}
    assert _finite(seconds_of(runs, 2).values()) and "".join(called) == "ababab"
    called.clear()
    assert set(seconds_of(runs, 2, long_run=0.0)) == {"a", "b"} and "".join(called) == "ab"


def test_multiply_adds_of_known_layers():
    conv, linear = torch.nn.Conv1d(3, 5, 3, padding=1, bias=False), torch.nn.Linear(7, 2, bias=False)
    assert peers.multiply_adds(lambda n: conv(torch.zeros(2, 3, 10))) == 2 * 10 * 5 * 3 * 3
    assert peers.multiply_adds(lambda n: linear(torch.zeros(4, 7))) == 4 * 7 * 2
    query, keys = torch.zeros(1, 2, 6, 4), torch.zeros(1, 2, 3, 4)  # batch, heads, positions, width
    attend = torch.nn.functional.scaled_dot_product_attention
    assert peers.multiply_adds(lambda n: attend(query, keys, keys)) == 2 * (2 * 6 * 3 * 4)


@pytest.mark.parametrize("parameters", [300_000, 3_000_000])
def test_a_network_cut_to_a_size(parameters):
    cut = peer_models.unet_1d(parameters)
    assert abs(peer_models.size(cut.module) / parameters - 1) <= peer_models.SIZE_TOLERANCE


def test_what_would_take_too_long_is_left_out(monkeypatch):
    monkeypatch.setattr(peers, "LONGEST_RUN", 0.5)
    rows = {"slow": ([], lambda number: time.sleep(0.06)), peers.DEFAULT: ([], lambda number: None)}
    found = peers.times(rows, [1, 2, 64, 128], 1, dict.fromkeys(rows, 1.0), 1.0)
    # 0.03 s for each of two: 1.9 s for 64, though batches take no longer here
    assert [set(table) for table in found.values()] == [set(rows)] * 2 + [{peers.DEFAULT}] * 2


def _row(seconds, ktd, told):
    return {"s": seconds, speed_error.KTD: {"mean": ktd}, speed_error.TOLD: {"mean": told}}


def test_speed_at_the_best_quality_of_another_model():
    theirs = {f"{peers.ANCHOR}, 1 step": _row(0.1, 90.0, 0.7), f"{peers.ANCHOR}, 5 steps": _row(0.5, 30.0, 0.8)}
    fast, slow, told = _row(0.01, 40.0, 0.6), _row(0.1, 30.0, 0.6), _row(0.01, 10.0, 0.9)
    text = speed_error.summary(theirs | {"ours, default": fast, "ours, 9 steps": slow})
    assert "5 steps; ours, 9 steps, is as good or better in both and 5 times" in text
    assert "no row of ours" in speed_error.summary(theirs | {"ours, default": fast, "ours, 2 steps": told})


def test_results_say_under_which_conditions(checkpoint, tmp_path):
    arguments = parse(make_parser("x.py", "."), ["--checkpoint", str(checkpoint), "--output", str(tmp_path)])
    finish(arguments, "x", {"rows": {}}, "text\n")
    found = json.loads((tmp_path / "x.json").read_text())["conditions"]
    assert found["checkpoint"]["sha256"] == folder_digest(checkpoint) and found["date"]
    assert found["checkpoint"]["sha256"][:12] in (tmp_path / "x.md").read_text()
    assert "other work ran beside it" in stamp(found | {"load_before": 2.0})
    assert "other work" not in stamp(found | {"load_before": 0.1})
