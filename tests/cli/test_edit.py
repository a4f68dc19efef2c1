"""`tactile-diffusers edit`, `continue` and `loop`: a recording in, what is made of it out."""

import numpy as np
import pytest

from tactile_diffusers.cli import edit
from tactile_diffusers.export import write_npz, write_wav
from tactile_diffusers.export.lossless import read_npz
from tactile_diffusers.signal import DEVICE_RATE, band_pass, rms


@pytest.fixture
def recording(pink_noise, tmp_path):
    texture = pink_noise(8192, DEVICE_RATE)[0]
    path = tmp_path / "recording.npy"
    np.save(path, texture)
    return path, band_pass(texture - texture.mean(), DEVICE_RATE).astype(np.float32)


def _words(path, *words):
    return [str(path), "--rate", str(DEVICE_RATE), "--output", str(path.parent / "out"), *map(str, words)]


def _made(path, name):
    assert {file.name for file in (path.parent / "out").iterdir()} == {
        *(f"{name}.npz", f"{name}.wav", f"{name}.png"),
        *(file.name for file in (path.parent / "out").glob("*.json")),
    }
    return read_npz(path.parent / "out" / f"{name}.npz")


def test_a_recording_made_more_slippery(recording, capsys):
    path, texture = recording
    words = ["--slipperiness", 0.5, "--source_ratings", 0.1, 0.2, 0.3, "--friction_coefficient", 0.6, "--strength", 0.6]
    assert edit.main(_words(path, *words)) == 0
    made, metadata = _made(path, "edited")
    assert made.shape == (8192,) and 0 < metadata["friction_coefficient"] < 0.6  # slippery = less friction
    np.testing.assert_allclose(metadata["ratings"], [0.1, 0.2, 0.8], rtol=1e-6)  # float32
    assert 0.3 < (made * texture).mean() / rms(made) / rms(texture) < 0.95
    assert "ratings of the recording: roughness +0.10" in capsys.readouterr().out


def test_an_axis_that_an_adapted_checkpoint_knows_besides(recording, make_pipeline, tmp_path, capsys):
    path, _ = recording
    axes = ["roughness", "bumpiness", "slipperiness", "fineness"]
    make_pipeline(dale_config={"rating_axes": axes}).save_pretrained(tmp_path / "adapted")
    words = ["--rating", "fineness", 0.5, "--checkpoint", tmp_path / "adapted", "--source_ratings", 0.1, 0.2, 0.3]
    assert edit.main(_words(path, *words)) == 2
    assert "own rating of fineness: give `source_ratings`" in capsys.readouterr().err
    assert edit.main(_words(path, *words, -0.4)) == 0
    np.testing.assert_allclose(_made(path, "edited")[1]["ratings"], [0.1, 0.2, 0.3, 0.1], rtol=1e-6)
    assert "fineness -0.40" in capsys.readouterr().out
    assert edit.main(_words(path, *words, -0.4, 1.0)) == 2
    assert "the checkpoint has 4 axes" in capsys.readouterr().err


def test_stretches_made_anew(recording, capsys):
    path, texture = recording
    assert edit.main(_words(path, "--mask", 0.3, 0.35, "--mask", 0.5, 0.52, "--quiet")) == 0
    made, metadata = _made(path, "edited")
    changed = made != texture
    assert changed[3000:3500].mean() > 0.99 and changed[5000:5200].mean() > 0.99
    assert changed.sum() <= 700 and not capsys.readouterr().out and np.isnan(metadata["ratings"]).all()


def test_what_is_saturated_is_repaired(recording, capsys):
    path, texture = recording
    force, limit = np.load(path), 0.02
    force[4000:4100] = limit
    force = force.clip(-1, limit)
    np.save(path, force)
    assert edit.main(_words(path, "--repair", "--quiet")) == 0
    made, _ = _made(path, "edited")
    filtered = band_pass(force - force.mean(), DEVICE_RATE).astype(np.float32)
    changed = np.flatnonzero(made != filtered)
    assert {*range(4000, 4100)} <= {*changed.tolist()} and len(changed) < 0.2 * len(made)
    np.save(path, texture)
    assert edit.main(_words(path, "--repair")) == 2
    assert "nothing of" in capsys.readouterr().err


def test_longer_and_closed(recording):
    path, texture = recording
    assert edit.lengthen(_words(path, "--seconds", 0.3, "--quiet")) == 0
    made, _ = _made(path, "continued")
    assert len(made) == 8192 + 3000
    np.testing.assert_array_equal(made[:8192], texture)
    for file in (path.parent / "out").iterdir():
        file.unlink()
    assert edit.loop(_words(path, "--quiet")) == 0
    made, _ = _made(path, "loop")
    np.testing.assert_array_equal(made[1000:-1000], texture[1000:-1000])
    assert abs(made[0] - made[-1]) < np.abs(np.diff(texture)).max()


@pytest.mark.parametrize(
    "words, message",
    [
        ((), "give either"),
        (("--mask", 0.1, 0.2, "--roughness", 0.5), "give either"),
        (("--roughness", 0.5, "--strength", 2), "`strength`"),
        (("--mask", 0.1, 20), "`mask`"),
        (("--roughness", 50), "`ratings`"),
    ],
)
def test_impossible_words_are_refused(recording, words, message, capsys):
    path, _ = recording
    try:
        code = edit.main(_words(path, *words))
    except SystemExit as stop:
        code = stop.code
    assert code == 2 and message in capsys.readouterr().err and not (path.parent / "out").exists()


@pytest.mark.parametrize("suffix", [".npz", ".wav"])
def test_a_texture_of_this_package_is_read_with_its_friction(recording, tmp_path, suffix):
    path, texture = recording
    own = tmp_path / f"texture{suffix}"
    about = {"sampling_rate": DEVICE_RATE, "friction_coefficient": 0.6, "ratings": [0.1, 0.2, 0.3], "seed": 0}
    {".npz": write_npz, ".wav": write_wav}[suffix](own, texture, **about)
    words = [str(own), "--output", str(path.parent / "out"), "--strength", "0", "--roughness", "0.5", "--quiet"]
    assert edit.main(words) == 0
    made, metadata = _made(path, "edited")
    assert metadata["friction_coefficient"] == pytest.approx(0.6) and (made * texture).mean() > 0


def test_another_archive_of_arrays_is_a_table(recording, tmp_path, capsys):
    other = tmp_path / "other.npz"
    np.savez(other, texture=recording[1], ratings=np.zeros(3))
    assert edit.main([str(other), "--output", str(tmp_path / "out"), "--roughness", "1"]) == 2
    assert "`column`" in capsys.readouterr().err
