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


@pytest.mark.parametrize(
    ("delimiter", "header", "newtons"),
    [
        (",", "time,force\n", 1),
        (";", "", 1),
        ("\t", "# from somewhere\n", 1),
        (",", "\ufefftime_s,Fx_mN\n", 1e-3),  # the unit in the name counts
    ],
)
def test_a_table_gives_its_force_and_rate(force, delimiter, header, newtons):
    found, rate, _ = read_upload(_csv(force, delimiter, header), 0)
    assert rate == RATE
    np.testing.assert_allclose(found, band_pass(force - force.mean(), RATE) * newtons, atol=1e-8)


def test_columns_that_are_no_force_are_passed_over(force):
    """The command reads this table; the page took its first columns for time and force."""
    columns = zip(np.arange(len(force)), np.arange(len(force)) / RATE, force, strict=True)
    text = "sample,t_s,lateral_mN,sample\n" + "\n".join(f"{a},{b:.6f},{c * 1e3:.6f},0" for a, b, c in columns)
    found, rate, notes = read_upload(text.encode().replace(b",sample\n", b",counter\n"), 0)
    assert rate == RATE and any("'lateral_mN' is used" in note for note in notes)
    np.testing.assert_allclose(found, band_pass(force - force.mean(), RATE), atol=1e-8)


def test_one_column_needs_a_rate(force):
    content = "\r\n".join(f"{value:.9f}" for value in force).encode()
    found, rate, _ = read_upload(content, RATE, newtons_per_unit=2.0)
    assert rate == RATE
    np.testing.assert_allclose(found, 2 * band_pass(force - force.mean(), RATE), atol=1e-8)
    millinewtons = "F_mN\n" + "\n".join(f"{1e3 * value:.9f}" for value in force)
    np.testing.assert_allclose(read_upload(millinewtons.encode(), RATE)[0], found / 2, atol=1e-8)
    with pytest.raises(ValueError, match="sampling rate"):
        read_upload(content, 0)


def test_wav_of_several_channels_gives_the_first_of_its_beginning(force):
    long = np.tile(force, 11)
    found, rate, _ = read_upload(_wav(np.stack([long, 0 * long], axis=1)), 0)
    assert rate == RATE and len(found) == LONGEST_SECONDS * RATE
    long = long[: len(found)]
    np.testing.assert_allclose(found, band_pass(long - long.mean(), RATE), atol=1e-6)


def test_a_gap_is_bridged_with_a_note(force):
    keep = np.ones(len(force), dtype=bool)
    keep[2000:2050] = False  # 10 ms
    times = np.arange(len(force))[keep] / RATE
    found, rate, notes = read_upload(_csv(force[keep], times=times), 0)
    assert len(found) == len(force) and any("50 samples that are missing or no number are bridged" in n for n in notes)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty"),
        (b"RIFF and then nothing", "cannot be read"),
        (b"\x89PNG\r\n\x1a\n\x00\xff", "zero bytes"),
        (b"<html>notable</html>", "0.25 s"),
        (b"time,force\n" + b"0.0,abc\n" * 9, "has several columns|holds no number"),
        (b"0.0,0.1\n0.0002,0.1\n", "several columns"),
        (b"t_s,F\n0.1,0.1\n0.0,0.2\n0.2,0.1\n", "runs backward"),
    ],
)
def test_what_is_no_recording_is_refused_in_words(content, message):
    with pytest.raises(ValueError, match=message) as refused:
        read_upload(content, RATE)
    assert "/tmp" not in str(refused.value) and "--" not in str(refused.value)


def test_silence_rates_and_scales_are_refused(force):
    for content, options, message in (
        (_wav(0 * force), {}, "constant"),
        (_wav(np.full(len(force), np.nan)), {}, "no number"),
        (_wav(force, rate=1000), {}, "1000"),
        (_wav(np.tile(force, 30), rate=400_000), {}, "400000"),
        (_wav(np.tile(force[:2000, None], 65)), {}, "65 columns"),
        (_wav(force), {"newtons_per_unit": 0}, "Newtons per unit"),
    ):
        with pytest.raises(ValueError, match=message):
            read_upload(content, RATE, **options)
