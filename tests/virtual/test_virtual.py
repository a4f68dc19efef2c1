"""Virtual surfaces: the laws, against formulas written again, and the statistics that they are meant to have."""

import json
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from calibrate_virtual import calibrate
from scipy.stats import kurtosis, skew

from tactile_diffusers.data import RecordingsFile
from tactile_diffusers.signal import DEVICE_RATE, band_levels_db, band_pass, rms
from tactile_diffusers.virtual import (
    SurfaceParameters,
    VirtualSurface,
    explorer,
    free_exploration,
    generate_recordings,
    steady_exploration,
)
from tactile_diffusers.virtual.collection import Collection
from tactile_diffusers.virtual.exploration import EXPLORERS, VELOCITY_RATE
from tactile_diffusers.virtual.friction import contact_force, force_direction, low_pass, stick_slip
from tactile_diffusers.virtual.laws import contact_stiffness, finger_cutoff, friction_coefficient, stick_slip_rate
from tactile_diffusers.virtual.percepts import CALIBRATION_FILE, expected_powers
from tactile_diffusers.virtual.raters import check_rating_correlation, draw_raters
from tactile_diffusers.virtual.relief import profile_tables
from tactile_diffusers.virtual.streams import Stream, stream

SURFACE = SurfaceParameters(
    material="fabric",
    friction=0.5,
    friction_load_exponent=-0.2,
    friction_speed_exponent=0.1,
    amplitude=8.0,
    load_exponent=0.0,
    speed_exponent=0.4,
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
    tables = profile_tables(surface, np.random.default_rng(1))
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


def test_a_compliant_grating():
    soft = replace(SURFACE, compliance=0.8)
    for speed in (66.0, 99.0):
        rigid = friction_coefficient(SURFACE, 0.5, speed)
        expected = rigid * (1 + 0.25 * 0.8) * (speed / 80) ** (0.3 * 0.8)
        assert friction_coefficient(soft, 0.5, speed) == pytest.approx(expected)
        # the background between 85 and 100 Hz, off the lines (53 and 106, 79 and 158 Hz), changes by its factor in dB
        band = np.array([85.0, 100.0])
        change = [
            band_levels_db(slide(surface, speed, 24.0)[:, 0], DEVICE_RATE, band)[0] for surface in (soft, SURFACE)
        ]
        # 0.3 dB: what the lines' jitter spreads into the band does not change
        assert change[0] - change[1] == pytest.approx(20 * -0.8 * 0.8 * np.log10(speed / 80), abs=0.3)


def test_only_gratings_of_soft_classes_are_compliant():
    surfaces = [VirtualSurface(0, index).parameters for index in range(400)]
    for surface in surfaces:
        soft = surface.grating_level > 0 and surface.material in ("fabric", "rubber")
        assert 0.4 <= surface.compliance <= 1 if soft else surface.compliance == 0
    assert 40 < sum(surface.compliance > 0 for surface in surfaces) < 100  # 8.2 of 50 expected


def test_impulsiveness_changes_impulses_alone():
    plain, twice = (VirtualSurface(3, 1, impulsiveness).parameters for impulsiveness in (0.0, 2.0))
    assert plain.intermittency == plain.catches == 0 and twice.intermittency > 0
    assert replace(twice, intermittency=0.0, catches=0.0) == plain


def test_an_envelope_makes_a_profile_impulsive():
    def kurtosis_of(intermittency):
        surface = replace(SURFACE, grating_level=0.0, intermittency=intermittency)
        return np.mean(
            [kurtosis(profile_tables(surface, np.random.default_rng(k))[:, 0], fisher=False) for k in range(9)]
        )

    # 3 exp(4 s^2); nine profiles of some hundred independent lengths each scatter by 5 %
    assert kurtosis_of(0.0) == pytest.approx(3.0, rel=0.1)
    assert kurtosis_of(0.3) == pytest.approx(3 * np.exp(4 * 0.3**2), rel=0.15)


@pytest.mark.parametrize("sense", [1, -1])
def test_catches_load_slowly_and_let_go_fast_whichever_way_the_finger_comes(sense):
    surface = replace(SURFACE, grating_level=0.0, amplitude=20.0, catches=0.02, catch_height=30.0)
    tables = profile_tables(surface, np.random.default_rng(1))
    there = steady_exploration(80.0, 0.5, 8.0)
    stroke = replace(there, track_speed=sense * there.track_speed)
    force = contact_force(np.random.default_rng(0), surface, tables, stroke)[:, 0]
    rate = np.diff(band_pass(force, DEVICE_RATE))
    assert skew(rate) < -3  # many small rises, few large falls; 0 without catches
    assert abs(skew(np.diff(band_pass(slide(replace(surface, catches=0.0), 80.0)[:, 0], DEVICE_RATE)))) < 0.2


def test_a_finger_that_starts_is_loaded_before_it_slips():
    exploration = free_exploration(np.random.default_rng(3), explorer(0, 0), 4.0)
    assert exploration.speed[0] == 0 and exploration.speed[VELOCITY_RATE // 2] > 40
    force = contact_force(
        np.random.default_rng(3), SURFACE, profile_tables(SURFACE, np.random.default_rng(1)), exploration
    )
    lateral = np.hypot(force[:, 0], force[:, 1]) / force[:, 2]
    start = np.flatnonzero(exploration.speed > 0)[0] * DEVICE_RATE // VELOCITY_RATE
    assert lateral[:start].mean() < 0.1 * lateral[-DEVICE_RATE:].mean()  # nothing is loaded at rest
    first = lateral[start : start + DEVICE_RATE // 5]
    assert np.percentile(first, 99) > 1.05 * lateral[DEVICE_RATE:].mean()  # static friction lies above sliding friction


def test_a_very_fast_finger_has_a_direction_of_force():
    speed = np.full(1000, 5000.0)
    found = force_direction(np.full(1000, 0.5), speed, np.full(1000, 0.5), np.full(1000, 2.0))
    np.testing.assert_allclose(found[100:], np.tile([np.cos(0.5), np.sin(0.5)], (900, 1)), rtol=1e-9)  # settled


def test_stiffness_and_stick_slip_rate():
    surface = replace(SURFACE, stick=0.6)
    assert contact_stiffness(surface, 80.0) == 0.75
    assert contact_stiffness(surface, 100.0) == pytest.approx(0.75 + 20 * 4.04e-3)
    assert stick_slip_rate(surface, 0.3, 100.0) == pytest.approx((0.75 + 20 * 4.04e-3) * 100 / (0.6 * 0.3))


def test_stick_slip_keeps_its_rate_in_long_recordings():
    surface, seconds = replace(SURFACE, stick=0.6), 600
    ones = np.ones(seconds * VELOCITY_RATE)
    wave = stick_slip(np.random.default_rng(0), surface, 0.3 * ones, 80 * ones, seconds * DEVICE_RATE)
    ends = np.flatnonzero((wave[1:-1] < wave[:-2]) & (wave[1:-1] <= wave[2:]))
    first, last = (np.sum((ends >= start) & (ends < start + 600_000)) for start in (0, 5_400_000))
    # 60 s at 333 Hz: the periods' jitter scatters the count by 0.2 %
    assert last == pytest.approx(first, rel=0.01)
    assert last / 60 == pytest.approx(0.75 * 80 / (0.6 * 0.3) / np.exp(0.25**2 / 2), rel=0.01)


def test_cutoff_of_the_finger():
    assert finger_cutoff(80.0) == pytest.approx(13.8 * 80) and finger_cutoff(200.0) == 1500
    assert finger_cutoff(80.0, 1.5) == pytest.approx(1.5 * 13.8 * 80)


def test_expected_power_agrees_with_simulation():
    # 1.5 dB: one profile of 120 mm holds about ten wavelengths of 20-80 Hz components, whose power scatters
    fine, coarse = expected_powers(SURFACE)
    force = slide(SURFACE, 80.0, seconds=12.0)[:, 0]
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


def test_turnarounds_are_shorter_than_a_tenth_of_a_second():
    exploration = free_exploration(np.random.default_rng(0), explorer(0, 0), 60)
    assert (exploration.speed[VELOCITY_RATE:] > 0).all()  # from rest, then always moving
    turning = np.abs(np.diff(np.unwrap(exploration.heading))) * VELOCITY_RATE > 20  # loops turn at below 20 rad/s
    edges = np.flatnonzero(np.diff(np.concatenate([[0], turning, [0]]).astype(int))).reshape(-1, 2)
    assert len(edges) > 10 and np.diff(edges).max() <= 0.1 * VELOCITY_RATE


def test_exploration_adapts_to_roughness():
    runs = [free_exploration(np.random.default_rng(4), explorer(0, 0), 60, z) for z in (-1.0, 0.0, 1.0, 2.0, 9.0)]
    slow, plain, fast = (run.speed.max() for run in runs[:3])
    assert fast / plain == pytest.approx(np.exp(-0.02)) and slow / plain == pytest.approx(np.exp(0.02))
    light, normal = (np.log(run.normal_force) for run in runs[:2])
    assert light.std() / normal.std() == pytest.approx(np.exp(0.1))
    np.testing.assert_array_equal(runs[3].speed, runs[4].speed)  # beyond two standard deviations nothing changes
    rough = max((VirtualSurface(0, index) for index in range(40)), key=lambda surface: surface.percepts[0])
    velocity = rough.explore(0, 4.0)[1]
    rng = stream(0, Stream.EXPLORATION, rough.index, 0, 0)
    expected = free_exploration(rng, EXPLORERS[0], 4.0, rough.percepts[0])
    np.testing.assert_array_equal(velocity, expected.velocity)


def test_further_explorers_are_other_fingers():
    people = [explorer(index, 0) for index in range(2, 202)]
    assert [explorer(index, 0) for index in (0, 1)] == list(EXPLORERS)
    assert explorer(7, 0) == people[5] and explorer(7, 1) != people[5]
    for name, low, high in (("moisture", 0.75, 1.0), ("gain", 0.8, 1.0), ("cutoff", 0.9, 1.1)):
        values = np.array([getattr(who, name) for who in people])
        assert 0.2 < np.mean(values < low) < 0.5 and 0.2 < np.mean(values > high) < 0.5
    for who in people:
        assert 66 < who.speed < 99 and 0.4 < who.normal_force < 0.6


def rated(count=400, seed=0, **settings):
    """Answers (12, surfaces, 3) about surfaces of a seed."""
    raters = draw_raters(seed)
    return np.stack([VirtualSurface(seed, index).answers(raters, **settings) for index in range(count)], axis=1)


def inter_rater(answers, axis):
    return np.corrcoef(answers[:, :, axis])[np.triu_indices(len(answers), 1)].mean()


def z_scores(answers):
    return (answers - answers.mean(1, keepdims=True)) / answers.std(1, keepdims=True)


def pooled_correlation(answers):
    return np.corrcoef(z_scores(answers).mean(0).T)[np.triu_indices(3, 1)]


def test_recipe_of_the_raters():
    answers, again = rated(), rated(trial=1)
    # Cleland et al. 2024: 0.62 and 0.60 between raters, 0.74 and 0.83 between trials; 400 surfaces: standard error 0.03
    for axis, expected in ((0, 0.62), (2, 0.60)):
        assert inter_rater(answers, axis) == pytest.approx(expected, abs=0.08)
    for axis, expected in ((0, 0.74), (2, 0.83)):
        retest = [np.corrcoef(one[:, axis], two[:, axis])[0, 1] for one, two in zip(answers, again, strict=True)]
        assert np.mean(retest) == pytest.approx(expected, abs=0.06)
    np.testing.assert_allclose(pooled_correlation(answers), (0.40, -0.50, -0.20), atol=0.1)


@pytest.mark.parametrize("target", [(0.0, 0.0, 0.0), (0.4, -0.9, -0.4)])
def test_ratings_correlate_as_asked(target):
    answers = rated(agreement=1e3, rating_correlation=target)
    # 400 surfaces: standard error 0.05; whole numbers and the scale's ends
    np.testing.assert_allclose(pooled_correlation(answers), target, atol=0.12)
    kept = [np.corrcoef(answers.mean(0)[:, axis], rated(agreement=1e3).mean(0)[:, axis])[0, 1] for axis in range(3)]
    assert min(kept) > 0.8  # every axis stays what it was in the main


def test_impossible_correlations_are_refused():
    with pytest.raises(ValueError, match="`rating_correlation` .* impossible: no three ratings correlate so"):
        check_rating_correlation((0.9, -0.9, 0.9))
    assert check_rating_correlation((0.45, -0.45, 0.45)) == (0.45, -0.45, 0.45)
    for bad in (0.5, (0.1, 0.2), (0.1, 0.2, 1.0), (0.1, 0.2, float("nan")), ("a", 0, 0)):
        with pytest.raises(ValueError, match="three numbers from -0.95 to 0.95"):
            check_rating_correlation(bad)


def test_a_rater_is_the_same_among_more():
    surface = VirtualSurface(0, 3)
    few, many = (surface.answers(draw_raters(0, count)) for count in (12, 20))
    np.testing.assert_array_equal(few, many[:12])


def test_percepts_are_standardised_over_the_population():
    percepts = np.stack([VirtualSurface(7, index).percepts for index in range(150)])
    np.testing.assert_allclose(percepts.mean(0), 0, atol=0.3)  # standard error 0.08
    np.testing.assert_allclose(percepts.std(0), 1, atol=0.25)
    friction = [np.log(VirtualSurface(7, index).parameters.friction) for index in range(150)]
    assert np.corrcoef(friction, percepts[:, 2])[0, 1] < -0.8  # positive = more slippery


@pytest.mark.slow
def test_calibration_file_is_reproduced():
    stored = json.loads(files("tactile_diffusers.virtual").joinpath(CALIBRATION_FILE).read_text())
    again = calibrate()
    for name, constants in stored["constants"].items():
        assert again["constants"][name] == pytest.approx(constants, abs=2e-6)  # stored with six decimals


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"surfaces": 0}, "`surfaces`"),
        ({"explorers": 1.5}, "`explorers`"),
        ({"seconds": 0.2}, "`seconds`.*0.25"),
        ({"seconds": float("nan")}, "`seconds`"),
        ({"agreement": 0}, "`agreement`"),
        ({"seed": -1}, "`seed`"),
    ],
)
def test_bad_arguments(tmp_path, arguments, message):
    with pytest.raises(ValueError, match=message):
        generate_recordings(tmp_path / "r.h5", **{"surfaces": 1, "seconds": 2.0, "quiet": True, **arguments})
    assert not list(tmp_path.iterdir())


def test_further_axes_leave_the_three_as_they_were():
    surfaces = [VirtualSurface(3, index) for index in range(120)]
    further = Collection(4.0, seed=3, further_axes=("fineness", "regularity", "warmth"))
    answers, three = further.answers(surfaces), Collection(4.0, seed=3).answers(surfaces)
    np.testing.assert_array_equal(answers[..., :3], three)
    again = Collection.from_attributes(further.attributes)
    assert again == further and again.rating_axes[3:] == ("fineness", "regularity", "warmth")
    assert "further_axes" not in Collection(4.0).attributes
    means = answers.mean(0)
    asperity = [-surface.parameters.slope for surface in surfaces]  # a flat spectrum over space is a fine one
    share = [surface.parameters.grating_level for surface in surfaces]
    assert np.corrcoef(asperity, means[:, 3])[0, 1] > 0.4 and np.corrcoef(share, means[:, 4])[0, 1] > 0.4
    assert np.abs(np.corrcoef(means.T)[5, :5]).max() < 0.3  # three standard errors of 120 surfaces
    with pytest.raises(ValueError, match="`further_axes` must be different names"):
        Collection(4.0, further_axes=("hot",))
