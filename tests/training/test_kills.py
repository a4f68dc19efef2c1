"""Trainings that are killed at random moments, checkpoint writes among them, end as if they had never been."""

import json
import pickle
import signal
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from tactile_diffusers import TactileTexturePipeline
from tactile_diffusers.training.checkpoints import checkpoints, latest_checkpoint, step_of

EXAMPLES = Path(__file__).parents[2] / "examples"
#: What lies in the output folder while a training is in one of these.
PHASES = {
    "checkpoint": "unfinished-checkpoint-*",
    "rotation": "unfinished-removal-of-checkpoint-*",
    "result": "unfinished-result",
}
SECONDS = 240  # a life takes one or two, but not on a machine that is busy with something else


class Mortal:
    """A training script that is run again and again, and killed.

    Args:
        lives: the fixture.
        script (`str`): its name.
        words (`list[str]`): the command line but for `--resume_from_checkpoint`.
        output (`Path`): its output folder.
        seed (`int`): of the moments of the kills.
    """

    def __init__(self, lives, script, words, output, seed):
        self.lives, self.script, self.words, self.output = lives, EXAMPLES / f"{script}.py", words, output
        self.rng, self.log = np.random.default_rng(seed), output.with_suffix(".log")
        self.hits, self.step = Counter(), 0

    def start(self):
        words = [*self.words, "--resume_from_checkpoint=latest"] if self.output.exists() else self.words
        self.began = time.monotonic()
        self.lives.start(self.script, words, self.log)

    def finish(self):
        """A life to its natural end; returns its seconds."""
        self.start()
        assert self.lives.wait() == 0, self.log.read_text()[-3000:]
        return time.monotonic() - self.began

    def kill(self, phase, longest):
        """A life that is killed up to `longest` seconds after it came to a phase, or, without one, began.

        Returns:
            `bool`: whether it was; `False` if it ended before.
        """
        before = self._described()
        self.start()
        while phase and not (self._described() > before and self._in(phase)) and not self.lives.ended(0.0002):
            assert time.monotonic() - self.began < SECONDS
        if not self.lives.ended(self.rng.uniform(0, longest)):
            self.lives.kill()
        code = self.lives.wait()
        assert code in (0, -signal.SIGKILL), self.log.read_text()[-3000:]
        if code == 0:
            return False
        found = [name for name in PHASES if self._described() > before and self._in(name)]
        self.hits[(found or ["elsewhere"])[0]] += 1
        self.check()
        return True

    def _in(self, phase):
        return any(self.output.glob(PHASES[phase]))

    def _described(self):
        """When a life wrote training.json: from then on, what the life before it left unfinished is gone."""
        path = self.output / "training.json"
        return path.stat().st_mtime_ns if path.is_file() else 0

    def check(self):
        """What is in the folder under its final name can be loaded, and no step is lost."""
        latest = latest_checkpoint(self.output)
        assert latest is not None or not self.step
        self.step, before = (step_of(latest) if latest else 0), self.step
        assert self.step >= before
        for checkpoint in checkpoints(self.output):
            assert {"optimizer.bin", "scheduler.bin", "random_states_0.pkl"} <= {p.name for p in checkpoint.iterdir()}
            assert len(list(checkpoint.glob("*/config.json"))) == len(list(checkpoint.glob("*/*.safetensors"))) == 2
            _content(checkpoint)
        if (self.output / "model_index.json").is_file():
            TactileTexturePipeline.from_pretrained(str(self.output))
        if (self.output / "training.json").is_file():
            json.loads((self.output / "training.json").read_text())


def _content(folder):
    """Every tensor and number below a folder of checkpoints and components."""
    content = {}
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        name = str(path.relative_to(folder))
        if path.suffix == ".safetensors":
            content[name] = load_file(path)
        elif path.suffix in (".bin", ".pkl"):
            content[name] = torch.load(path, weights_only=False)
        elif len(path.relative_to(folder).parts) > 1:
            content[name] = json.loads(path.read_text())
    return content


def _equal(first, second):
    """Whether two states are the same bit for bit: their pickles may not be, for they say what shares memory."""
    if isinstance(first, dict):
        return first.keys() == second.keys() and all(_equal(first[key], second[key]) for key in first)
    if isinstance(first, list | tuple):
        return len(first) == len(second) and all(map(_equal, first, second))
    if isinstance(first, torch.Tensor):
        return first.dtype == second.dtype and torch.equal(first, second)
    if isinstance(first, np.ndarray):
        return np.array_equal(first, second)
    return pickle.dumps(first) == pickle.dumps(second)


def _told(folder):
    """Steps of the log, and the validations; means over the steps of one life are over fewer than unbroken."""
    entries = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    return [(e["step"], {k: v for k, v in e.items() if k.startswith("validation/")}) for e in entries]


def _assert_alike(killed, unbroken):
    files = [sorted(str(p.relative_to(folder)) for p in folder.rglob("*")) for folder in (killed, unbroken)]
    assert files[0] == files[1]  # so nothing is left unfinished
    first, second = _content(killed), _content(unbroken)
    assert [name for name in second if not _equal(first[name], second[name])] == []
    assert _told(killed) == _told(unbroken)


@pytest.fixture(scope="module")
def decoder(script, run_script, tmp_path_factory):
    """Output folder of train_lctg.py."""
    return run_script(script("train_lctg"), "lctg", tmp_path_factory.mktemp("decoder") / "lctg", max_train_steps=2)


@pytest.fixture
def die_and_live(lives, options_of_a_tiny_training, tmp_path, request):
    """`die_and_live(script, kills, steps, aims)` kills a training so often, lets it end and compares; returns the hits.

    `aims` are phases, taken in turn.
    """

    def run(name, kills, steps, aims, seed=0):
        changes = {"max_train_steps": steps, "checkpointing_steps": 1, "checkpoints_total_limit": 1}
        changes |= {"validation_steps": max(1, steps // 2), "seed": 3}
        if name != "train_lctg":
            changes |= {
                "pretrained_model_name_or_path": request.getfixturevalue("decoder"),
                "model_config_name_or_path": None,
            }
        if name == "train_dale":
            changes |= {"rating_head_steps": 5}
        mortals = []
        for folder in ("unbroken", "killed"):
            words = options_of_a_tiny_training("lctg", tmp_path / folder / "run", **changes)
            (tmp_path / folder).mkdir()
            mortals.append(Mortal(lives, name, words, tmp_path / folder / "run", seed))
        unbroken, killed = mortals
        whole = unbroken.finish()
        for life in range(2 * kills):  # some end before they are killed
            done = killed.hits.total() / kills
            if done == 1:
                break
            # the last third lives on to the end of the training
            phase = "result" if done >= 2 / 3 or killed.step == steps else aims[life % len(aims)]
            longest = {None: 0.5 + whole * 5 / steps, "checkpoint": 0.04, "rotation": 0.01, "result": 0.05}[phase]
            killed.kill(phase, longest)
        killed.finish()
        _assert_alike(killed.output, unbroken.output)
        print(f"{name}: killed {killed.hits.total()} times, in {dict(killed.hits)}; unbroken", f"{whole:.1f} s")
        return killed.hits

    return run


def test_a_training_that_is_killed_a_few_times(die_and_live):
    hits = die_and_live("train_lctg", kills=4, steps=6, aims=["checkpoint", "rotation"])
    assert hits["checkpoint"] or hits["rotation"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kills", "steps"), [("train_lctg", 56, 40), ("train_dale", 20, 24), ("distill", 18, 24)]
)
def test_a_training_that_is_killed_many_times(die_and_live, name, kills, steps):
    hits = die_and_live(name, kills, steps, aims=[None, "checkpoint", "rotation"])
    assert hits.total() >= kills and all(hits[phase] >= 2 for phase in PHASES)
