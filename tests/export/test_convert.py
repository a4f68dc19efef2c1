"""From any format to any other, with the losses said."""

import numpy as np
import pytest

from tactile_diffusers.export import FORMATS, convert, format_of, read_texture, write_npz
from tactile_diffusers.signal import DEVICE_RATE

COMMON = {
    "sampling_rate": DEVICE_RATE,
    "friction_coefficient": 0.62,
    "reference_speed": 80.5,
    "ratings": [1.5, float("nan"), -1.0],
    "seed": 7,
    "checkpoint": "virtual-surfaces",
}


@pytest.fixture
def source(tmp_path, pink_noise):
    write_npz(tmp_path / "a.npz", pink_noise(4000, DEVICE_RATE)[0], **COMMON)
    return tmp_path / "a.npz"


@pytest.mark.parametrize("first", FORMATS)
@pytest.mark.parametrize("second", ["npz", "png", "hjif", "ahap"])
def test_all_formats_to_others(source, tmp_path, first, second):
    one, two = (tmp_path / f"{name}{FORMATS[form].suffix}" for name, form in (("b", first), ("c", second)))
    told = convert(source, one)
    assert bool(told["losses"]) == (FORMATS[first].kind != "lossless") and told["format"] == first
    again = convert(one, two)
    assert again["source_format"] == first
    early = any(text.startswith(one.name) for text in again["losses"])
    assert early == (FORMATS[first].kind != "lossless")
    texture, metadata = read_texture(two)
    assert len(texture) == 4000 and metadata["seed"] == 7 and metadata["checkpoint"] == "virtual-surfaces"
    np.testing.assert_allclose(metadata["ratings"], COMMON["ratings"])


def test_what_the_source_had_lost_is_not_charged_to_the_target(source, tmp_path):
    convert(source, tmp_path / "b.friction.png")
    told = convert(tmp_path / "b.friction.png", tmp_path / "c.hjif")
    assert told["bands"] < 9 and told["nine_band_error_db"] < 0.05
    assert "nothing above 2" in told["losses"][0]  # some 240 Hz at 80.5 mm/s and 0.15 mm


def test_a_map_goes_on_with_the_force_that_it_was_recorded_at(source, tmp_path):
    convert(source, tmp_path / "b.friction.hjif", normal_force=1.0)
    for name in ("c.friction.hjif", "c.friction.png"):
        convert(tmp_path / "b.friction.hjif", tmp_path / name)
        assert read_texture(tmp_path / name)[1]["normal_force"] == 1.0


@pytest.mark.parametrize("name", FORMATS)
def test_a_recorded_texture_has_no_seed(tmp_path, pink_noise, name):
    path = tmp_path / f"a{FORMATS[name].suffix}"
    FORMATS[name].write(path, pink_noise(4000, DEVICE_RATE)[0], **COMMON | {"seed": None})
    assert read_texture(path)[1]["seed"] is None


def test_formats_by_suffix(tmp_path):
    assert format_of("a.16bit.wav") == "wav16" and format_of("a.wav") == "wav"
    assert format_of("a.png") == format_of("a.friction.png") == "png"
    assert format_of("a.texture.hjif") == "hjif-texture" and format_of("a.hjif") == "hjif"
    with pytest.raises(ValueError, match=r"a.mp3 must end in one of \.npz"):
        format_of("a.mp3")


def test_bad_requests_write_nothing(source, tmp_path, pink_noise):
    write_npz(tmp_path / "unknown.npz", pink_noise(4000, DEVICE_RATE)[0], **{**COMMON, "reference_speed": np.nan})
    before = sorted(path.name for path in tmp_path.iterdir())
    for first, second, options, error, message in (
        (source, source, {}, ValueError, "`target` must be another file"),
        (source, tmp_path / "b.txt", {}, ValueError, "must end in one of"),
        (source, tmp_path / "b.npz", {"pixel_pitch": 0.1}, ValueError, "`pixel_pitch` is no option of npz"),
        (source, tmp_path / "nowhere" / "b.npz", {}, FileNotFoundError, "nowhere"),
        (tmp_path / "c.npz", tmp_path / "b.npz", {}, FileNotFoundError, "c.npz"),
        (tmp_path / "unknown.npz", tmp_path / "b.png", {}, ValueError, "`reference_speed` is unknown"),
    ):
        with pytest.raises(error, match=message):
            convert(first, second, **options)
    assert sorted(path.name for path in tmp_path.iterdir()) == before
