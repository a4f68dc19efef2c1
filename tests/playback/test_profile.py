"""A texture over position: the same place, the same force; the speed moves frequencies and nothing else."""

import numpy as np
import pytest

from tactile_diffusers.playback import TextureProfile
from tactile_diffusers.playback.profile import loop
from tactile_diffusers.signal import band_edges, band_levels_db, band_pass, nine_band_error_db, rms

RATE, SPEED = 10_000, 80.0


def _line(cycles_per_mm, samples=16_384):
    """A texture of one spatial frequency, as felt at 80 mm/s."""
    return np.sin(2 * np.pi * cycles_per_mm * SPEED / RATE * np.arange(samples))


def _read(profile, speed, seconds=1.0, start=7.0):
    position = start + speed * np.arange(round(seconds * RATE)) / RATE
    return profile.read(position, np.full(len(position), speed))


@pytest.fixture
def profile(pink_noise):
    return TextureProfile(pink_noise(16_384, RATE)[0], RATE, SPEED)


def test_at_the_reference_speed_it_is_the_texture(pink_noise):
    texture = pink_noise(16_384, RATE)[0]
    profile = TextureProfile(texture, RATE, SPEED, fill=False)
    # away from the end that fades into the beginning; positions are the texture's own samples
    made = _read(profile, SPEED, seconds=1.2, start=2000 * profile.pitch)
    assert rms(made - texture[2000:14_000]) < 0.06 * rms(texture)
    assert nine_band_error_db(made[None], texture[None, 2000:14_000], RATE)[0] < 0.2


def test_a_texture_of_a_rate_below_the_band_is_not_filled_above(pink_noise):
    made = _read(TextureProfile(pink_noise(2000, 800)[0], 800, SPEED), SPEED)
    assert np.isfinite(made).all() and made.any()


@pytest.mark.parametrize("speed", [40.0, 80.0, 120.0, 160.0])
def test_frequency_follows_speed(speed):
    felt = _read(TextureProfile(_line(2.0), RATE, SPEED, fill=False), speed)
    spectrum = np.abs(np.fft.rfft(felt * np.hanning(len(felt))))
    assert abs(np.argmax(spectrum) - 2.0 * speed) <= 1  # Hz, bins of 1 Hz
    assert rms(felt) == pytest.approx(np.sqrt(0.5), rel=0.05)  # in the join a line meets itself at another phase


@pytest.mark.parametrize(("cycles_per_mm", "speed"), [(10.0, 160.0), (6.0, 320.0), (0.4, 20.0), (0.5, 30.0)])
def test_what_would_lie_outside_the_band_is_filtered_as_in_a_recording(cycles_per_mm, speed):
    felt = _read(TextureProfile(_line(cycles_per_mm), RATE, SPEED, fill=False), speed)
    edge = {True: 1000.0, False: 20.0}[cycles_per_mm * speed > 1000]
    passed = 1 / (1 + max(edge / (cycles_per_mm * speed), cycles_per_mm * speed / edge) ** 8)
    # of 0.71; resolutions a quarter of an octave apart are blended
    assert rms(felt) < 1.5 * np.sqrt(0.5) * passed + 2e-3


@pytest.mark.parametrize("speed", [20.0, 40.0, 80.0, 160.0, 320.0])
def test_nothing_is_felt_far_above_the_band(profile, speed):
    felt = _read(profile, speed)
    power = np.abs(np.fft.rfft(felt * np.hanning(len(felt)))) ** 2
    recorded = np.abs(np.fft.rfft(band_pass(felt, RATE) * np.hanning(len(felt)))) ** 2
    # no more than a recording's own filter leaves, and nothing where the interpolation's images would lie
    assert power[1300:].sum() < 1e-4 * power.sum() and power[3000:].sum() < 1e-6 * power.sum()
    assert recorded.sum() > 0.8 * power.sum()


def test_a_place_feels_the_same_from_both_sides_and_again_after_the_length(profile):
    position, speed = np.linspace(0, 100, 5000), np.full(5000, 50.0)
    forward, back = profile.read(position, speed), profile.read(position[::-1], -speed)[::-1]
    np.testing.assert_array_equal(forward, back)
    for far in (1, -3):
        np.testing.assert_allclose(profile.read(position + far * profile.length, speed), forward, atol=1e-9)


def test_the_join_has_no_step_and_no_dip(pink_noise):
    textures = pink_noise(16_384, RATE, count=40)
    joined = np.stack([loop(texture, 1638) for texture in textures])
    around = np.concatenate([joined[:, -500:], joined[:, :500]], axis=1)
    assert np.abs(np.diff(around, axis=1)).max() < 1.5 * np.abs(np.diff(textures, axis=1)).max()
    faded, elsewhere = rms(joined[:, :1638]), rms(joined[:, 4000:])
    assert abs(20 * np.log10(np.mean(faded) / np.mean(elsewhere))) < 0.7  # dB; 40 takes


@pytest.mark.parametrize("speed", [20.0, 40.0, 160.0, 320.0])
def test_filling_continues_the_slope(pink_noise, speed):
    """Noise of amplitude 1/f over all frequencies, of which a recording's filter leaves 20-1000 Hz."""
    takes = band_pass(pink_noise(16_384, RATE, count=8, band=(2.0, 4000.0)), RATE)
    errors, edges = {}, band_edges()
    ideal = 10 * np.log10(1 / edges[:-1] - 1 / edges[1:])  # a density of 1/f^2
    for fill in (True, False):
        felt = np.stack([_read(TextureProfile(take, RATE, SPEED, fill=fill), speed) for take in takes])
        levels = band_levels_db(felt, RATE).mean(0)
        errors[fill] = np.ptp(levels - ideal)
    assert errors[True] < 7 and errors[True] < 0.6 * errors[False]  # dB between bands; from lines through noise


def test_filling_is_seeded_and_leaves_the_held_band_alone(pink_noise):
    texture = pink_noise(16_384, RATE)[0]
    first, same, other, none = (
        _read(TextureProfile(texture, RATE, SPEED, **options), 40.0)
        for options in ({}, {"seed": 0}, {"seed": 1}, {"fill": False})
    )
    np.testing.assert_array_equal(first, same)
    assert not _read(TextureProfile(np.zeros(16_384), RATE, SPEED), 40.0).any()  # silence is not filled
    assert np.abs(first - other).max() > 0
    kept = np.abs(np.fft.rfft((first - none) * np.hanning(len(none))))[40:450]
    whole = np.abs(np.fft.rfft(none * np.hanning(len(none))))[40:450]
    assert np.sum(kept**2) < 1e-3 * np.sum(whole**2)  # at 40 mm/s the texture holds 20-500 Hz


def test_a_change_of_speed_makes_no_step(profile):
    speed = np.geomspace(10, 1000, 20_000)
    position = 20 + np.cumsum(speed) / RATE
    steps = np.abs(np.diff(profile.read(position, speed)))
    steady = max(np.abs(np.diff(_read(profile, speed))).max() for speed in (160.0, 400.0, 1000.0))
    assert steps.max() < 1.2 * steady  # other places are passed


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"texture": np.zeros(100)}, "at least 2000 samples"),
        ({"texture": np.full(16_384, np.nan)}, "finite"),
        ({"texture": np.zeros((2, 16_384))}, "must be .samples,"),
        ({"sampling_rate": None}, "`sampling_rate` must be a finite number above 0 in Hz, got None"),
        ({"reference_speed": "80"}, "`reference_speed` must be a finite number above 0 in mm/s, got '80'"),
    ],
)
def test_bad_input_is_refused(change, message):
    given = {"texture": np.zeros(16_384), "sampling_rate": RATE, "reference_speed": SPEED} | change
    with pytest.raises(ValueError, match=message):
        TextureProfile(**given)
