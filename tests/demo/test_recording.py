"""Uploads: files to textures through the package's reader, and what is refused."""

import numpy as np
import pytest
import soundfile
from uploads import LONGEST_SECONDS, columns_of, read_upload

from tactile_diffusers.signal import band_pass

RATE = 5000


@pytest.fixture
def force(pink_noise):
    return pink_noise(RATE, RATE)[0]


def test_a_table_gives_its_columns_force_rate_and_unit(force, tmp_path):
    path = tmp_path / "a.csv"
    rows = (f"{n / RATE:.6f},{1e3 * one:.6f},{-one:.9f}" for n, one in enumerate(force))
    path.write_text("t_s,Fx_mN,Fy_N\n" + "\n".join(rows))
    assert columns_of(path) == ["t_s", "Fx_mN", "Fy_N"]
    for column, sign in (("Fx_mN", 1), ("Fy_N", -1)):
        found, rate, _ = read_upload(path, column)
        assert rate == RATE
        np.testing.assert_allclose(found, sign * band_pass(force - force.mean(), RATE), atol=1e-8)
    with pytest.raises(ValueError, match="several columns") as refused:
        read_upload(path)
    assert str(tmp_path) not in str(refused.value) and "--" not in str(refused.value)


def test_one_column_needs_a_rate_and_gaps_are_told(force, tmp_path):
    path, missing = tmp_path / "a.csv", [f"{one:.9f}" for one in force]
    missing[2000:2050] = ["nan"] * 50
    path.write_text("\n".join(missing))
    found, rate, notes = read_upload(path, None, RATE, 2.0)
    assert len(found) == len(force) and any("50 samples that are missing or no number are bridged" in n for n in notes)
    with pytest.raises(ValueError, match="sampling rate"):
        read_upload(path)
    np.testing.assert_array_equal(read_upload(path, None, RATE, None)[0], found / 2)  # an emptied field is none
    path.unlink()
    with pytest.raises(ValueError, match="no longer here"):
        read_upload(path, None, RATE)


def test_wav_of_several_channels_gives_the_first_that_moves_of_its_beginning(force, tmp_path):
    long = np.tile(force, 11)
    soundfile.write(tmp_path / "a.wav", np.stack([0 * long, long, long[::-1]], axis=1), RATE, subtype="FLOAT")
    found, rate, notes = read_upload(tmp_path / "a.wav")
    assert "channel 1 of 0, 1, 2 is used" in notes[0] and "the first 10 s of 11 s are used" in notes
    long = long[: int(LONGEST_SECONDS * RATE)]
    assert rate == RATE
    np.testing.assert_allclose(found, band_pass(long - long.mean(), RATE), atol=1e-6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty"),
        (b"\x89PNG\r\n\x1a\n\x00\xff", "zero bytes"),
        (b"time,force\n" + b"0.0,abc\n" * 9, "has several columns|holds no number"),
        (b"1.0\n" * 9000, "constant"),
        ((",".join(f"c{n}" for n in range(65)) + "\n" + ",".join("1" * 65)).encode(), "65 columns"),
    ],
)
def test_what_is_no_recording_is_refused_in_words(tmp_path, content, message):
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(ValueError, match=message) as refused:
        read_upload(tmp_path / "a.csv", None, RATE)
    assert str(tmp_path) not in str(refused.value) and "--" not in str(refused.value)
