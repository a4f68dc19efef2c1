"""The benchmark of long textures: a repeat and a louder overlap are found, and the command writes both files."""

import json

import long_textures
import numpy as np
import pytest
from long_textures import evenness, largest_correlation, overlap_mask

from tactile_diffusers.signal import DEVICE_RATE


def test_a_repeat_is_found_and_noise_does_not_repeat():
    noise = np.random.default_rng(0).normal(size=3 * 1000)
    repeated = np.concatenate([noise, noise])
    assert largest_correlation(repeated, repeated, 1000) == pytest.approx(1, abs=1e-6)
    # 1,000 independent samples: a correlation has a standard deviation of 0.032, and 10,000 of them stay below five
    assert largest_correlation(noise, noise, 1000) < 0.16
    assert largest_correlation(noise, noise[::-1], 1000) < 0.16


def test_louder_overlaps_are_found(evaluable_pipe):
    pipe = evaluable_pipe()
    inside = overlap_mask(pipe, 5 * DEVICE_RATE, DEVICE_RATE)
    assert 0 < inside.mean() < 1

    class Louder:
        lctg, dale, feature_extractor = pipe.lctg, pipe.dale, pipe.feature_extractor

        def __call__(self, ratings, **_):
            noise = np.random.default_rng(0).normal(size=(len(ratings), len(inside)))
            return type("Out", (), {"textures": noise * np.where(inside, 2, 1), "sampling_rate": DEVICE_RATE})

    found = evenness(Louder(), 2, 5.0, 0)
    # twice as loud is 6.02 dB; frames of a tenth of a second of noise leave a few tenths
    assert found["overlap_db"] == pytest.approx(6.02, abs=0.2)
    assert found["itself"] < 0.1 and found["another"] < 0.1


def test_the_command_writes_its_files(evaluable_pipe, tmp_path):
    evaluable_pipe().save_pretrained(str(tmp_path / "pipeline"))
    words = f"--checkpoint {tmp_path / 'pipeline'} --textures 2 --duration_s 4 --quiet --output {tmp_path / 'out'}"
    assert long_textures.main(words.split()) == 0
    found = json.loads((tmp_path / "out/long_textures.json").read_text())
    assert all(np.isfinite(found[name]) for name in long_textures.LABELS)
    assert "dB" in (tmp_path / "out/long_textures.md").read_text()
