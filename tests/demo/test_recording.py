"""Uploads: bytes to textures, and what is refused."""

import io

import numpy as np
import pytest
import soundfile
from uploads import LONGEST_SECONDS, read_upload

from tactile_diffusers.signal import band_pass

RATE = 5000


@pytest.fixture
def force(pink_noise):
    return pink_noise(RATE, RATE)[0]


def _wav(samples, rate=RATE, subtype="FLOAT"):
    file = io.BytesIO()
    soundfile.write(file, samples, rate, format="WAV", subtype=subtype)
    return file.getvalue()


def _csv(force, delimiter=",", header="", times=None):
    times = np.arange(len(force)) / RATE if times is None else times
    rows = (f"{time:.6f}{delimiter}{value:.9f}" for time, value in zip(times, force, strict=True))
    return (header + "\n".join(rows)).encode()


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("header", ["", "time,force\n", "# from somewhere\n", "\ufeff"])
def test_a_table_gives_its_force_and_rate(force, delimiter, header):
    found, rate = read_upload(_csv(force, delimiter, header.replace(",", delimiter)), 0)
    assert rate == RATE
    np.testing.assert_allclose(found, band_pass(force, RATE), atol=1e-8)


def test_one_column_needs_a_rate(force):
    content = "\r\n".join(f"{value:.9f}" for value in force).encode()
    found, rate = read_upload(content, RATE, newtons_per_unit=2.0)
    assert rate == RATE
    np.testing.assert_allclose(found, 2 * band_pass(force, RATE), atol=1e-8)
    with pytest.raises(ValueError, match="sampling rate"):
        read_upload(content, 0)


def test_wav_of_several_channels_gives_the_first_of_its_beginning(force):
    long = np.tile(force, 11)
    found, rate = read_upload(_wav(np.stack([long, 0 * long], axis=1)), 0)
    assert rate == RATE and len(found) == LONGEST_SECONDS * RATE
    np.testing.assert_allclose(found, band_pass(long[: len(found)], RATE), atol=1e-6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty"),
        (b"RIFF and then nothing", "cannot be read"),
        (b"\x89PNG\r\n\x1a\n\x00\xff", "neither WAV nor"),
        (b"<html>no table</html>", "neither WAV nor"),
        (b"time,force\n" + b"0.0,abc\n" * 9, "Row"),
        (b"0.0,0.1\n0.0002,nan\n", "Row 2"),
        (b"0.0,0.1\n0.0002,0.1\n", "0.2 s"),
        (b"0.1,0.1\n0.0,0.2\n0.2,0.1\n", "ascending"),
    ],
)
def test_what_is_no_recording_is_refused_in_words(content, message):
    with pytest.raises(ValueError, match=message):
        read_upload(content, RATE)


def test_gaps_silence_rates_and_scales_are_refused(force):
    times = np.arange(len(force)) / RATE
    times[len(force) // 2 :] += 0.1
    for content, options, message in (
        (_csv(force, times=times), {}, "equal steps"),
        (_wav(0 * force), {}, "constant"),
        (_wav(np.where(np.arange(len(force)) == 7, np.nan, force)), {}, "finite"),
        (_wav(force, rate=1000), {}, "1000"),
        (_wav(force, rate=400_000), {}, "400000"),
        (_wav(np.tile(force[:2000, None], 9)), {}, "9 channels"),
        (_wav(force), {"newtons_per_unit": 0}, "Newtons per unit"),
    ):
        with pytest.raises(ValueError, match=message):
            read_upload(content, RATE, **options)


def test_damaged_files_are_refused_never_a_crash(force):
    rng = np.random.default_rng(0)
    for content in (_wav(force[:2000]), _csv(force[:200]), _csv(force[:200], ";", "time;force\n")):
        for _ in range(60):
            damaged = bytearray(content[: rng.integers(1, len(content) + 1)])
            for place in rng.integers(0, min(len(damaged), 100), 4):
                damaged[place] = rng.integers(256)
            try:
                found, rate = read_upload(bytes(damaged), RATE)
            except ValueError as refused:
                assert str(refused)
            else:
                assert np.isfinite(found).all() and len(found) <= LONGEST_SECONDS * rate
