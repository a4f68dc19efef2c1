"""Virtual surfaces: the laws, against formulas written again, and the statistics that they are meant to have."""

import json
from importlib.resources import files

import numpy as np
import pytest
from scipy import signal

from tactile_diffusers.data import RecordingsFile, VirtualSurface, generate_recordings
from tactile_diffusers.data.virtual import (
    CALIBRATION_FILE,
    SurfaceParameters,
    calibrate,
    explorer,
    free_exploration,
    steady_exploration,
)
from tactile_diffusers.data.virtual.exploration import VELOCITY_RATE
from tactile_diffusers.data.virtual.friction import contact_force, friction_coefficient, low_pass, temporal_noise
from tactile_diffusers.data.virtual.percepts import expected_powers
from tactile_diffusers.data.virtual.profile import surface_profile, unit_slope
from tactile_diffusers.data.virtual.raters import draw_raters
from tactile_diffusers.signal import DEVICE_RATE, band_levels_db, band_pass, rms

SURFACE = SurfaceParameters(
    material="fabric",
    friction=0.5,
    load_exponent=-0.2,
    speed_exponent=0.1,
    amplitude=8.0,
    slope=0.6,
    asperity=0.2,
    grating_level=1.6,
    wavelength=1.25,
    harmonic_decay=1.5,
    jitter=0.02,
    stick=0.0,
    contact_stiffness=0.75,
)


def slide(surface, speed, seconds=8.0, normal_force=0.5, seed=0):
    rng = np.random.default_rng(seed)
    profile = surface_profile(surface, np.random.default_rng(1))
    tables = np.stack([profile, unit_slope(profile)], axis=-1)
    return contact_force(rng, surface, tables, steady_exploration(speed, normal_force, seconds))


def test_a_surface_does_not_depend_on_how_many_there_are(tmp_path):
    for count in (2, 3):
        generate_recordings(tmp_path / f"{count}.h5", count, 2.0, explorers=1, seed=5, quiet=True)
    with RecordingsFile(tmp_path / "2.h5") as two, RecordingsFile(tmp_path / "3.h5") as three:
        for a, b in zip(two, three, strict=False):
            assert a.name == b.name
            np.testing.assert_array_equal(a.force, b.force)
            np.testing.assert_array_equal(a.velocity, b.velocity)
        np.testing.assert_array_equal(two.ratings.values, three.ratings.values[:, :2])
    assert not np.array_equal(VirtualSurface(5, 0).explore(0, 2.0)[0], VirtualSurface(6, 0).explore(0, 2.0)[0])


@pytest.mark.parametrize("speed", [66.0, 80.0, 99.0])
def test_grating_line_lies_at_speed_over_wavelength(speed):
    force = slide(SURFACE, speed)[:, 0]
    frequency, power = signal.welch(force, DEVICE_RATE, nperseg=DEVICE_RATE)
    power[frequency < 20] = 0
    # 1 Hz of resolution; a period jitter of 2 % over 12 periods in a window moves the peak by less than 2 %
    assert frequency[np.argmax(power)] == pytest.approx(speed / SURFACE.wavelength, rel=0.03)


def test_same_place_same_profile():
    # the finger comes back after one period of the surface: what differs is noise in time (1.2 mN) and of the sensor
    force = band_pass(slide(SURFACE, 80.0)[:, 0], DEVICE_RATE)
    period = int(120 / 80 * DEVICE_RATE)
    first, again = force[5000 : 5000 + period], force[5000 + period : 5000 + 2 * period]
    assert rms(first - again) < 0.25 * rms(first)


def test_friction_coefficient_law():
    expected = 0.5 * 0.75 * (0.4 / 0.5) ** -0.2 * (99 / 80) ** 0.1
    assert friction_coefficient(SURFACE, 0.4, 99.0, moisture=0.75) == pytest.approx(expected)
    force = slide(SURFACE, 80.0)
    assert force[:, 0].mean() / force[:, 2].mean() == pytest.approx(0.5, rel=0.01)  # texture averages out to 1 %


@pytest.mark.parametrize("speed", [80.0])
def test_expected_power_agrees_with_simulation(speed):
    # 1.5 dB: one profile of 120 mm holds about ten wavelengths of 20-80 Hz components, whose power scatters
    fine, coarse = expected_powers(SURFACE)
    force = slide(SURFACE, speed, seconds=12.0)[:, 0]
    assert band_levels_db(force, DEVICE_RATE, np.array([20.0, 80.0]))[0] == pytest.approx(coarse, abs=1.5)
    assert fine < band_levels_db(force, DEVICE_RATE, np.array([20.0, 1000.0]))[0]


def test_low_pass_equals_its_recursion():
    rng = np.random.default_rng(0)
    values, cutoff = rng.standard_normal(1000), rng.uniform(5, 1500, 1000)
    expected, state = [], values[0]
    for value, frequency in zip(values, cutoff, strict=True):
        state += (1 - np.exp(-2 * np.pi * frequency / DEVICE_RATE)) * (value - state)
        expected.append(state)
    np.testing.assert_allclose(low_pass(values, cutoff, DEVICE_RATE), expected, atol=1e-12)  # float64 rounding


def test_temporal_noise_has_its_power_and_slope():
    noise = temporal_noise(np.random.default_rng(0), 400_000)
    levels = band_levels_db(noise, DEVICE_RATE, np.array([20.0, 100.0, 500.0]))
    assert levels[0] == pytest.approx(levels[1], abs=0.5)  # 1/f: equal power in equal ratios
    inside = band_levels_db(noise, DEVICE_RATE, np.array([20.0, 1000.0]))[0]
    assert inside == pytest.approx(20 * np.log10(1.2e-3), abs=0.3)  # scatter of 40 s is 0.1 dB


def test_turnarounds_are_shorter_than_a_tenth_of_a_second():
    exploration = free_exploration(np.random.default_rng(0), explorer(0, 0), 60)
    assert (exploration.speed > 0).all()
    turning = np.abs(np.diff(np.unwrap(exploration.heading))) * VELOCITY_RATE > 20  # loops turn at below 20 rad/s
    edges = np.flatnonzero(np.diff(np.concatenate([[0], turning, [0]]).astype(int))).reshape(-1, 2)
    assert len(edges) > 10 and np.diff(edges).max() <= 0.1 * VELOCITY_RATE


def test_both_explorers_wander_in_and_out_of_the_limits():
    for number in range(4):
        who = explorer(number, 0)
        exploration = free_exploration(np.random.default_rng(number), who, 120)
        for values, low, high in ((exploration.speed, 66, 99), (exploration.normal_force, 0.4, 0.6)):
            share = np.mean((values >= low) & (values <= high))
            assert 0.3 < share < 0.99


def test_agreement_scales_disagreement():
    raters = draw_raters(0)
    surfaces = [VirtualSurface(0, index) for index in range(80)]
    mean_correlation = []
    for agreement in (0.3, 1.0, 10.0):
        answers = np.stack([surface.answers(raters, agreement) for surface in surfaces])
        correlation = np.corrcoef(answers[:, :, 0].T)
        mean_correlation.append(correlation[np.triu_indices(12, 1)].mean())
    assert mean_correlation == sorted(mean_correlation)
    # the recipe's 0.63; 80 surfaces leave a standard error of about 0.04
    assert mean_correlation[1] == pytest.approx(0.63, abs=0.12)
    assert set(np.unique(answers)) <= set(range(9))


def test_percepts_are_standardised_over_the_population():
    percepts = np.stack([VirtualSurface(7, index).percepts for index in range(150)])
    np.testing.assert_allclose(percepts.mean(0), 0, atol=0.3)  # standard error 0.08
    np.testing.assert_allclose(percepts.std(0), 1, atol=0.25)
    friction = [np.log(VirtualSurface(7, index).parameters.friction) for index in range(150)]
    assert np.corrcoef(friction, percepts[:, 2])[0, 1] < -0.8  # positive = more slippery


@pytest.mark.slow
def test_calibration_file_is_reproduced():
    stored = json.loads(files("tactile_diffusers.data.virtual").joinpath(CALIBRATION_FILE).read_text())
    again = calibrate()
    for name, constants in stored["constants"].items():
        assert again["constants"][name] == pytest.approx(constants, abs=2e-6)  # stored with six decimals


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"surfaces": 0}, "`surfaces`"),
        ({"explorers": 1.5}, "`explorers`"),
        ({"seconds": 1.0}, "`seconds`.*1.6384"),
        ({"seconds": float("nan")}, "`seconds`"),
        ({"agreement": 0}, "`agreement`"),
        ({"seed": -1}, "`seed`"),
    ],
)
def test_bad_arguments(tmp_path, arguments, message):
    with pytest.raises(ValueError, match=message):
        generate_recordings(tmp_path / "r.h5", **{"surfaces": 1, "seconds": 2.0, "quiet": True, **arguments})
    assert not list(tmp_path.iterdir())
