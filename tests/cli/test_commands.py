"""The commands evaluate, benchmark and publish, on a tiny pipeline."""

import copy
import json

import pytest
import torch
from safetensors.torch import load_file

from tactile_diffusers import LCTGModel, TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.cli import benchmark, benchmark_speed, evaluate, publish
from tactile_diffusers.cli.readme import markers
from tactile_diffusers.data import SegmentLimits, generate_recordings, prepare_recordings
from tactile_diffusers.evaluation import solver_study


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("commands")
    generate_recordings(folder / "r.h5", surfaces=8, seconds=15, explorers=2, seed=4, quiet=True)
    limits = SegmentLimits(seconds=2048 / 2500)  # those of `evaluable_pipe`
    prepare_recordings(folder / "r.h5", folder / "p.h5", limits=limits, validation=3, test=2, quiet=True)
    return folder / "p.h5"


@pytest.fixture
def checkpoint(evaluable_pipe, tmp_path):
    evaluable_pipe().save_pretrained(str(tmp_path / "pipeline"))
    return tmp_path / "pipeline"


def test_evaluate_writes_report_and_pictures(checkpoint, prepared, tmp_path, capsys):
    """Two training surfaces too few for a judge, too few textures for a covariance: empty numbers, not a crash."""
    out, readme = tmp_path / "report", tmp_path / "README.md"
    readme.write_text("\n".join(markers("results")))
    arguments = f"--checkpoint {checkpoint} --data {prepared} --output {out} --steps 1 2 --quick --quiet".split()
    arguments += ["--anchor", str(checkpoint)]
    assert evaluate.main(arguments + ["--sections", "reconstruction", "--readme", str(readme)]) == 0
    report = json.loads((out / "report.json").read_text())
    assert list(report["reconstruction"]["steps"]) == ["1", "2"] and report["generation"] is None
    # random weights know nothing of the surfaces: far from real textures in every respect
    assert report["reconstruction"]["steps"]["1"]["nine_band_db"]["mean"] > 3
    assert report["reconstruction"]["steps"]["1"]["ftd"]["mean"] is None
    assert (out / "steps.png").stat().st_size > 5000
    assert (out / "report.md").read_text() in capsys.readouterr().out + "\n"
    assert "another take" in readme.read_text() and "Beside the paper's configuration" in readme.read_text()
    assert list(report["anchors"]) == ["pipeline"] and list(report["anchors"]["pipeline"]["steps"]) == ["5", "10", "25"]


@pytest.mark.parametrize(
    "extra",
    [
        *("--steps 0", "--per-surface 0", "--baseline-surfaces 1"),
        *("--data nowhere.h5", "--readme nowhere.md", "--checkpoint nowhere"),
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


def test_benchmark_compares_solvers(checkpoint, prepared, tmp_path, monkeypatch):
    """A small version of the whole comparison, trained models included."""
    whole = solver_study.mixture_errors
    monkeypatch.setattr(solver_study, "mixture_errors", lambda: whole(steps=(4, 10, 20, 160)))
    monkeypatch.setattr(solver_study, "REFERENCE_STEPS", 20)
    monkeypatch.setattr(solver_study, "STEPS", (3, 4, 10))
    monkeypatch.setattr(solver_study.trained_errors, "__defaults__", (None, None, None, (3, 4, 10), True))
    out, readme = tmp_path / "b", tmp_path / "README.md"
    readme.write_text("\n".join(markers("scheduler")))
    arguments = f"--checkpoint {checkpoint} --data {prepared} --output {out} --suite scheduler --segments 3 --quiet"
    assert benchmark.main([*arguments.split(), "--readme", str(readme)]) == 0
    report = json.loads((out / "scheduler.json").read_text())
    assert set(report["trained"]) == {"lctg", "dale", "real_ktd", "rules"}
    assert report["trained"]["lctg"]["order 2, both_ends"]["4"]["nine_band_db"]["mean"] > 0
    assert report["analytic"]["orders"]["rotation_2"]["uniform"] > 1.8
    assert "Trained LCTG" in (out / "scheduler.md").read_text() and (out / "scheduler.png").stat().st_size > 20_000
    assert "order 2, both_ends, 10" in readme.read_text()


def test_publish_halves_the_weights_and_keeps_the_texture(checkpoint, prepared, tmp_path):
    run = tmp_path / "run"
    run.mkdir()
    record = {
        "script": "examples/train_dale.py",
        "arguments": {"seed": 3, "train_data_dir": "/somewhere/prepared.h5", "quiet": True},
        "segments": 7,
        "steps": 9,
        "machine": "a test",
        "versions": {"torch": "2", "diffusers": "0"},
    }
    (run / "training.json").write_text(json.dumps(record))
    entries = [{"step": 9, "train/loss": 0.5, "seconds": 60.0}, {"step": 9, "validation/velocity": 0.25}]
    (run / "log.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    (run / "loss.png").write_bytes(b"png")
    out = tmp_path / "small"
    out.mkdir()
    (out / "old").write_text("replaced as a whole")
    assert publish.main(f"--checkpoint {checkpoint} --runs {run} --data {prepared} --output {out}".split()) == 0
    card = (out / "README.md").read_text()
    assert "Normal force 0.4-0.6 N" in card
    assert "--seed 3 --train_data_dir prepared.h5" in card and "1 minutes" in card and "velocity 0.250" in card
    assert not (out / "old").exists() and (out / "loss_run.png").exists()
    full = TactileTexturePipeline.from_pretrained(str(checkpoint))
    small = TactileTexturePipeline.from_pretrained(str(out))
    for pipe in (full, small):
        pipe.set_progress_bar_config(disable=True)
    assert small.lctg.dtype == small.dale.dtype == torch.float32
    make = dict(ratings=[[1.0, 0.0, -1.0]], num_inference_steps=2)
    first, second = (p(generator=torch.Generator().manual_seed(0), **make).textures for p in (full, small))
    # half precision keeps 11 bits: weights move by 5e-4 at most, textures by a few times that
    assert abs(first - second).max() < 0.02 * abs(first).max()


def test_publish_refuses_another_encoder(checkpoint, make_pipeline, prepared, tmp_path):
    run = tmp_path / "run"
    run.mkdir()
    (run / "training.json").write_text("{}")
    make_pipeline(seed=5).save_pretrained(str(tmp_path / "other"))
    arguments = f"--checkpoint {checkpoint} --runs {run} --data {prepared} --output {tmp_path / 'small'}".split()
    with pytest.raises(ValueError, match="another encoder"):
        publish.main([*arguments, "--lctg", str(tmp_path / "other")])
    assert not (tmp_path / "small").exists()


def test_publish_refuses_a_decoder_that_does_not_fit(checkpoint, make_lctg, prepared, tmp_path):
    """The same encoder, but a detail layer that the feature extractor does not make."""
    run = tmp_path / "run"
    run.mkdir()
    (run / "training.json").write_text("{}")
    arguments = f"--checkpoint {checkpoint} --runs {run} --data {prepared} --output {tmp_path / 'small'}".split()
    own = LCTGModel.from_pretrained(checkpoint, subfolder="lctg")
    detailed = make_lctg(**{**own.config, "feature_channels": 26, "latent_channels": 6, "detail_channels": 2})
    detailed.encoder.load_state_dict(own.encoder.state_dict())
    detailed.save_pretrained(tmp_path / "detailed" / "lctg")
    with pytest.raises(ValueError, match="`lctg` hears 26 feature channels, `feature_extractor` makes 24"):
        publish.main([*arguments, "--lctg", str(tmp_path / "detailed")])
    assert not (tmp_path / "small").exists()
    # a decoder of the same latents is taken
    other = make_lctg(seed=7, **{k: v for k, v in own.config.items() if not k.startswith("_")})
    other.encoder.load_state_dict(own.encoder.state_dict())
    other.save_pretrained(tmp_path / "other" / "lctg")
    pipe = TactileTexturePipeline.from_pretrained(str(checkpoint))
    publish._replace_lctg(pipe, tmp_path / "other")
    assert torch.equal(pipe.lctg.decoder.conv_in.weight, other.decoder.conv_in.weight)


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


def test_publish_takes_a_distilled_decoder_along(checkpoint, make_lctg, prepared, tmp_path):
    pipe, run, out = TactileTexturePipeline.from_pretrained(checkpoint), tmp_path / "run", tmp_path / "small"
    run.mkdir()
    record = {"script": "distill_lctg.py", "arguments": {}, "segments": 3, "steps": 2, "machine": "none"}
    (run / "training.json").write_text(json.dumps(record | {"versions": {"torch": "2", "diffusers": "0"}}))
    (run / "log.jsonl").write_text(json.dumps({"step": 2, "train/loss": 1.0, "seconds": 3.0}) + "\n")
    (run / "loss.png").write_bytes(b"")
    distilled = copy.deepcopy(pipe.lctg)
    distilled.register_to_config(distilled_steps=2)
    distilled.save_pretrained(run / "lctg_distilled")
    words = f"--checkpoint {checkpoint} --runs {run} --distilled {run} --data {prepared} --output {out}".split()
    assert publish.main(words) == 0
    lctg = LCTGModel.from_pretrained(out, subfolder="lctg_distilled")
    assert TactileTexturePipeline.from_pretrained(out, lctg=lctg).resolve_steps() == (2, 5)
    assert load_file(out / "lctg_distilled" / "diffusion_pytorch_model.safetensors").popitem()[1].dtype == torch.float16
    assert 'subfolder="lctg_distilled"' in (out / "README.md").read_text()
    make_lctg(seed=9).save_pretrained(run / "lctg_distilled")
    with pytest.raises(ValueError, match="--distilled .* has another encoder"):
        publish.main(words)
