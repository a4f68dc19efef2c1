"""Many textures by several processes: the same files for any number of them, whatever was killed in between."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

from tactile_diffusers import TactileTexturePipeline
from tactile_diffusers.cli.generate_dataset import main, texture_seeds
from tactile_diffusers.evaluation.report import folder_digest
from tactile_diffusers.export import read_generated
from tactile_diffusers.io.locks import fcntl, is_locked

SCRIPT = Path(__file__).parents[2] / "examples" / "generate_dataset.py"
TIMEOUT = 1200  # seconds; ten are enough, but not on a machine that is busy with something else
STATISTICS = {
    "quantiles": [[-1.5, 0.0, 1.5]] * 3,
    "centre": [0.0] * 3,
    "covariance": [[0.6, 0.2, 0.0], [0.2, 0.6, 0.0], [0.0, 0.0, 0.6]],
    "reach": 4.0,
    "range": [[-1.5, 1.5]] * 3,
}


@pytest.fixture
def checkpoint(make_pipeline, tmp_path):
    make_pipeline(dale_config={"rating_statistics": STATISTICS}).save_pretrained(str(tmp_path / "pipeline"))
    return tmp_path / "pipeline"


def _words(folder, target, **changes):
    options = {"checkpoint": folder, "output": target, "num_textures": 10, "textures_per_shard": 4}
    options |= {"batch_size": 3, "num_inference_steps": 2, "seed": 5, **changes}
    return [f"--{name}={value}" for name, value in options.items() if value is not None] + ["--quiet"]


def _subprocess(words, launcher=()):
    # no GPU is seen, and accelerate is not told
    environment = {"HF_HUB_OFFLINE": "1", "CUDA_VISIBLE_DEVICES": "", "OMP_NUM_THREADS": "2"}
    return subprocess.Popen(
        [sys.executable, *launcher, str(SCRIPT), *words],
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _content(folder):
    """Every dataset of every shard, as bytes."""
    content = {}
    for path in sorted(folder.glob("*.h5")):
        with h5py.File(path) as file:
            content[path.name] = {name: values[()].tobytes() for name, values in file.items()}
    return content


def _untouched(path):
    """What changes when a file is written again, and not when it is read."""
    return path.stat().st_ino, path.stat().st_mtime_ns


def test_each_texture_is_what_its_seed_and_ratings_make(checkpoint, tmp_path):
    assert main(_words(checkpoint, tmp_path / "out")) == 0
    data = read_generated(tmp_path / "out")
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


def test_the_batch_size_changes_nothing_but_rounding(checkpoint, tmp_path):
    for size in (1, 4):
        assert main(_words(checkpoint, tmp_path / str(size), batch_size=size)) == 0
    one, four = (read_generated(tmp_path / size)[:] for size in ("1", "4"))
    np.testing.assert_allclose(one, four, rtol=0, atol=1e-5 * np.sqrt(np.mean(np.square(four))))  # as above


def test_shards_say_what_made_them(checkpoint, tmp_path):
    assert main(_words(checkpoint, tmp_path / "out", duration_s=0.1)) == 0
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert [shard["count"] for shard in manifest["shards"]] == [4, 4, 2]
    assert manifest["about"]["checkpoint"] == "pipeline"
    with h5py.File(tmp_path / "out" / "textures-00002.h5") as file:
        assert file["textures"].shape == (2, 1000) and file["textures"].dtype == np.float32
        expected = {"sampling_rate": 10_000, "reference_speed": 80.0, "num_inference_steps": 2, "guidance_scale": 1.0}
        expected |= {"checkpoint_sha256": folder_digest(checkpoint), "torch": torch.__version__, "device": "cpu"}
        assert {name: file.attrs[name] for name in expected} == expected
    assert not list((tmp_path / "out").glob(".*"))


def test_two_processes_write_what_one_does(checkpoint, tmp_path):
    """Also with another number of threads, and on "cpu:0" in place of "cpu": each alone would round sums otherwise."""
    assert main(_words(checkpoint, tmp_path / "one")) == 0
    launcher = ["-m", "torch.distributed.run", "--standalone", "--nproc_per_node=2"]
    launched = _subprocess([word for word in _words(checkpoint, tmp_path / "two") if word != "--quiet"], launcher)
    printed, errors = launched.communicate(timeout=TIMEOUT)
    assert launched.returncode == 0, errors
    assert "by 2 process(es)" in printed  # not each of them all
    assert _content(tmp_path / "one") == _content(tmp_path / "two")
    assert (tmp_path / "one" / "manifest.json").read_text() == (tmp_path / "two" / "manifest.json").read_text()


@pytest.mark.slow
def test_a_killed_and_resumed_run_equals_an_unbroken_one(checkpoint, tmp_path, capsys):
    words = dict(num_inference_steps=20, batch_size=1)
    out = tmp_path / "killed"
    killed = _subprocess(_words(checkpoint, out, **words))
    deadline = time.monotonic() + TIMEOUT
    while not list(out.glob(".textures-00001.h5.*.tmp")):  # in the middle of the second shard
        assert killed.poll() is None and time.monotonic() < deadline
        time.sleep(0.002)
    os.kill(killed.pid, signal.SIGKILL)
    killed.communicate()
    assert killed.returncode == -signal.SIGKILL
    assert sorted(path.name for path in out.glob("*.h5")) == ["textures-00000.h5"]
    assert list(out.glob(".textures-00001.h5.*.tmp"))
    first = _untouched(out / "textures-00000.h5")
    assert main([word for word in _words(checkpoint, out, **words) if word != "--quiet"]) == 0
    assert "10 textures, 6 of them generated now" in capsys.readouterr().out
    assert _untouched(out / "textures-00000.h5") == first and not list(out.glob(".*"))
    assert main(_words(checkpoint, tmp_path / "unbroken", **words)) == 0
    assert _content(out) == _content(tmp_path / "unbroken")
    assert read_generated(out).column("seed").tolist() == texture_seeds(5, 10).tolist()


def test_a_finished_set_is_left_alone(checkpoint, tmp_path, capsys):
    assert main(_words(checkpoint, tmp_path / "out")) == 0
    before = {path: _untouched(path) for path in (tmp_path / "out").iterdir()}
    assert main(_words(checkpoint, tmp_path / "out")[:-1]) == 0
    printed = capsys.readouterr().out
    assert "10 textures, 0 of them generated now" in printed and "hours" not in printed
    assert before == {path: _untouched(path) for path in (tmp_path / "out").iterdir()}


@pytest.mark.skipif(fcntl is None, reason="needs flock")
def test_a_folder_in_which_another_call_writes_is_refused(checkpoint, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(_words(checkpoint, out)) == 0 and not is_locked(out)
    (out / "textures-00001.h5").unlink()
    (out / ".textures-00001.h5.1.tmp").touch()
    before = sorted(out.iterdir())
    handle = os.open(out, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)  # what another process holds
        assert main(_words(checkpoint, out)) == 2
        assert f"error: --output {out} is in use: another process is writing" in capsys.readouterr().err
        assert sorted(out.iterdir()) == before
    finally:
        os.close(handle)
    assert main(_words(checkpoint, out)) == 0 and len(list(out.iterdir())) == 4


def test_throughput_is_printed_and_quiet_is_quiet(checkpoint, tmp_path, capfd):
    assert main(_words(checkpoint, tmp_path / "out")) == 0
    captured = capfd.readouterr()
    assert captured.out == captured.err == ""
    assert main(_words(checkpoint, tmp_path / "loud")[:-1]) == 0
    captured = capfd.readouterr()
    assert "10 textures in" in captured.out and "100,000 would take" in captured.out and "10/10" in captured.err


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
def test_other_settings_are_refused(checkpoint, tmp_path, capsys, changes, message):
    assert main(_words(checkpoint, tmp_path / "out")) == 0
    before = _content(tmp_path / "out")
    assert main(_words(checkpoint, tmp_path / "out", **changes)) == 2
    error = capsys.readouterr().err
    assert error.startswith("generate_dataset.py: error: ") and message in error and error.count("\n") == 1
    assert _content(tmp_path / "out") == before


def test_another_checkpoint_is_refused_and_a_copy_is_not(checkpoint, make_pipeline, tmp_path, capsys):
    assert main(_words(checkpoint, tmp_path / "out")) == 0
    checkpoint.rename(tmp_path / "copy")
    (tmp_path / "copy" / "README.md").write_text("notes")
    assert main(_words(tmp_path / "copy", tmp_path / "out")) == 0
    make_pipeline(seed=7, dale_config={"rating_statistics": STATISTICS}).save_pretrained(str(checkpoint))
    assert main(_words(checkpoint, tmp_path / "out")) == 2
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


@pytest.mark.parametrize("message", ["--ratings_file", "quantiles"])
def test_nothing_is_written_when_ratings_are_refused(make_pipeline, tmp_path, capsys, message):
    make_pipeline().save_pretrained(str(tmp_path / "pipeline"))
    (tmp_path / "bad.csv").write_text("rougness\n1\n")
    changes = {"ratings_file": tmp_path / "bad.csv"} if "file" in message else {}
    assert main(_words(tmp_path / "pipeline", tmp_path / "out", **changes)) == 2
    assert message in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_a_pipeline_that_only_reconstructs_is_refused(make_pipeline, tmp_path, capsys):
    make_pipeline(dale=False).save_pretrained(str(tmp_path / "pipeline"))
    assert main(_words(tmp_path / "pipeline", tmp_path / "out")) == 2
    assert "cannot generate" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_unusual_ratings_are_warned_of_once(checkpoint, tmp_path, recorded_warnings):
    (tmp_path / "far.csv").write_text("roughness\n2\n3\n")
    with recorded_warnings() as found:
        words = _words(checkpoint, tmp_path / "out", ratings_file=tmp_path / "far.csv", batch_size=2)
        assert main(words[:-1]) == 0
    novel = [text for text in found if "outside what training covered" in text]
    assert len(novel) == 1 and "roughness +3.00" in novel[0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"num_textures": 0}, "--num_textures: must be at least 1, got 0"),
        ({"batch_size": -1}, "--batch_size: must be at least 1"),
        ({"textures_per_shard": 0}, "--textures_per_shard: must be at least 1"),
        ({"num_latent_inference_steps": 0}, "--num_latent_inference_steps: must be at least 1"),
        ({"seed": -1}, "--seed: must be at least 0"),
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


@pytest.mark.parametrize("name", ["guidance_scale", "duration_s"])
def test_what_the_pipeline_refuses_is_refused_before_anything_is_written(checkpoint, tmp_path, capsys, name):
    assert main(_words(checkpoint, tmp_path / "out", **{name: -1})) == 2
    assert f"`{name}` must be" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_no_two_textures_share_their_noise():
    """Seeds that differ in more than 32 bits only are one seed to PyTorch's generator on the CPU."""
    seeds = texture_seeds(0, 100_000)
    assert len(np.unique(seeds & 0xFFFFFFFF)) == 100_000 and seeds.min() >= 0
    assert not np.isin(texture_seeds(1, 1000), seeds).any()
    np.testing.assert_array_equal(texture_seeds(0, 10), seeds[:10])
