"""The ablation runner: rows, what is kept and what is done again, and what is measured of a tiny pipeline."""

import json
import os
from pathlib import Path

import ablate
import ablate_measure
import ablate_training
import numpy as np
import pytest
import torch
from ablate_results import averaged
from ablate_rows import read_rows
from ablate_training import DIGEST
from report.sampling import encode
from report.sections import Settings

from tactile_diffusers import TactileTexturePipeline, VDDIMScheduler
from tactile_diffusers.io.locks import fcntl

SCRIPTS = Path(__file__).parents[2] / "examples"
BASE = {
    "question": "the plain model",
    "model": {"lctg": {"latent_channels": 4, "latent_noise": 0.1}},
    "arguments": {"learning_rate": 1e-3, "train_batch_size": 4},
    "train": [{"subset": "full", "max_train_steps": 4}, {"subset": "filtered", "max_train_steps": 2}],
}
NOISE = {
    "question": "more noise on the latents",
    "extends": "base",
    "model": {"lctg": {"latent_noise": 0.3}},
    "arguments": {"use_ema": False, "learning_rate": None},
    "dale": {"max_train_steps": 3},
}
POINT = {"nine_band_db": 1.0, "snr_db": -1.0, "ktd_excess": 3.0}
MEASURED = {
    "parameters": 2_000_000,
    "steps": {n: {**POINT, "ftd_excess": 1.0, "power_difference_percent": 2.0, "signed_db": {}, "seconds": 0.1}
              for n in ("5", "10")},
    "rate_kbit_s": 1.5,
    "rate_distortion": [
        {**POINT, "sigma": sigma, "base_only": base_only, "rate_kbit_s": 1 / sigma, "decimated": POINT}
        for sigma, base_only in ((0.1, False), (0.4, False), (0.1, True))
    ],
}  # fmt: skip


def write_rows(folder, **rows):
    folder.mkdir(exist_ok=True)
    for name, row in rows.items():
        (folder / f"{name}.json").write_text(json.dumps(row))
    return folder


def test_a_row_is_its_file_over_those_it_extends(tmp_path):
    base, noise, again = read_rows(
        write_rows(tmp_path / "rows", noise=NOISE, base=BASE, a={"question": "once", "extends": "noise", "train": [
            {"max_train_steps": 9}], "dale": None})
    )  # fmt: skip
    assert base.lineage == ("base",) and base.dale is None and base.model == BASE["model"]
    assert noise.model == {"lctg": {"latent_channels": 4, "latent_noise": 0.3}} and noise.train == BASE["train"]
    assert noise.arguments == {"learning_rate": None, "train_batch_size": 4, "use_ema": False}
    assert noise.dale == {"max_train_steps": 3} and noise.question == "more noise on the latents"
    # later than what it extends although its name comes first; phases are replaced as a whole
    assert again.name == "a" and again.train == [{"max_train_steps": 9}] and again.dale is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"trian": []}, "unknown key 'trian'"),
        ({"question": ""}, "'question' must say in one line"),
        ({"extends": "nothing"}, "'nothing', which is no row"),
        ({"extends": ["noise"]}, "'extends' must be the name of a row"),
        ({"extends": "noise"}, "round in a circle: noise < row < noise"),
        ({"model": {"decoder": {}}}, "feature_extractor, lctg, scheduler, dale, dale_scheduler, got 'decoder'"),
        ({"model": {"lctg": {"latents": 3}}}, "section 'lctg' has the unknown key 'latents'"),
        ({"arguments": {"output_dir": "x"}}, "must not set 'output_dir'"),
        ({"arguments": {"seed": [1]}}, "must give 'seed' one value"),
        ({"train": []}, "'train' must be a list of phases"),
        ({"train": [{"subset": "full"}]}, "'train, phase 1' must say how long"),
        ({"dale": {"max_train_steps": 0}}, "'dale' must say how long"),
    ],
)
def test_rows_say_what_is_wrong(tmp_path, change, message):
    other = {"question": "other", "extends": "row", "train": BASE["train"]}
    with pytest.raises(ValueError, match=message) as error:
        read_rows(write_rows(tmp_path / "rows", row=BASE | change, noise=other))
    assert "row.json" in str(error.value) or "noise.json" in str(error.value)


@pytest.fixture
def data(tmp_path):
    """Its content is never read: trainings and measurements of these tests are faked."""
    path = tmp_path / "prepared.h5"
    path.write_bytes(b"data")
    return path


@pytest.fixture
def launched(monkeypatch):
    """Trainings are not run but written down, script and folder; those of folders in `failing` fail."""
    launched = type("Launched", (list,), {"failing": set()})()

    def launch(words, log, threads):
        folder = next(Path(word.split("=", 1)[1]) for word in words if word.startswith("--output_dir="))
        launched.append(f"{Path(words[0]).stem} {folder.parent.name}/{folder.name}")
        launched.words = words
        log.write_text("first line\n" * 50 + "the reason\n")
        if folder.name in launched.failing:
            return 3
        entries = [{"step": s, "train/velocity": 1 / s, "seconds": 0.5 * s} for s in (1, 2, 4)]
        entries.append({"step": 4, "validation/nine_band_db": 1.0})
        (folder / "log.jsonl").write_text("".join(json.dumps(entry) + "\n" for entry in entries))
        (folder / "model_index.json").write_text("{}")
        return 0

    monkeypatch.setattr(ablate_training, "_launch", launch)
    return launched


@pytest.fixture
def run(tmp_path, data, launched, monkeypatch):
    """`run("--only base")` runs the command on two rows; `run.measured` holds the folders that were measured."""
    write_rows(tmp_path / "rows", base=BASE, noise=NOISE)

    def measure(self, folder, generates):
        run.measured.append(f"{folder.parent.name}/{folder.name}")
        return MEASURED | ({"generation": POINT | {"ftd_excess": 1.0}} if generates else {})

    def run(extra=""):
        fixed = f"--data {data} --rows {tmp_path / 'rows'} --output {tmp_path / 'out'} --quiet"
        threads = torch.get_num_threads()
        try:
            return ablate.main(f"{fixed} {extra}".split(), SCRIPTS)
        finally:
            torch.set_num_threads(threads)

    run.measured = []
    monkeypatch.setattr(ablate_measure.Bench, "measure", measure)
    return run


def test_rows_are_trained_measured_and_told_once(run, launched, tmp_path, capsys):
    assert run() == 0
    phases = [f"train_lctg {row}/phase-{n}" for row in ("base", "noise") for n in (1, 2)]
    assert launched == [*phases, "train_dale noise/dale"] and run.measured == ["base/phase-2", "noise/dale"]
    assert json.loads((tmp_path / "out/noise/model.json").read_text())["lctg"]["latent_noise"] == 0.3
    out = tmp_path / "out"
    result = json.loads((out / "noise" / "result.json").read_text())
    assert result["training_seconds"] == 6 and result["step_seconds"] == 0.5 and result["dale_loss"] == 0.25
    for text in (capsys.readouterr().out, (out / "report.md").read_text()):
        assert "the plain model (`base`)" in text and "generated KTD over real" in text and "base layer only" in text
    assert all((out / name).is_file() for name in ("rows.png", "rate_distortion.png", "ablation.json"))
    launched.clear()
    assert run() == 0 and not launched and len(run.measured) == 2
    (out / "base" / "result.json").unlink()  # measured again, not trained again
    assert run() == 0 and not launched and run.measured[2:] == ["base/phase-2"]


def test_only_what_a_change_reaches_is_done_again(run, launched, tmp_path):
    assert run() == 0
    launched.clear()
    phases = [BASE["train"][0], {"subset": "filtered", "max_train_steps": 3}]
    write_rows(tmp_path / "rows", base=BASE | {"question": "asked otherwise"}, noise=NOISE | {"train": phases})
    mark = tmp_path / "out/noise/phase-2/checkpoint-2"
    mark.mkdir()
    assert run() == 0
    assert launched == ["train_lctg noise/phase-2", "train_dale noise/dale"] and not mark.exists()
    assert "asked otherwise" in (tmp_path / "out/report.md").read_text()
    launched.clear()
    assert run("--split test") == 0 and not launched and run.measured[3:] == ["base/phase-2", "noise/dale"]


@pytest.mark.skipif(fcntl is None, reason="needs flock")
@pytest.mark.parametrize("place", ["out/noise", "out/noise/phase-2"])  # another command, or what a killed one started
def test_a_row_that_another_process_is_at_is_left_alone(run, launched, tmp_path, capsys, place):
    assert run() == 0
    launched.clear()
    phases = [BASE["train"][0], {"subset": "filtered", "max_train_steps": 3}]
    write_rows(tmp_path / "rows", base=BASE, noise=NOISE | {"train": phases})
    (tmp_path / "out/noise/phase-2/unfinished-checkpoint-2").mkdir()
    handle = os.open(tmp_path / place, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        assert run() == 1 and not launched
    finally:
        os.close(handle)
    assert f"row noise: The folder {tmp_path / place} is in use" in capsys.readouterr().err
    assert (tmp_path / "out/noise/phase-2/unfinished-checkpoint-2").exists()
    assert run() == 0 and launched == ["train_lctg noise/phase-2", "train_dale noise/dale"]


def test_a_failed_training_does_not_stop_the_others(run, launched, tmp_path, capsys):
    launched.failing = {"dale"}
    assert run() == 1
    error = capsys.readouterr().err
    assert "row noise: train_dale.py ended with exit code 3" in error and error.count("first line") == 14
    assert "the reason" in error and "`base`" in (tmp_path / "out/report.md").read_text()
    launched.failing = set()
    launched.clear()
    assert run() == 0 and launched == ["train_dale noise/dale"]


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ({"arguments": {"learning_rat": "x"}}, "phase-1 is refused by train_lctg.py"),
        ({"arguments": {"no_such_thing": 1}}, "unrecognized arguments: --no_such_thing=1"),
        ({"arguments": {"learning_rate": -1}}, "--learning_rate: must be above zero"),
        ({"dale": {"max_train_steps": 1, "octave_exponent": 1}}, "dale is refused by train_dale.py"),
    ],
)
def test_scripts_check_arguments_before_any_work(run, launched, tmp_path, capsys, row, message):
    write_rows(tmp_path / "rows", noise=NOISE | row)
    assert run() == 2 and not launched and not (tmp_path / "out").exists()
    error = capsys.readouterr().err
    assert message in error and "noise.json" in error


def test_foreign_folders_and_unknown_rows_are_refused(run, launched, tmp_path, capsys):
    assert run("--only nothing") == 2 and "no row 'nothing'" in capsys.readouterr().err
    foreign = tmp_path / "out/base/phase-1"
    foreign.mkdir(parents=True)
    (foreign / "model_index.json").write_text("{}")
    assert run() == 2 and not launched and (foreign / "model_index.json").exists()
    assert f"has no file {DIGEST}" in capsys.readouterr().err


@pytest.fixture
def bench(prepared, monkeypatch):
    monkeypatch.setattr(ablate_measure, "SETTINGS", Settings(per_surface=1, takes=1, repeats=1))
    monkeypatch.setattr(ablate_measure, "STEPS", (1, 2))
    monkeypatch.setattr(ablate_measure, "SIGMAS", (0.1, 0.4))
    return ablate_measure.Bench(prepared, "validation")


def test_everything_of_a_pipeline_is_measured(bench, evaluable_pipe, tmp_path):
    evaluable_pipe().save_pretrained(str(tmp_path / "pipeline"))
    result = bench.measure(tmp_path / "pipeline", generates=True)
    assert result["parameters"] == sum(p.numel() for p in evaluable_pipe().lctg.parameters())
    assert set(result["steps"]) == {"1", "2"} and result["steps"]["1"] != result["steps"]["2"]
    # random weights know nothing of the surfaces
    assert result["steps"]["2"]["nine_band_db"] > 3 and result["generation"]["nine_band_db"] > 3
    weak, strong = result["rate_distortion"]
    assert weak["rate_kbit_s"] > strong["rate_kbit_s"] > 0
    # the waveform low-passed to fewer bits is further off
    assert weak["decimated"]["snr_db"] > strong["decimated"]["snr_db"]
    json.dumps(result, allow_nan=False)


def test_rate_is_shannons_and_decimated_carries_as_much(bench, evaluable_pipe, monkeypatch):
    """The formula again, from the latents' variances over the held-out set."""
    pipe, made = evaluable_pipe(dale=False), []
    original = ablate_measure.Decimated
    monkeypatch.setattr(ablate_measure, "Decimated", lambda *numbers: made.append(numbers) or original(*numbers))
    context = bench.context(pipe)
    points = ablate_measure.rate_distortion(context)["rate_distortion"]
    latents = encode(pipe, context.data.real, context.data.rate)[:, : pipe.lctg.base_channels]
    variance = latents.astype(np.float64).var((0, 2))
    frames_per_second = pipe.feature_extractor.sampling_rate / pipe.lctg.config.latent_hop
    for point, (numbers, bits), sigma in zip(points, made, (0.1, 0.4), strict=True):
        expected = frames_per_second * 0.5 * np.log2(1 + variance / sigma**2).sum()
        # latents are float32
        assert 1000 * point["rate_kbit_s"] == pytest.approx(expected, rel=1e-5)
        assert numbers * bits == pytest.approx(expected, rel=1e-5)


def test_the_detail_layer_is_measured_apart(bench, make_lctg, make_extractor):
    pipe = TactileTexturePipeline(
        lctg=make_lctg(segment_samples=2048, feature_channels=26, detail_channels=2),
        feature_extractor=make_extractor(feature_size=26, detail_samples=2),
        scheduler=VDDIMScheduler(),
    )
    pipe.set_progress_bar_config(disable=True)
    context = bench.context(pipe)
    decoded = []
    context.pipe.decode = lambda latents, *rest: (
        decoded.append(latents) or TactileTexturePipeline.decode(pipe, latents, *rest)
    )
    *layers, base = ablate_measure.rate_distortion(context)["rate_distortion"]
    assert [point["base_only"] for point in layers] == [False, False] and base["base_only"]
    assert not decoded[-1][:, 2:].any() and decoded[-1][:, :2].any() and decoded[0][:, 2:].any()
    assert base["sigma"] == pytest.approx(pipe.lctg.config.latent_noise or 0.1)


def test_a_training_that_was_cut_off_goes_on(run, launched, tmp_path):
    launched.failing = {"phase-2"}
    assert run("--only base") == 1
    kept = tmp_path / "out/base/phase-2/checkpoint-2"
    kept.mkdir()
    launched.failing = set()
    launched.clear()
    assert run("--only base") == 0
    assert launched == ["train_lctg base/phase-2"] and kept.is_dir()
    assert "--resume_from_checkpoint=latest" in launched.words
    assert f"--pretrained_model_name_or_path={tmp_path / 'out/base/phase-1'}" in launched.words


def test_each_seed_is_trained_and_rows_are_their_means(run, launched, tmp_path):
    assert run("--seeds 3 4") == 0
    assert launched == [
        f"train_{script}"
        for row, scripts in (("base", ("phase-1", "phase-2")), ("noise", ("phase-1", "phase-2", "dale")))
        for seed in (3, 4)
        for script in (f"{'dale' if name == 'dale' else 'lctg'} {row}-seed-{seed}/{name}" for name in scripts)
    ]
    assert "--seed=4" in launched.words
    written = json.loads((tmp_path / "out/ablation.json").read_text())
    result = written["rows"]["noise-seed-4"]
    assert written["shown"]["noise-seed-4"]["ktd_excess"] == result["steps"]["10"]["ktd_excess"]
    assert (result["group"], result["seed"]) == ("noise", 4)
    text = (tmp_path / "out/report.md").read_text()
    assert "Means of 2 trainings, seeds 3, 4." in text and "(`noise`)" in text and "| noise-seed-3 |" in text


def test_means_are_of_numbers():
    results = {
        f"row-seed-{seed}": {
            "group": "row",
            "seed": seed,
            "steps": {"5": {"a": 1.0 * seed, "b": None}},
            "points": [seed],
        }
        for seed in (1, 4)
    }
    assert averaged(results)["row"]["steps"] == {"5": {"a": 2.5, "b": None}}
    assert averaged(results)["row"]["points"] == [2.5]
    assert averaged({"row": {"loss": 2}}) == {"row": {"loss": 2}}


def test_equal_time_gives_a_slow_row_fewer_steps(run, launched, tmp_path, monkeypatch):
    original = ablate_training._launch

    def launch(words, log, threads):  # the second row takes twice as long a step
        code = original(words, log, threads)
        path = log.with_suffix("") / "log.jsonl"
        entries = [json.loads(line) for line in path.read_text().splitlines()]
        slower = 2 if log.parent.name.startswith("noise") else 1
        entries = [
            {**entry, "seconds": slower * entry["seconds"]} if "seconds" in entry else entry for entry in entries
        ]
        path.write_text("".join(json.dumps(entry) + "\n" for entry in entries))
        return code

    monkeypatch.setattr(ablate_training, "_launch", launch)
    assert run("--equal_time base") == 0
    assert launched[-3:] == [f"train_lctg noise-equal-time/phase-{n}" for n in (1, 2)] + [
        "train_dale noise-equal-time/dale"
    ]
    assert "--max_train_steps=2" in launched.words  # of DALE, in place of three: the base has none, LCTG's pace counts
    assert (
        "more noise on the latents, as long as `base` (`noise-equal-time`)" in (tmp_path / "out/report.md").read_text()
    )
    launched.clear()
    assert run("--equal_time base") == 0 and not launched
    assert run("--equal_time nothing") == 2


def test_what_learns_the_same_is_trained_once(run, launched, tmp_path):
    model = {"dale": {"patch_size": 2}, "kept_at_zero": ["rating_pool"]}
    write_rows(tmp_path / "rows", heads={"question": "another DALE", "extends": "noise", "model": model})
    assert run("--only noise heads") == 0
    lctg = [f"train_lctg noise/phase-{n}" for n in (1, 2)]
    assert launched == [*lctg, "train_dale noise/dale", "train_dale heads/dale"]
    assert json.loads((tmp_path / "out/heads/dale.json").read_text()) == model
    assert f"--model_config_name_or_path={tmp_path / 'out/heads/dale.json'}" in launched.words
    assert "dale" not in json.loads((tmp_path / "out/noise/model.json").read_text())


def test_a_trial_is_shorter_and_says_so(run, launched, tmp_path):
    assert run("--only base --shorten 2") == 0
    assert "--max_train_steps=1" in launched.words  # of two
    assert "A trial: trainings 2 times shorter" in (tmp_path / "out/report.md").read_text()


def test_the_papers_rows_are_the_papers_configuration_and_one_mend_each():
    configs = SCRIPTS / "configs"
    published, *mends = sorted(read_rows(configs / "paper"), key=lambda row: row.name != "as_published")
    paper = {
        **json.loads((configs / "lctg_paper.json").read_text()),
        **json.loads((configs / "dale_paper.json").read_text()),
    }
    assert published.model == paper and [phase["subset"] for phase in published.train] == ["full", "filtered"]
    extractor, lctg, dale = (paper[name] for name in ("feature_extractor", "lctg", "dale"))
    assert extractor["fixed_scale"] > 0 == extractor["level_bands"] == extractor["detail_samples"]  # nothing restored
    assert len(lctg["widths"]) == len(dale["widths"]) == 7 and "level_std" not in dale and lctg["latent_noise"] == 0
    assert published.arguments["octave_exponent"] == published.arguments["preemphasis_clip_db"] == 0
    assert published.dale["ratings"] == "single"
    steps = [phase["max_train_steps"] for phase in published.train]
    for row in mends:
        assert [phase["max_train_steps"] for phase in row.train] == steps, row.name
        assert row.dale["max_train_steps"] == published.dale["max_train_steps"]
        if row.name != "all_mends":
            assert row.lineage == ("as_published", row.name)
    ours = next(row for row in mends if row.name == "all_mends")
    assert ours.model == json.loads((configs / "lctg.json").read_text())
