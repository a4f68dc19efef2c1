"""Friction maps: what a pixel means, and what pixels lose."""

import json
import warnings

import numpy as np
import pytest
from PIL import Image

from tactile_diffusers.export import read_png, write_png
from tactile_diffusers.signal import DEVICE_RATE, SEGMENT_SAMPLES, band_levels_db

COMMON = {"sampling_rate": DEVICE_RATE, "friction_coefficient": 0.6, "reference_speed": 80.0, "ratings": [0, 0, 0]}
COMMON["seed"] = 0


@pytest.fixture
def texture(pink_noise):
    return pink_noise(SEGMENT_SAMPLES, DEVICE_RATE)[0]


def test_grey_is_friction_over_position(tmp_path):
    """A grating of 2 mm at 80 mm/s is 40 Hz; at 0.1 mm a pixel it has 20 pixels a period."""
    texture = 0.05 * np.cos(2 * np.pi * 40 * np.arange(10000) / DEVICE_RATE)
    with pytest.warns(UserWarning, match="360-1000 Hz is lost, 0.0 %"):
        write_png(tmp_path / "a.png", texture, **COMMON, pixel_pitch=0.1, height=5, normal_force=0.25)
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.mode == "L" and picture.size == (800, 5)
        # 8 significant digits: pixels per metre are a whole number in the file
        assert picture.info["dpi"][0] == pytest.approx(254, rel=1e-4)
        rows, chunk = np.asarray(picture), json.loads(picture.text["tactile_diffusers"])
    assert (rows == rows[0]).all() and rows.min() == 0 and rows.max() == 255
    friction = chunk["friction_at_zero"] + rows[0] * chunk["friction_per_count"]
    expected = 0.6 + 0.05 / 0.25 * np.cos(2 * np.pi * np.arange(800) * 0.1 / 2)
    np.testing.assert_allclose(friction[10:-10], expected[10:-10], atol=0.6 * chunk["friction_per_count"])


def test_coarse_pixels_warn_of_what_is_lost(tmp_path, texture):
    message = "Pixels 0.15 mm apart hold what is felt below 240 Hz at 80 mm/s: 240-1000 Hz is lost, .* % of the"
    with pytest.warns(UserWarning, match=message) as caught:
        write_png(tmp_path / "a.png", texture, **COMMON)
    assert "Only a display with pixels of at most 0.036 mm would hold all" in str(caught[0].message)
    found, metadata = read_png(tmp_path / "a.png")
    assert metadata["highest_frequency"] == pytest.approx(240)
    edges = np.array([25.0, 50, 100, 200, 300, 500, 900])
    error = band_levels_db(found, DEVICE_RATE, edges) - band_levels_db(texture, DEVICE_RATE, edges)
    # 8 bits: the highest band that is held is some 20 dB above the rounding
    assert np.abs(error[:3]).max() < 0.1 and (error[4:] < -20).all()


@pytest.mark.parametrize("pitch", (0.15, 0.6))
def test_the_ends_of_a_coarse_map_are_like_the_rest(tmp_path, texture, pitch):
    """The outermost pixels are low-passed too: kept as they were, they take the whole range of grey."""
    with pytest.warns(UserWarning, match="is lost"):
        write_png(tmp_path / "a.png", texture + 0.05 * (-1) ** np.arange(len(texture)), **COMMON, pixel_pitch=pitch)
    with Image.open(tmp_path / "a.png") as picture:
        row = np.asarray(picture)[0].astype(float)
    inner = row[2:-2]
    for end in (row[0], row[-1]):
        assert abs(end - inner.mean()) < 4 * inner.std()
    assert inner.max() - inner.min() > 200


@pytest.mark.parametrize(("hertz", "lost"), [((100, 700), "50.0 %"), ((700,), "100.0 %")])
def test_the_loss_is_the_power_that_is_missing(tmp_path, hertz, lost):
    seconds = np.arange(20000) / DEVICE_RATE
    with pytest.warns(UserWarning, match=f"is lost, {lost} of the texture's power"):
        write_png(tmp_path / "a.png", sum(0.01 * np.sin(2 * np.pi * f * seconds) for f in hertz), **COMMON)


def test_fine_pixels_and_silence_do_not_warn(tmp_path, texture):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_png(tmp_path / "a.png", texture, **COMMON, pixel_pitch=0.036)
        write_png(tmp_path / "b.png", np.zeros(1000), **COMMON | {"friction_coefficient": float("nan")})
    assert read_png(tmp_path / "a.png")[1]["friction_coefficient"] == 0.6
    assert read_png(tmp_path / "b.png")[1]["friction_at_zero"] == 0  # unknown: a map about zero


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pixel_pitch": float("nan")}, "`pixel_pitch` must be a finite number above 0 in mm, got nan"),
        ({"pixel_pitch": 5.0}, "leaves nothing of a texture, .* it must be below 1.8 mm"),  # no display has these
        ({"pixel_pitch": 1e-4}, "makes a picture of .* columns"),
        ({"normal_force": -0.5}, "`normal_force` must be a finite number above 0 in N"),
        ({"height": 0}, "`height` must be a whole number of at least 1, got 0"),
        ({"height": 100_000}, "`height` of 100000 rows makes a picture of .* pixels; at most 67108864"),
    ],
)
def test_bad_options_are_refused(tmp_path, texture, change, message):
    with pytest.raises(ValueError, match=message):
        write_png(tmp_path / "a.png", texture, **COMMON, **change)
    assert not list(tmp_path.iterdir())
