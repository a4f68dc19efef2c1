"""The command convert: files, losses, devices."""

import numpy as np
import pytest

from tactile_diffusers.cli.convert import main
from tactile_diffusers.export import read_texture, write_npz


@pytest.fixture
def source(tmp_path, pink_noise):
    common = {"sampling_rate": 10000, "friction_coefficient": 0.5, "ratings": [0, 0, 0], "seed": 3}
    write_npz(tmp_path / "a.npz", pink_noise(8000, 10000)[0], reference_speed=80.0, **common)
    return tmp_path / "a.npz"


def test_it_converts_and_says_what_was_lost(source, tmp_path, capsys):
    assert main(f"--input {source} --output {tmp_path / 'b.wav'}".split()) == 0
    assert "Nothing was lost." in capsys.readouterr().out
    assert main(f"--input {source} --output {tmp_path / 'b.png'} --pixel_pitch 0.1".split()) == 0
    assert "b.png holds" in capsys.readouterr().out
    assert read_texture(tmp_path / "b.png")[1]["pixel_pitch"] == 0.1


def test_a_device_is_told_of(source, tmp_path, capsys):
    device = tmp_path / "device.json"
    device.write_text('{"rate": 2000, "band": [40, 500], "one_signed": true, "bits": 8, "amplitude": 0.2}')
    assert main(f"--input {source} --device {device}".split()) == 0
    assert "| 647-1000 |" in capsys.readouterr().out
    assert main(f"--input {source} --output {tmp_path / 'b.haptic'} --device {device}".split()) == 0
    assert capsys.readouterr().out.count("\n| ") == 10 and (tmp_path / "b.haptic").is_file()


@pytest.mark.parametrize("words", ["", "--output b.mp3", "--device a.npz", "--output b.npz --pixel_pitch 0.1"])
def test_bad_requests_are_refused_with_one_line(source, words, capsys, monkeypatch):
    monkeypatch.chdir(source.parent)
    try:
        code = main(["--input", "a.npz", *words.split()])
    except SystemExit as stop:
        code = stop.code
    assert code == 2 and capsys.readouterr().err.splitlines()[-1].startswith("convert.py: error: ")
    assert [path.name for path in source.parent.iterdir()] == ["a.npz"]


def test_a_damaged_texture_is_named(tmp_path, capsys):
    (tmp_path / "a.hjif").write_bytes(np.arange(9).tobytes())
    assert main(["--input", str(tmp_path / "a.hjif"), "--output", str(tmp_path / "b.npz")]) == 2
    assert "a.hjif cannot be read" in capsys.readouterr().err
