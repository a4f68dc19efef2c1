"""Many textures by several processes: the same files for any number of them, whatever was killed in between."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
from generate_dataset import main, texture_seeds

from tactile_diffusers import TactileTexturePipeline
from tactile_diffusers.export import read_generated
from tactile_diffusers.export.generated import find_shards
from tactile_diffusers.io.locks import fcntl, is_locked
from tactile_diffusers.pipelines.folders import folder_digest

SCRIPT = Path(__file__).parents[2] / "examples" / "generate_dataset.py"
FILES = [f"train-0000{number}-of-00003.parquet" for number in range(3)]
TIMEOUT = 1200  # seconds; ten are enough, but not on a machine that is busy with something else


@pytest.fixture(scope="module")
def checkpoint(make_pipeline, rating_statistics, tmp_path_factory):
    folder = tmp_path_factory.mktemp("checkpoint") / "pipeline"
    make_pipeline(dale_config={"rating_statistics": rating_statistics}).save_pretrained(str(folder))
    return folder


def _words(folder, target, **changes):
    options = {"checkpoint": folder, "output": target, "num_textures": 10, "textures_per_shard": 4}
    options |= {"batch_size": 3, "num_inference_steps": 2, "seed": 5, **changes}
    return [f"--{name}={value}" for name, value in options.items() if value is not None] + ["--quiet"]


@pytest.fixture(scope="module")
def finished(checkpoint, tmp_path_factory):
    """A finished set, to be read alone."""
    folder = tmp_path_factory.mktemp("finished") / "out"
    assert main(_words(checkpoint, folder)) == 0
    return folder


@pytest.fixture
def out(finished, tmp_path):
    """A copy of it."""
    return Path(shutil.copytree(finished, tmp_path / "out"))


def _content(folder):
    """The bytes of every shard."""
    return {path.name: path.read_bytes() for path in find_shards(folder)}


def _untouched(path):
    """What changes when a file is written again, and not when it is read."""
    return path.stat().st_ino, path.stat().st_mtime_ns


def test_each_texture_is_what_its_seed_and_ratings_make(checkpoint, finished):
    data = read_generated(finished)
    seeds, ratings = data.column("seed"), data.column("ratings")
    assert data.shape == (10, 2048) and len(set(seeds)) == 10 and len(np.unique(ratings, axis=0)) == 10
    pipe = TactileTexturePipeline.from_pretrained(str(checkpoint))
    pipe.set_progress_bar_config(disable=True)
    for row in (0, 4, 9):
        out = pipe(ratings[row], num_inference_steps=2, generator=torch.Generator().manual_seed(int(seeds[row])))
        # alone and in a batch, sums are rounded otherwise: 3e-6 of the RMS was measured on the bundled checkpoint
        tolerance = 1e-5 * np.sqrt(np.mean(np.square(data[row])))
        np.testing.assert_allclose(data[row], out.textures[0], rtol=0, atol=tolerance)
        np.testing.assert_allclose(data.column("level")[row], out.level[0], atol=1e-5)
        np.testing.assert_allclose(data.column("friction_coefficient")[row], out.friction_coefficient[0], rtol=1e-5)


def test_shards_say_what_made_them(checkpoint, tmp_path):
    assert main(_words(checkpoint, tmp_path / "out", duration_s=0.1)) == 0
    shards = find_shards(tmp_path / "out")
    assert [len(pq.read_table(path)) for path in shards] == [4, 4, 2]
    table = pq.read_table(shards[2])
    assert len(table["texture"][1]) == 1000 and str(table["texture"].type) == "list<element: float>"
    facts = json.loads(table.schema.metadata[b"tactile_diffusers"])
    expected = {"sampling_rate": 10_000, "reference_speed": 80.0, "num_inference_steps": 2, "guidance_scale": 1.0}
    expected |= {"checkpoint_sha256": folder_digest(checkpoint), "torch": torch.__version__}
    assert expected.items() <= facts["settings"].items()
    assert {"checkpoint": "pipeline", "device": "cpu", "batch_size": 3}.items() <= facts["about"].items()
    card = (tmp_path / "out" / "README.md").read_text()
    for name, value in (facts["settings"] | {"checkpoint": "pipeline"}).items():
        assert f"| {name} | {value} |" in card
    assert not list((tmp_path / "out").rglob(".*"))


def test_the_licence_is_that_of_the_checkpoint(checkpoint, tmp_path, capsys):
    shutil.copytree(checkpoint, tmp_path / "licensed")
    (tmp_path / "licensed" / "README.md").write_text("---\nlicense: other\nlicense_name: ours\n---\n# A checkpoint\n")
    assert main(_words(tmp_path / "licensed", tmp_path / "out", num_textures=1)) == 0
    card = (tmp_path / "out" / "README.md").read_text()
    assert "\nlicense: other\n" in card and "\nlicense_name: ours\n" in card
    (tmp_path / "licensed" / "README.md").write_text("---\n- a list\n---\n")
    assert main(_words(tmp_path / "licensed", tmp_path / "out2")) == 2
    assert "README.md" in capsys.readouterr().err and not (tmp_path / "out2").exists()


def test_datasets_loads_the_folder(finished, tmp_path):
    datasets = pytest.importorskip("datasets")
    data = datasets.load_dataset(str(finished), split="train", cache_dir=str(tmp_path / "cache"))
    arrays, ours = data.with_format("numpy")[:], read_generated(finished)
    np.testing.assert_array_equal(arrays["texture"], ours[:])
    for name in ("roughness", "bumpiness", "slipperiness", "level", "friction_coefficient", "seed"):
        np.testing.assert_array_equal(arrays[name], ours.column(name))


def test_without_pyarrow_nothing_is_begun(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    monkeypatch.setattr("generate_dataset.load_pipeline", None)  # would raise if it were called
    assert main(_words("bundled", tmp_path / "out")) == 2
    error = capsys.readouterr().err
    assert 'Parquet files need pyarrow: pip install "tactile-diffusers[parquet]"' in error and error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_shares_of_two_processes_make_the_whole(checkpoint, finished, tmp_path, monkeypatch):
    """One after the other in this process: each writes its own shards, and the main process alone opens the folder."""
    answers = []

    class Process:
        num_processes, device = 2, torch.device("cpu")

        def __init__(self, *_, **__):
            self.process_index = len(answers)
            self.is_main_process = self.is_local_main_process = not self.process_index

        def destroy_process_group(self):
            pass

    def broadcast(answer):
        if answers:
            answer[:] = answers[0]
        answers.append(list(answer))

    monkeypatch.setattr("accelerate.PartialState", Process)
    monkeypatch.setattr("accelerate.utils.broadcast_object_list", broadcast)
    monkeypatch.setattr("accelerate.utils.gather_object", lambda parts: parts)
    for shards in (FILES[::2], FILES):
        assert main(_words(checkpoint, tmp_path / "two", batch_size=3)) == 0
        assert sorted(_content(tmp_path / "two")) == shards
    assert _content(tmp_path / "two") == _content(finished)


@pytest.mark.slow
def test_two_processes_write_what_one_does(checkpoint, finished, tmp_path):
    """Also with another number of threads, and on "cpu:0" in place of "cpu": each alone would round sums otherwise."""
    environment = {"HF_HUB_OFFLINE": "1", "CUDA_VISIBLE_DEVICES": "", "OMP_NUM_THREADS": "2"}
    launcher = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc_per_node=2", str(SCRIPT)]
    words, pipe = [*launcher, *_words(checkpoint, tmp_path / "two")[:-1]], subprocess.PIPE
    done = subprocess.run(
        words, env={**os.environ, **environment}, stdout=pipe, stderr=pipe, text=True, timeout=TIMEOUT
    )
    assert done.returncode == 0, done.stderr
    assert "by 2 process(es)" in done.stdout  # not each of them all
    assert _content(finished) == _content(tmp_path / "two")
    cards = [(folder / "README.md").read_text() for folder in (finished, tmp_path / "two")]
    assert cards[0].replace("out", "two") == cards[1]  # the title


def test_missing_shards_alone_are_generated(checkpoint, finished, out, capsys):
    (out / "data" / FILES[1]).unlink()
    before = {path: _untouched(path) for path in [*find_shards(out), out / "README.md"]}
    assert main(_words(checkpoint, out)[:-1]) == 0
    printed = capsys.readouterr()
    assert "10 textures, 4 of them generated now" in printed.out and "100,000 would take" in printed.out
    assert "4/4" in printed.err and _content(out) == _content(finished)
    assert {path: _untouched(path) for path in before} == before
    before = {path: _untouched(path) for path in out.rglob("*")}
    assert main(_words(checkpoint, out)[:-1]) == 0
    printed = capsys.readouterr().out
    assert "10 textures, 0 of them generated now" in printed and "hours" not in printed
    assert {path: _untouched(path) for path in out.rglob("*")} == before
    assert main(_words(checkpoint, out)) == 0 and capsys.readouterr() == ("", "")  # quiet


@pytest.mark.skipif(fcntl is None, reason="needs flock")
def test_a_folder_in_which_another_call_writes_is_refused(checkpoint, out, capsys):
    assert not is_locked(out)
    (out / "data" / FILES[1]).unlink()
    (out / "data" / f".{FILES[1]}.1.tmp").touch()
    before = sorted(out.rglob("*"))
    handle = os.open(out, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)  # what another process holds
        assert main(_words(checkpoint, out)) == 2
        assert f"error: --output {out} is in use: another process is writing" in capsys.readouterr().err
        assert sorted(out.rglob("*")) == before
    finally:
        os.close(handle)
    assert main(_words(checkpoint, out)) == 0 and sorted(_content(out)) == FILES
    assert not list(out.rglob(".*"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"num_textures": 11}, "num_textures 10, not 11; ratings_sha256"),
        ({"textures_per_shard": 5}, "(textures_per_shard 4, not 5)"),
        ({"num_inference_steps": 3}, "num_inference_steps 2, not 3"),
        ({"guidance_scale": 1.5}, "(guidance_scale 1.0, not 1.5)"),
        ({"duration_s": 0.1}, "(duration_s None, not 0.1)"),
        ({"seed": 6}, "seed 5, not 6"),
    ],
)
def test_other_settings_are_refused(checkpoint, out, capsys, changes, message):
    before = _content(out)
    assert main(_words(checkpoint, out, **changes)) == 2
    error = capsys.readouterr().err
    assert error.startswith("generate_dataset.py: error: ") and message in error and error.count("\n") == 1
    assert _content(out) == before


def test_another_checkpoint_is_refused_and_a_copy_is_not(checkpoint, out, make_pipeline, tmp_path, capsys):
    shutil.copytree(checkpoint, tmp_path / "copy")
    (tmp_path / "copy" / "README.md").write_text("notes")
    assert main(_words(tmp_path / "copy", out)) == 0
    config = json.loads((checkpoint / "dale" / "config.json").read_text())["rating_statistics"]
    make_pipeline(seed=7, dale_config={"rating_statistics": config}).save_pretrained(str(tmp_path / "other"))
    assert main(_words(tmp_path / "other", out)) == 2
    assert "(checkpoint_sha256 " in capsys.readouterr().err


def test_ratings_of_a_file(checkpoint, tmp_path, capsys):
    table = tmp_path / "ratings.csv"
    table.write_text("bumpiness,roughness\n1,-1\n,0.5\n0,\n")
    assert main(_words(checkpoint, tmp_path / "out", ratings_file=table)) == 0
    rows = [[-1, 1, np.nan], [0.5, np.nan, np.nan], [np.nan, 0, np.nan]]
    np.testing.assert_array_equal(read_generated(tmp_path / "out").column("ratings"), (rows * 4)[:10])
    table.write_text("bumpiness,roughness\n1,-1\n,0.6\n0,\n")
    assert main(_words(checkpoint, tmp_path / "out", ratings_file=table)) == 2
    assert "(ratings_sha256 " in capsys.readouterr().err


def test_unusual_ratings_are_warned_of_once(checkpoint, tmp_path, recorded_warnings):
    (tmp_path / "far.csv").write_text("roughness\n2\n3\n")
    with recorded_warnings() as found:
        words = _words(checkpoint, tmp_path / "out", ratings_file=tmp_path / "far.csv", batch_size=2)
        assert main(words[:-1]) == 0
    novel = [text for text in found if "outside what training covered" in text]
    assert len(novel) == 1 and "roughness +3.00" in novel[0]


def test_nothing_is_written_for_what_the_pipeline_refuses(checkpoint, make_pipeline, tmp_path, capsys):
    (tmp_path / "bad.csv").write_text("rougness\n1\n")
    make_pipeline().save_pretrained(str(tmp_path / "unrated"))
    make_pipeline(dale=False).save_pretrained(str(tmp_path / "decoder"))
    for folder, changes, message in (
        (checkpoint, {"ratings_file": tmp_path / "bad.csv"}, "--ratings_file"),
        (checkpoint, {"guidance_scale": -1}, "`guidance_scale` must be"),
        (checkpoint, {"duration_s": -1}, "`duration_s` must be"),
        (tmp_path / "unrated", {}, "quantiles"),
        (tmp_path / "decoder", {}, "cannot generate"),
    ):
        assert main(_words(folder, tmp_path / "out", **changes)) == 2
        assert message in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"num_textures": 0}, "--num_textures: must be at least 1, got 0"),
        ({"seed": 2**64}, "--seed: must be at least 0 and below 2**63"),
        ({"ratings_file": "nowhere.csv"}, "--ratings_file: nowhere.csv is not a file"),
        ({"checkpoint": "nowhere"}, "--checkpoint: nowhere is neither a folder"),
        ({"output": __file__}, "is not a folder"),
        ({"num_textures": None}, "--num_textures"),
    ],
)
def test_bad_arguments_are_refused_by_name(tmp_path, capsys, changes, message):
    with pytest.raises(SystemExit) as stop:
        main(_words(tmp_path, tmp_path / "out", **changes))
    assert stop.value.code == 2 and message in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_no_two_textures_share_their_noise():
    """Seeds that differ in more than 32 bits only are one seed to PyTorch's generator on the CPU."""
    seeds = texture_seeds(0, 100_000)
    assert len(np.unique(seeds & 0xFFFFFFFF)) == 100_000 and seeds.min() >= 0
    assert not np.isin(texture_seeds(1, 1000), seeds).any()
    np.testing.assert_array_equal(texture_seeds(0, 10), seeds[:10])
