"""Commands that go on where they were stopped, killed at random moments, write what unbroken ones do."""

import signal
import time
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
SURFACES = 30


@pytest.fixture
def killed_and_not(lives, tmp_path):
    """`killed_and_not(script, words, kills)` runs a command unbroken, and killed so often, each in a folder of its own.

    `words(folder)` is its command line. Returns both folders.
    """

    def run(script, words, kills, seed=0):
        folders = [tmp_path / name for name in ("unbroken", "killed")]
        for folder in folders:
            folder.mkdir()
        log, rng = tmp_path / "log", np.random.default_rng(seed)

        def live(folder, longest=None):
            lives.start(EXAMPLES / script, words(folder), log)
            if longest is not None and not lives.ended(rng.uniform(0, longest)):
                lives.kill()
            return lives.wait()

        began = time.monotonic()
        assert live(folders[0]) == 0, log.read_text()[-3000:]
        seconds, codes = time.monotonic() - began, []
        while codes.count(-signal.SIGKILL) < kills:  # each life gets further, so that later ones may end by themselves
            codes.append(live(folders[1], seconds * (1 if len(codes) % 2 else 0.3)))
            assert codes[-1] in (0, -signal.SIGKILL), log.read_text()[-3000:]
            assert len(codes) < 10 * kills
        assert live(folders[1]) == 0, log.read_text()[-3000:]
        print(f"{script}: killed {kills} times in {len(codes)} lives; unbroken {seconds:.1f} s")
        return folders

    return run


def _files(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.slow
def test_many_textures(killed_and_not, make_pipeline, rating_statistics, tmp_path):
    make_pipeline(dale_config={"rating_statistics": rating_statistics}).save_pretrained(str(tmp_path / "pipeline"))
    options = {"checkpoint": tmp_path / "pipeline", "num_textures": 40, "textures_per_shard": 4, "batch_size": 2}
    options |= {"num_inference_steps": 5, "seed": 5}
    words = [f"--{name}={value}" for name, value in options.items()] + ["--quiet"]
    unbroken, killed = killed_and_not("generate_dataset.py", lambda folder: [*words, f"--output={folder}/out"], 8)
    assert _files(killed) == _files(unbroken)


@pytest.mark.slow
def test_recordings_and_what_is_prepared_of_them(killed_and_not):
    def words(folder):
        files = [f"--output={folder}/recordings.h5", f"--prepared={folder}/prepared.h5", "--quiet"]
        return [f"--surfaces={SURFACES}", "--seconds=4", "--explorers=1", *files]

    unbroken, killed = killed_and_not("prepare_data.py", words, 10)
    assert _files(killed) == _files(unbroken)
