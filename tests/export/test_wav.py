"""WAV files: numbers times the sidecar's scale are newtons."""

import json

import numpy as np
import pytest
import soundfile

from tactile_diffusers.export import read_wav, write_wav

COMMON = {"sampling_rate": 10000, "friction_coefficient": 0.62, "ratings": [1.5, float("nan"), -1.0], "seed": 7}


@pytest.fixture
def texture():
    return 0.009 * np.random.default_rng(0).normal(size=4000)


@pytest.mark.parametrize(
    ("subtype", "tolerance"),
    [("PCM_16", 1.01 * 2**-16), ("FLOAT", 2**-23)],  # half a count, or float32, of full scale
)
def test_numbers_times_scale_are_newtons(tmp_path, texture, subtype, tolerance):
    write_wav(tmp_path / "a.wav", texture, subtype=subtype, **COMMON)
    read, metadata = read_wav(tmp_path / "a.wav")
    scale = metadata["newtons_per_full_scale"]
    np.testing.assert_allclose(read, texture, rtol=0, atol=tolerance * scale)
    samples, rate = soundfile.read(tmp_path / "a.wav")
    assert rate == 10000 and soundfile.info(tmp_path / "a.wav").subtype == subtype
    assert 0.9999 < np.abs(samples).max() <= 1
    np.testing.assert_allclose(samples * scale, texture, rtol=0, atol=tolerance * scale)


def test_sidecar_is_standard_json(tmp_path, texture):
    write_wav(tmp_path / "a.wav", texture, **{**COMMON, "friction_coefficient": float("nan")})

    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    sidecar = json.loads((tmp_path / "a.wav.json").read_text(encoding="utf-8"), parse_constant=refuse)
    assert sidecar["ratings"] == [1.5, None, -1.0] and sidecar["friction_coefficient"] is None
    assert sidecar["unit"] == "N"


def test_files_that_belong_together_share_a_scale(tmp_path, texture):
    """Players that ignore sidecars then keep the levels."""
    for name, gain in (("loud", 1.0), ("quiet", 0.5)):
        write_wav(tmp_path / f"{name}.wav", gain * texture, full_scale=2 * np.abs(texture).max(), **COMMON)
    loud, quiet = (soundfile.read(tmp_path / f"{name}.wav")[0] for name in ("loud", "quiet"))
    np.testing.assert_allclose(quiet, 0.5 * loud, atol=2**-15)  # half a count of 16 bits each


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"subtype": "PCM_24"}, "`subtype` must be .*got 'PCM_24'"),
        ({"full_scale": 0.0}, "`full_scale` must be a finite number above 0 in N"),
        ({"full_scale": 0.001}, "would be clipped"),
    ],
)
def test_bad_options_are_refused(tmp_path, texture, change, message):
    with pytest.raises(ValueError, match=message):
        write_wav(tmp_path / "a.wav", texture, **COMMON, **change)
    assert not list(tmp_path.iterdir())


def test_a_file_without_its_sidecar_is_refused(tmp_path, texture):
    write_wav(tmp_path / "a.wav", texture, **COMMON)
    sidecar = tmp_path / "a.wav.json"
    metadata = json.loads(sidecar.read_text())
    sidecar.write_text(json.dumps({**metadata, "sampling_rate": 8000}))
    with pytest.raises(ValueError, match="10000 Hz, but its sidecar says 8000 Hz"):
        read_wav(tmp_path / "a.wav")
    del metadata["newtons_per_full_scale"]
    sidecar.write_text(json.dumps(metadata))
    with pytest.raises(ValueError, match="lacks newtons_per_full_scale"):
        read_wav(tmp_path / "a.wav")
    sidecar.unlink()
    with pytest.raises(FileNotFoundError, match=r"a\.wav\.json, which holds the scale"):
        read_wav(tmp_path / "a.wav")
