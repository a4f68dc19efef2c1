"""What a device loses of a texture: each limit shows where it should, and is blamed."""

import json

import numpy as np
import pytest

from tactile_diffusers.export import DeviceProfile, what_is_lost
from tactile_diffusers.signal import DEVICE_RATE, SEGMENT_SAMPLES

GOOD = {"rate": 10_000, "band": (10, 2000), "bits": 24, "amplitude": 1.0}


@pytest.fixture
def texture(pink_noise):
    return pink_noise(SEGMENT_SAMPLES, DEVICE_RATE)[0]


def _lost(texture, **changes):
    return what_is_lost(texture, DEVICE_RATE, DeviceProfile(**{**GOOD, **changes}))


def test_a_good_device_loses_nothing(texture):
    loss = _lost(texture)
    assert [band.cause for band in loss.bands] == [""] * 9 and loss.clipped == 0
    assert max(abs(band.change_db) for band in loss.bands) < 0.01
    assert loss.fitting_scale == pytest.approx(1 / np.abs(texture).max(), rel=0.01)


@pytest.mark.parametrize(("change", "cause"), [({"rate": 800}, "rate"), ({"band": (10, 380)}, "band")])
def test_high_bands_are_lost(texture, change, cause):
    bands = _lost(texture, **change).bands
    assert [band.cause for band in bands] == [""] * 6 + [bands[6].cause, cause, cause]
    assert bands[-1].change_db < -20 and bands[-1].snr_db < 1 and bands[5].snr_db > 20


def test_few_bits_drown_weak_bands(texture):
    bands = _lost(texture, bits=6).bands
    assert bands[-1].cause == "bits" and bands[-1].snr_db < bands[0].snr_db - 10


def test_clipping_is_counted_and_a_device_of_one_sign_has_half(texture):
    peak = np.abs(texture).max()
    both, one = (_lost(texture, amplitude=0.8 * peak, one_signed=sign) for sign in (False, True))
    assert 0 < both.clipped < one.clipped and one.fitting_scale == pytest.approx(0.4, rel=0.01)
    assert both.fitting_scale == pytest.approx(0.8, rel=0.01)
    assert "amplitude" in {band.cause for band in one.bands}
    assert str(one).count("\n") == 12 and "% clipped" in str(one)


def test_silence_has_room(texture):
    assert _lost(0 * texture).fitting_scale == np.inf


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate": 30}, "`rate` must be"),
        ({"band": 5}, "`band` must be two frequencies"),
        ({"band": (500, 100)}, r"`band\[1\]` must be"),
        ({"bits": 1}, "`bits` must be"),
        ({"amplitude": 0}, "`amplitude` must be"),
        ({"one_signed": "yes"}, "`one_signed` must be"),
    ],
)
def test_no_such_device(change, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        DeviceProfile(**{**GOOD, **change})
    (tmp_path / "device.json").write_text(json.dumps({**GOOD, **change}))
    with pytest.raises(ValueError, match="device.json cannot be read as a device profile"):
        DeviceProfile.load(tmp_path / "device.json")


def test_files(tmp_path):
    path = tmp_path / "device.json"
    path.write_text(json.dumps(GOOD))
    assert DeviceProfile.load(path) == DeviceProfile(**GOOD)
    path.write_text(json.dumps({**GOOD, "colour": 1}))
    with pytest.raises(ValueError, match=r"unknown entries \['colour'\]"):
        DeviceProfile.load(path)


def test_bad_textures_are_refused(texture):
    with pytest.raises(ValueError, match="too short"):
        _lost(texture[:200])
    with pytest.raises(ValueError, match="`device` must be a DeviceProfile"):
        what_is_lost(texture, DEVICE_RATE, GOOD)
