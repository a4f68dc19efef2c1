"""Any display under any force: drive within its range, whatever the blocks, and profiles that survive their files."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_diffusers.display import DriveProfile


@st.composite
def displays(draw):
    speeds = np.cumsum(draw(st.lists(st.floats(1, 100), min_size=1, max_size=3)))
    values = {
        "cutoffs": [(speed, draw(st.floats(1, 3000))) for speed in speeds.tolist()],
        "normal_force": draw(st.floats(0.01, 5)),
        "max_gain_db": draw(st.one_of(st.just(0.0), st.floats(3, 40))),
    }
    if draw(st.booleans()):
        gain, most = 10.0 ** draw(st.floats(-8, -3)), draw(st.floats(1, 500))
        return DriveProfile(kind="electroadhesion", gain=gain, max_drive=most, offset=0.2, **values)
    steps = draw(st.lists(st.tuples(st.floats(0.05, 0.3), st.floats(0.001, 0.5)), min_size=2, max_size=3))
    table = np.concatenate([[(0.0, 0.0)], np.cumsum(steps, axis=0)])
    gain, most = draw(st.floats(0.1, 5)), draw(st.floats(0.02, 1)) * table[-1, 0]
    offset = gain * table[-1, 1] + 0.1
    return DriveProfile(
        kind="ultrasonic", gain=gain, lookup=table.tolist(), max_drive=float(most), offset=float(offset), **values
    )


forces = st.tuples(st.integers(1, 400), st.integers(0, 99), st.floats(-6, 1)).map(
    lambda drawn: 10.0 ** drawn[2] * np.random.default_rng(drawn[1]).standard_normal(drawn[0])
)


@pytest.mark.filterwarnings("ignore:The display cannot make this force")
@settings.get_profile("many")
@given(profile=displays(), force=forces, seed=st.integers(0, 99), fastest=st.sampled_from([0.0, 5.0, 15.0, 300.0]))
def test_blocks_do_not_matter_and_the_drive_stays_in_range(profile, force, seed, fastest):
    rng = np.random.default_rng(seed)
    speed = fastest * rng.random(len(force))
    whole, report = profile.drive(force, speed)
    stream, made, begin = profile.stream(), [], 0
    while begin < len(force):
        end = begin + int(rng.integers(1, 60))
        made.append(stream.push(force[begin:end], speed[begin:end]))
        begin = end
    np.testing.assert_array_equal(np.concatenate(made), whole)
    assert stream.report == report or np.isnan(report.largest_force)
    assert (whole >= 0).all() and (whole <= profile.max_drive).all() and report.samples == len(force)
    low, high = profile.force_range
    assert low <= stream.bias <= high and 0 <= report.clipped <= len(force) and str(report)


@settings.get_profile("few")
@given(profile=displays(), shares=st.lists(st.floats(0, 1), min_size=1, max_size=9))
def test_steady_drive_is_the_inverse_of_steady_force(profile, shares):
    drive = np.array(shares) * profile.max_drive
    force = profile.steady_force(drive)
    low, high = profile.force_range
    assert (force >= low - 1e-12).all() and (force <= high * (1 + 1e-12)).all()
    again = profile.steady_drive(np.clip(force, low, high))
    # a lookup is inverted by a table that errs by 1e-6 of its range
    most = high - low if profile.lookup is None else profile.gain * profile.lookup[-1][1]
    np.testing.assert_allclose(profile.steady_force(again), force, atol=2e-6 * most)


@settings.get_profile("many")
@given(profile=displays())
def test_a_profile_comes_back_from_its_file(tmp_path, profile):
    profile.save(tmp_path / "p.json")
    assert DriveProfile.load(tmp_path / "p.json") == profile


@settings.get_profile("many")
@given(profile=displays(), speed=st.floats(0, 500), rate=st.sampled_from([1000, 10_000, 44_100]))
def test_the_response_is_finite_and_one_at_rest(response, profile, speed, rate):
    found = response(profile, np.linspace(0, rate / 2 * 0.99, 50), speed, rate)
    assert np.isfinite(found).all() and abs(found[0] - 1) < 1e-6


BAD_PUSHES = {
    "force": [[], [np.nan], [np.inf, 0], ["x"], None, [[0.1]], 0.1, [1j], [101.0], [True], [10**400]],
    "speed": [-1, np.nan, np.inf, "x", None, [1.0], [[80.0] * 3], [80.0, np.nan, 80.0], [80.0, -1.0, 80.0], True],
}


@pytest.mark.parametrize("name", BAD_PUSHES)
@pytest.mark.parametrize("kind", ["electroadhesion", "ultrasonic"])
def test_bad_blocks_are_refused_and_change_nothing(make_profile, kind, name):
    good = {"force": np.array([0.01, -0.02, 0.03]), "speed": 80.0}
    stream, other = make_profile(kind).stream(), make_profile(kind).stream()
    for bad in BAD_PUSHES[name]:
        with pytest.raises(ValueError, match=f"`{name}`"):
            stream.push(**(good | {name: bad}))
        np.testing.assert_array_equal(stream.push(**good), other.push(**good))
        assert stream.report == other.report


@pytest.mark.parametrize(
    "name", ["gain", "offset", "cutoffs", "max_drive", "normal_force", "max_gain_db", "kind", "lookup"]
)
@pytest.mark.parametrize("value", [np.nan, np.inf, -1, "x", [], [[1.0]], {}, True, pytest.param(10**400, id="huge")])
def test_impossible_profiles_are_refused_by_name(make_profile, name, value):
    with pytest.raises(ValueError, match=f"`{name}`"):
        make_profile(**{name: value})
