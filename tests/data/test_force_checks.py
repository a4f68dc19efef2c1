"""Forces that no finger makes, and sensors at the end of their range."""

import numpy as np
import pytest

from tactile_diffusers.data.force_checks import check_forces, over_range, saturated
from tactile_diffusers.signal.masks import true_runs

RATE = 10_000


def force_of(samples=50_000, mean=(0.0, 0.0, 0.5), swing=(0.3, 0.3, 0.0), noise=0.01, seed=0):
    """Contact force of loops: x and y turn with the finger, z keeps its sign."""
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * 1.1 * np.arange(samples) / RATE
    wave = np.stack([np.cos(angle), np.sin(angle), np.cos(angle)], axis=-1)
    return np.float32(np.array(mean) + np.array(swing) * wave + noise * rng.standard_normal((samples, 3)))


@pytest.mark.parametrize(
    "factor, message",
    [
        (1000, r"here: .* N.* probably in mN: divide by 1000, which gives 0.5 N"),
        (
            1 / 9.80665e-3,
            r"here: the normal force is 50.99 N on average.* in gram-force: multiply by 0.00981, .* 0.5 N",
        ),
        (40, r"here: the normal force is 20 N on average, a finger explores with less than 15 N"),
    ],
)
def test_wrong_units_are_named_with_the_factor(factor, message):
    with pytest.raises(ValueError, match=message):
        check_forces(force_of() * np.float32(factor), "here")
    assert check_forces(force_of() * np.float32(factor), "here", unit="1") == []


def test_lateral_force_alone_in_millinewtons():
    lateral = 300 + 10 * np.random.default_rng(0).standard_normal(50_000)
    with pytest.raises(ValueError, match="here: reaches .* N, no fingertip 100 N .first at sample 0..*in mN"):
        check_forces(lateral, "here")


def test_a_glitch_is_a_note_and_its_place():
    force = force_of()
    force[[777, 900], 1] = -300
    assert check_forces(force, "here") == ["samples above 100 N excluded (2, first at sample 777)"]
    assert np.flatnonzero(over_range(force)).tolist() == [777, 900]
    assert over_range(force[:, 1]).sum() == 2


@pytest.mark.parametrize("axis", [0, 1])
def test_swapped_axes_are_refused(axis):
    force = force_of()
    force[:, [axis, 2]] = force[:, [2, axis]]
    with pytest.raises(
        ValueError, match=f"here: z changes sign while {'xy'[axis]} does not, and is larger .*{'xy'[axis]} looks"
    ):
        check_forces(force, "here")
    with pytest.raises(ValueError, match="looks like the normal force"):
        check_forces(force, "here", unit="1")


def test_friction_above_one_in_one_direction_is_only_suspicious():
    notes = check_forces(force_of(mean=(0.8, 0.0, 0.5), swing=(0, 0, 0)), "here")
    assert len(notes) == 1 and notes[0].startswith("z is not the largest force on average: swapped axes, or friction")


def test_a_normal_force_without_sign_is_suspicious():
    notes = check_forces(force_of(mean=(0, 0, 0.02), swing=(0.3, 0.3, 0.3)), "here")
    assert len(notes) == 1 and notes[0].startswith("the normal force z changes sign (mean force x")


def test_a_finger_passes():
    force = force_of()
    force[10_000:30_000] *= 0.001  # lifted
    for one in (force_of(), -force_of(), force_of()[:, 0], force):  # pressing may be negative
        assert check_forces(one, "here") == []


def test_nan_is_left_out_and_nothing_but_nan_refused():
    force = force_of()
    force[5000:45_000] = np.nan
    assert check_forces(force, "here") == []
    force[:, 1] = np.nan
    with pytest.raises(ValueError, match="here: holds only NaN"):
        check_forces(force, "here")
    few = np.full(50_001, np.nan)
    few[1] = 0.3  # beside every sample that a glance meets
    assert check_forces(few, "here") == []


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("length, found", [(49, False), (50, True), (400, True)])
def test_saturation_is_5_ms_at_the_extreme(sign, length, found):
    values = sign * force_of()[:, 2]
    values[20_000 : 20_000 + length] = sign * 0.7
    values[30_000:30_020] = sign * 0.7  # too short
    mask = saturated(values, RATE)
    assert true_runs(mask).tolist() == ([[20_000, 20_000 + length]] if found else [])


def test_what_is_not_saturation():
    values = force_of()[:, 2]
    assert not saturated(np.full(50_000, 0.5), RATE).any()  # constant
    assert not saturated(np.full(50_000, np.nan), RATE).any()
    assert not saturated(np.repeat(values[::100], 100), RATE).any()  # held from 100 Hz
    slow = 0.5 + 0.2 * np.sin(2 * np.pi * 0.3 * np.arange(50_000) / RATE)
    assert not saturated(np.round(slow, 2), RATE).any()  # coarsely quantised
    lifted = np.maximum(values - 0.5, 0)
    lifted[10_000:20_000] = 0
    assert not saturated(lifted, RATE).any()  # clamped at 0 where nothing is touched
    gaps = values.copy()
    gaps[1000:3000] = np.nan
    assert not saturated(gaps, RATE).any()
