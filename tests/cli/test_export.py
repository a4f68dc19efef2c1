"""The export command: what it takes, what it writes and what it prints."""

import numpy as np
import pytest
from dataset.shards import open_folder, write_shard

from tactile_diffusers.cli.export import main
from tactile_diffusers.export import FORMATS, read_npz, write_hdf5, write_npz, write_wav
from tactile_diffusers.signal import RATING_AXES

COMMON = {
    "sampling_rate": 10000,
    "friction_coefficient": 0.5,
    "reference_speed": 80.0,
    "ratings": [1.5, 0.0, -1.0],
    "seed": 3,
    "checkpoint": "virtual-surfaces",
}


@pytest.fixture
def texture(pink_noise):
    return pink_noise(4000, 10000)[0].astype(np.float32)


@pytest.fixture
def source(tmp_path, texture):
    (tmp_path / "in").mkdir()
    write_npz(tmp_path / "in" / "texture.npz", texture, **COMMON)
    return tmp_path / "in" / "texture.npz"


def _run(source, output, *more):
    return main(["--input", str(source), "--output", str(output), *more])


def test_every_format_is_written(source, tmp_path, capsys):
    assert _run(source, tmp_path / "out") == 0
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {f"texture{form.suffix}" for form in FORMATS.values()} | {
        "texture.wav.json",
        "texture.16bit.wav.json",
    }
    printed = capsys.readouterr()
    assert all(f"texture{form.suffix}: {form.kind}" in printed.out for form in FORMATS.values())
    assert printed.err.startswith("export.py: warning: texture.friction.png: Pixels 0.15 mm apart")


@pytest.mark.parametrize(("write", "suffix"), [(write_hdf5, ".h5"), (write_wav, ".wav"), (write_wav, ".16bit.wav")])
def test_other_files_are_taken(tmp_path, texture, write, suffix):
    (tmp_path / "in").mkdir()
    write(tmp_path / "in" / f"a{suffix}", texture, **COMMON)
    assert _run(tmp_path / "in" / f"a{suffix}", tmp_path / "out", "--formats", "npz") == 0
    found, metadata = read_npz(tmp_path / "out" / "a.npz")
    assert metadata["checkpoint"] == "virtual-surfaces" and metadata["reference_speed"] == 80
    np.testing.assert_allclose(found, texture, atol=np.abs(texture).max() * 2**-15)  # 16 bits


def test_folders_are_taken(source, tmp_path, texture, capsys):
    write_npz(source.with_name("more.npz"), texture, **COMMON)
    source.with_name("._more.npz").write_bytes(b"what a Mac puts beside a file on a stick")
    assert _run(source.parent, tmp_path / "out", "--formats", "haptic") == 0
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"texture.haptic", "more.haptic"}


@pytest.mark.parametrize("speed", [80.0, None])
def test_generated_sets_are_taken(tmp_path, texture, speed, capsys):
    settings = {"num_textures": 2, "textures_per_shard": 2, "sampling_rate": 10000, "reference_speed": speed}
    columns = {
        "texture": np.stack([texture, -texture]),
        "friction_coefficient": np.float32([0.5, np.nan]),
        **dict(zip(RATING_AXES, np.float32([[1, np.nan], [2, 0], [3, 1]]), strict=True)),
        "seed": np.array([10, 11]),
    }
    (shard,) = open_folder(tmp_path / "in", settings)
    about = {"checkpoint": "virtual-surfaces", "rating_axes": list(RATING_AXES)}
    write_shard(tmp_path / "in" / shard["file"], 2, settings, about, [columns])
    assert _run(tmp_path / "in", tmp_path / "out", "--formats", "npz") == 0
    found, metadata = read_npz(tmp_path / "out" / "texture-00001.npz")
    np.testing.assert_array_equal(found, -texture)
    np.testing.assert_array_equal(metadata["ratings"], [np.nan, 0, 1])
    assert metadata["seed"] == 11 and metadata["checkpoint"] == "virtual-surfaces"
    assert np.isnan(metadata["reference_speed"]) == (speed is None)
    assert (_run(tmp_path / "in", tmp_path / "out2", "--formats", "npz", "hjif-friction") == 0) == (speed is not None)
    if speed is None:
        assert "knows no reference speed, so hjif-friction cannot be written" in capsys.readouterr().err
        assert not (tmp_path / "out2").exists()


def test_options_reach_the_writer(source, tmp_path, capsys):
    options = ["--formats", "png", "--pixel_pitch", "0.036", "--height", "3", "--normal_force", "0.4"]
    assert _run(source, tmp_path / "out", *options) == 0
    _, metadata = FORMATS["png"].read(tmp_path / "out" / "texture.friction.png")
    assert metadata["pixel_pitch"] == 0.036 and metadata["normal_force"] == 0.4
    assert capsys.readouterr().err == ""  # nothing is lost


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--pixel_pitch", "0"], "argument --pixel_pitch: must be above zero, got 0"),
        (["--normal_force", "nan"], "argument --normal_force: must be above zero, got nan"),
        (["--input", "nowhere.npz"], "argument --input: nowhere.npz does not exist"),
    ],
)
def test_bad_arguments_are_refused_with_one_line(source, tmp_path, capsys, arguments, message):
    with pytest.raises(SystemExit) as stop:
        _run(source, tmp_path / "out", *arguments)
    assert stop.value.code == 2 and message in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "out").exists()


def test_what_is_read_is_never_replaced(source, capsys):
    before = source.read_bytes()
    for given in (source, source.parent):
        with pytest.raises(SystemExit):
            _run(given, source.parent)
        assert "is where --input lies; give another folder" in capsys.readouterr().err
    assert source.read_bytes() == before and len(list(source.parent.iterdir())) == 1


@pytest.mark.parametrize("name", ["a.txt", "empty", "a.npz"])
def test_what_holds_no_texture_is_refused(tmp_path, capsys, name):
    (tmp_path / "empty").mkdir()
    (tmp_path / "a.txt").write_text("x")
    (tmp_path / "a.npz").write_text("x")
    assert _run(tmp_path / name, tmp_path / "out") == 2
    assert capsys.readouterr().err.startswith("export.py: error: ")
    assert not (tmp_path / "out").exists()
