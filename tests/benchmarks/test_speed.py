"""The suite "speed" with `--peers`, on a tiny pipeline: every figure is there; how large a time is, no test tells."""

import json
import math
import time

import benchmark
import pareto as benchmark_pareto
import peer_models
import peers as benchmark_peers
import pytest
import speed as benchmark_speed
import torch

from tactile_diffusers import DALEModel, LCTGModel
from tactile_diffusers.data import SegmentLimits, prepare_recordings
from tactile_diffusers.virtual import generate_recordings


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("speed")
    generate_recordings(folder / "r.h5", surfaces=8, seconds=15, explorers=1, seed=4, quiet=True)
    limits = SegmentLimits(seconds=2048 / 2500)  # those of `evaluable_pipe`
    prepare_recordings(folder / "r.h5", folder / "p.h5", limits=limits, validation=1, test=3, quiet=True)
    return folder / "p.h5"


@pytest.fixture
def checkpoint(make_pipeline, tmp_path):
    pipe = make_pipeline(dale_config={"latent_frames": 128, "widths": [64, 96]}, lctg_config={"segment_samples": 2048})
    pipe.save_pretrained(str(tmp_path / "pipeline"))
    return tmp_path / "pipeline"


@pytest.fixture
def small(monkeypatch):
    """Few and short measurements, no child processes, no compiler, a small network for that of the other package."""
    monkeypatch.setattr(benchmark_speed, "BATCHES", (1,))
    for module in (benchmark_peers, benchmark_speed):
        monkeypatch.setattr(module, "DURATIONS", (1.0, 1.5))
        monkeypatch.setattr(module, "peak_memory", lambda *_: 1.0)
    monkeypatch.setattr(benchmark_peers, "_MATRIX", 64)
    monkeypatch.setattr(peer_models, "_UNET_CHANNELS", (64, 64, 64, 32))
    monkeypatch.setattr(peer_models, "_UNET_ATTENTIONS", 1)
    monkeypatch.setattr(peer_models, "SEGMENT_SAMPLES", 512)
    for model in (LCTGModel, DALEModel):
        monkeypatch.setattr(model, "compile", lambda self, **_: None)


@pytest.fixture
def without_audio_diffusion(monkeypatch):
    def missing():
        raise ModuleNotFoundError("No module named 'audio_diffusion_pytorch'")

    monkeypatch.setattr(peer_models, "_import_audio_diffusion", missing)


def _finite(values):
    return all(math.isfinite(value) and value > 0 for value in values)


@pytest.mark.slow
def test_the_comparison_is_complete(small, without_audio_diffusion, checkpoint, prepared, tmp_path, capsys, make_lctg):
    """A package that is missing is named with the command that installs it; all else is measured."""
    make_lctg(seed=3, segment_samples=2048).save_pretrained(checkpoint / "lctg_distilled")
    out = tmp_path / "out"
    words = f"--checkpoint {checkpoint} --output {out} --repeats 1 --peers --anchor {checkpoint} --data {prepared}"
    assert benchmark.main([*words.split(), "--segments", "3", "--batches", "2", "1", "--quiet"]) == 0
    report = json.loads((out / "benchmark.json").read_text())
    peers = report["peers"]
    assert "not installed" in peers["notes"][0] and peer_models.INSTALL in peers["notes"][0]
    models, batches = peers["models"], peers["batches"]
    rows = {benchmark_peers.OURS, benchmark_peers.COMPILED, benchmark_peers.BFLOAT16, benchmark_peers.ANCHOR}
    rows |= {"ours, 5 + 5 steps", "ours, distilled, 5 + 2 steps", "ours, distilled, 5 + 1 steps"}
    rows |= {"UNet1DModel, 18 M", "UNet1DModel, at our size"}
    assert set(models) == rows == set(batches["1"]) == set(batches["2"])
    ours, cut = (models[name]["parameters, M"] for name in (benchmark_peers.OURS, "UNet1DModel, at our size"))
    assert abs(cut / ours - 1) <= peer_models.SIZE_TOLERANCE
    # half the steps, half the work but for what is prepared once a call; a distilled LCTG saves its own share
    work = {name: row["multiply-adds of a segment, G"] for name, row in models.items()}
    assert work["ours, 5 + 5 steps"] == pytest.approx(work[benchmark_peers.OURS] / 2, rel=0.01)
    assert work["ours, distilled, 5 + 1 steps"] < work["ours, distilled, 5 + 2 steps"] < work["ours, 5 + 5 steps"]
    for by_row in batches.values():
        for name, row in by_row.items():
            assert _finite(row.values()), name
            for other in ("UNet1DModel, at our size", benchmark_peers.ANCHOR):
                assert row[f"times as fast as {other}"] == pytest.approx(by_row[other]["s"] / row["s"])
    assert _finite(value for row in peers["durations"].values() for value in row.values())
    assert peers["compiled differs by"] == 0 and "are equal to plain ones" in (out / "benchmark.md").read_text()
    # the same weights twice: the same errors; more steps of a random network change them
    pareto = report["pareto"]["models"]
    assert set(pareto) == {"ours", "ours, bfloat16", "ours, distilled", benchmark_peers.ANCHOR}
    errors = {name: {n: entry["nine_band_db"]["mean"] for n, entry in by.items()} for name, by in pareto.items()}
    assert errors["ours"]["5"] == pytest.approx(errors[benchmark_peers.ANCHOR]["5"])
    assert errors["ours"]["5"] == pytest.approx(errors["ours, bfloat16"]["5"], rel=0.05)
    assert errors["ours"]["1"] != pytest.approx(errors["ours, distilled"]["1"])
    assert _finite(entry["seconds"] for by in pareto.values() for entry in by.values())
    assert (out / "pareto.png").stat().st_size > 10_000
    assert "Beside other models" in capsys.readouterr().out


def test_without_a_compiler_the_rest_is_measured(small, without_audio_diffusion, checkpoint, monkeypatch):
    def broken(self, **_):
        self.forward = lambda *args, **kwargs: (_ for _ in ()).throw(RuntimeError("no C++ compiler\nat length"))

    monkeypatch.setattr(LCTGModel, "compile", broken)
    words = f"--output {checkpoint / 'o'} --repeats 1 --peers --batches 1"
    arguments = benchmark.parse_arguments(words.split())
    pipe = benchmark_peers.load(checkpoint)
    found = benchmark_peers.compare(arguments, pipe, str(checkpoint))
    assert "compiled: RuntimeError: no C++ compiler" in found["notes"]
    assert benchmark_peers.COMPILED not in found["models"] and found["compiled differs by"] is None
    assert any(note.startswith("distilled: none") for note in found["notes"])


@pytest.mark.slow
def test_an_anchor_without_dale_is_left_out(small, without_audio_diffusion, checkpoint, evaluable_pipe, tmp_path):
    evaluable_pipe(dale=False).save_pretrained(str(tmp_path / "anchor"))
    words = f"--output {tmp_path / 'o'} --repeats 1 --peers --anchor {tmp_path / 'anchor'}"
    found = benchmark_peers.compare(
        benchmark.parse_arguments(words.split()), benchmark_peers.load(checkpoint), str(checkpoint)
    )
    assert benchmark_peers.ANCHOR not in found["models"]
    assert any("no DALE in anchor" in note for note in found["notes"])


def test_the_front_is_what_nothing_beats_in_both():
    def entry(seconds, error):
        return {"seconds": seconds, "nine_band_db": {"mean": error}}

    models = {"a": {"1": entry(1.0, 3.0), "2": entry(2.0, 1.0)}, "b": {"1": entry(1.5, 3.5), "2": entry(4.0, 0.5)}}
    assert benchmark_pareto.front({"models": models}) == [(1.0, 3.0), (2.0, 1.0), (4.0, 0.5)]


def test_timings_are_taken_in_turn_and_long_runs_once():
    called = []
    runs = {name: lambda n=name: called.append(n) for name in "ab"}
    assert _finite(benchmark_speed.seconds_of(runs, 2).values()) and "".join(called) == "ababab"
    called.clear()
    assert set(benchmark_speed.seconds_of(runs, 2, long_run=0.0)) == {"a", "b"} and "".join(called) == "ab"


def test_multiply_adds_of_known_layers():
    conv, linear = torch.nn.Conv1d(3, 5, 3, padding=1, bias=False), torch.nn.Linear(7, 2, bias=False)
    assert benchmark_peers.multiply_adds(lambda: conv(torch.zeros(2, 3, 10))) == 2 * 10 * 5 * 3 * 3
    assert benchmark_peers.multiply_adds(lambda: linear(torch.zeros(4, 7))) == 4 * 7 * 2
    query, keys = torch.zeros(1, 2, 6, 4), torch.zeros(1, 2, 3, 4)  # batch, heads, positions, width
    attend = torch.nn.functional.scaled_dot_product_attention
    assert benchmark_peers.multiply_adds(lambda: attend(query, keys, keys)) == 2 * (2 * 6 * 3 * 4)


@pytest.mark.parametrize("parameters", [300_000, 3_000_000])
def test_a_network_cut_to_a_size(parameters):
    cut = peer_models.unet_1d(parameters)
    assert abs(peer_models.size(cut.module) / parameters - 1) <= peer_models.SIZE_TOLERANCE


def test_a_size_that_cannot_be_met_is_refused():
    with pytest.raises(ValueError, match="`parameters` of 1000 cannot be met within 10%: the nearest model has 6"):
        peer_models.fit(lambda factor: torch.nn.Linear(2, 2), 1000)


def test_the_other_packages_networks():
    """Of the size that was published or asked for, and one segment at 10 kHz comes out."""
    try:
        peer_models.audio_diffusion_version()
    except ImportError as error:
        pytest.skip(str(error))
    with torch.device("meta"):
        published = peer_models.audio_diffusion()
    assert peer_models.size(published.module) == pytest.approx(76.7e6, rel=0.01)
    cut = peer_models.audio_diffusion(2_000_000)
    assert abs(peer_models.size(cut.module) / 2e6 - 1) <= peer_models.SIZE_TOLERANCE
    assert cut.generate(2, 1).shape == (2, 1, 16384) and cut.generate(1, 1, 2.0).shape[-1] == 20480


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--suite stream --peers", "--peers: belongs to --suite speed, got --suite stream"),
        ("--anchor {folder}", "--anchor: needs --suite speed --peers"),
        ("--distilled {folder}", "--distilled: needs --suite speed --peers"),
        ("--peers --anchor {folder}", "{folder} has no model_index.json"),
        ("--peers --distilled {folder}", "{folder} has no config.json"),
    ],
)
def test_what_does_not_belong_together_is_refused(words, message, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        benchmark.parse_arguments([*words.format(folder=tmp_path).split(), "--output", str(tmp_path / "out")])
    assert stop.value.code == 2 and message.format(folder=tmp_path) in capsys.readouterr().err


def test_what_would_take_too_long_is_left_out(monkeypatch):
    monkeypatch.setattr(benchmark_peers, "LONGEST_RUN", 0.5)
    slow = benchmark_peers.Competitor([], lambda count, seconds=None: time.sleep(0.06))
    quick = benchmark_peers.Competitor([], lambda count, seconds=None: None)
    models = {name: {"multiply-adds of a segment, G": 1.0} for name in ("slow", "quick")}
    found = benchmark_peers._batches({"slow": slow, "quick": quick}, [1, 2, 64, 128], 1, 1e9, models)
    # 0.03 s for each of two: 1.9 s for 64, though batches take no longer here
    assert [set(rows) for rows in found.values()] == [{"slow", "quick"}] * 2 + [{"quick"}] * 2
