"""Newtons that become drive become newtons again at the finger, as far as the display goes."""

import warnings

import numpy as np
import pytest

from tactile_diffusers.signal import nine_band_error_db

RATE = 10_000
KINDS = ("electroadhesion", "ultrasonic")
SPEED = 80.0  # mm/s, that of the made-up calibration


def _fluctuation(force):
    return force - force.mean()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("slope", [0, 1, 2])
def test_the_finger_feels_the_texture(make_profile, feel, noise_texture, kind, slope):
    """A corner of 300 Hz: 12 dB reach 1180 Hz, so all nine bands are judged, 20-1000 Hz."""
    texture = noise_texture(slope=slope, rms=0.006)
    drive, report = make_profile(kind).drive(texture, SPEED)
    assert report.clipped == 0
    felt = _fluctuation(feel(kind, drive, cutoff=300.0))
    # what the limited inverse leaves is 0.25 dB in the top band, 0.04 dB on average
    assert nine_band_error_db(felt, texture, RATE) < 0.1
    # without the inverse it is 2.4 dB: the test can fail
    untreated, _ = make_profile(kind, max_gain_db=0.0).drive(texture, SPEED)
    assert nine_band_error_db(_fluctuation(feel(kind, untreated, cutoff=300.0)), texture, RATE) > 2
    # and the waveform arrives, 0.1 ms (a held sample) and 0.13 ms (a quarter of the display's lag) later: 2.3 samples,
    # of which the 2 are undone; the 0.3 and the dispersion leave 0.99
    assert np.corrcoef(felt[2:], texture[:-2])[0, 1] > 0.98


@pytest.mark.parametrize("max_gain_db", [3.0, 12.0, 20.0])
@pytest.mark.parametrize("cutoff", [5.0, 100.0, 1500.0])
def test_the_inverse_keeps_to_its_limit(make_profile, response, max_gain_db, cutoff):
    """Over all frequencies, not only in the band; and reaches it where the sampling leaves room for that."""
    frequencies = np.geomspace(1, RATE / 2, 2000)
    limited = response(make_profile(cutoffs=[(SPEED, cutoff)], max_gain_db=max_gain_db), frequencies, SPEED)
    display = response(make_profile(cutoffs=[(SPEED, cutoff)], max_gain_db=0.0), frequencies, SPEED)
    gain_db = 20 * np.log10(np.abs(limited / display)).max()
    assert gain_db <= max_gain_db + 1e-9
    if cutoff == 5.0:
        assert gain_db == pytest.approx(max_gain_db, abs=0.01)


def test_response_is_what_sines_do(make_profile, response):
    """The formula in `response` against the filter that runs, at full, no and half strength of the inverse."""
    profile = make_profile(cutoffs=[(SPEED, 120.0)])
    time_s = np.arange(RATE) / RATE
    for speed in (SPEED, 5.0, 15.0):
        for frequency in (50.0, 400.0):
            force = 0.01 * np.sin(2 * np.pi * frequency * time_s)
            commanded = profile.steady_force(profile.drive(force, speed)[0]) - profile.stream().bias
            gain = np.vdot(np.exp(2j * np.pi * frequency * time_s[-2000:]), commanded[-2000:]) / (-1j * 10)
            plain = make_profile(cutoffs=[(SPEED, 120.0)], max_gain_db=0.0)
            expected = response(profile, frequency, speed) / response(plain, frequency, speed)
            assert gain == pytest.approx(complex(expected), rel=1e-6)


@pytest.mark.parametrize("cutoffs", [[(SPEED, 40.0)], [(10.0, 30.0), (30.0, 60.0)]])
def test_no_click_where_the_inverse_sets_in(make_profile, cutoffs):
    """Curvature of the command for a sine, while the speed goes from 5 to 30 mm/s within a second."""
    profile = make_profile(cutoffs=cutoffs)
    force = 0.005 * np.sin(2 * np.pi * 60 * np.arange(320 * 32) / RATE + 0.5)

    def curvature(speed):
        stream = profile.stream()
        blocks = [stream.push(*block) for block in zip(force.reshape(320, 32), speed, strict=True)]
        return np.abs(np.diff(profile.steady_force(np.concatenate(blocks))[500:], 2)).max()

    # no more than the most that any constant speed asks for, and a tenth for what changes
    allowed = 1.1 * max(curvature(np.full(320, speed)) for speed in np.linspace(5, 30, 11))
    per_block = np.linspace(5, 30, 320)
    assert curvature(per_block) < allowed
    assert curvature(np.interp(np.arange(320 * 32) / 32, np.arange(320), per_block).reshape(320, 32)) < allowed
    # the test can fail: a speed that is held for each block, and steps between them, clicks
    assert curvature(np.repeat(per_block, 32).reshape(320, 32)) > 2 * allowed


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.filterwarnings("ignore:The display cannot make this force")
def test_clipping_is_counted_and_the_scale_that_fits_fits(make_profile, noise_texture, kind):
    profile = make_profile(kind)
    texture = noise_texture(rms=0.05)
    drive, report = profile.drive(texture, SPEED)
    assert drive.min() == 0 and drive.max() == profile.max_drive
    assert report.samples == len(texture)
    # counted from the drive: a clipped sample is at either end of the range
    assert report.clipped == np.count_nonzero((drive == 0) | (drive == profile.max_drive))
    assert 0.01 < report.share < 0.5 and report.fitting_scale < 1
    assert report.largest_force == pytest.approx(report.fitting_scale * np.abs(texture).max())
    assert "samples clipped" in str(report)

    fitting = profile.drive(0.9999 * report.fitting_scale * texture, SPEED)[1]
    beyond = profile.drive(1.0001 * report.fitting_scale * texture, SPEED)[1]
    assert fitting.clipped == 0 and fitting.largest_excess == 0
    assert beyond.clipped == 1


def test_clipping_is_warned_of_once(make_profile, noise_texture):
    profile, texture = make_profile(), noise_texture(rms=0.05)
    stream = profile.stream()
    with pytest.warns(UserWarning, match=r"% of .* samples clipped.*factor 0\..*read_friction") as seen:
        for block in texture.reshape(-1, 64):
            stream.push(block, SPEED)
    assert len(seen) == 1
    with pytest.warns(UserWarning, match="samples clipped"):
        profile.stream().push(texture, SPEED)
    with warnings.catch_warnings():  # a single peak, or silence, is nobody's fault
        warnings.simplefilter("error")
        quiet = np.r_[np.full(5, 0.2), np.zeros(100)]
        assert 0 < profile.drive(quiet, SPEED)[1].clipped < 10
        silent = profile.drive(np.zeros(10, dtype=np.float32), SPEED)[1]
        assert silent.fitting_scale == np.inf and np.isnan(silent.largest_force)


def test_the_excess_is_in_newtons(make_profile):
    profile = make_profile(max_gain_db=0.0)
    low, high = profile.force_range
    force = np.array([0.0, 0.02, high / 2 + 0.03, -high / 2 - 0.01])
    drive, report = profile.drive(force, SPEED)
    assert (low, high) == (0.0, pytest.approx(6e-6 * 180**2))
    assert (report.clipped, report.share) == (2, 0.5)
    assert report.largest_excess == pytest.approx(0.03)
    assert profile.drive(-force, SPEED)[1].largest_excess == pytest.approx(0.03)  # at the lower end as well
    assert drive[2] == 180.0 and drive[3] == 0.0
    assert drive[1] == pytest.approx(np.sqrt((high / 2 + 0.02) / 6e-6))


@pytest.mark.parametrize(("kind", "bias"), [("electroadhesion", 0.03), ("ultrasonic", -0.03)])
def test_the_bias_is_the_mean_change_of_friction(make_profile, feel, noise_texture, kind, bias):
    profile = make_profile(kind)
    texture = noise_texture(rms=0.002)
    drive, report = profile.drive(texture, SPEED, bias=bias)
    assert report.clipped == 0
    assert feel(kind, drive, 300.0).mean() == pytest.approx(profile.offset + bias, abs=1e-4)
    assert profile.stream().bias == pytest.approx(sum(profile.force_range) / 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"force": np.zeros((80, 2))}, r"got \(80, 2\): a display has one drive.*stream.read_friction\(samples\)"),
        ({"force": [0.0, 350.0]}, "`force` must be in N, got 350.*probably in mN: divide by 1000"),
        ({"speed": [80.0, 80.0, 80.0]}, "`speed` must be one number or one per sample of `force`, 2, got 3"),
        ({"sampling_rate": -10000}, "`sampling_rate` must be a finite number above 0 in Hz, got -10000"),
        ({"bias": -0.1}, "`bias` must be within 0 and 0.1944 N.*got -0.1.*Leave it out"),
    ],
)
def test_bad_arguments(make_profile, change, message):
    with pytest.raises(ValueError, match=message):
        make_profile().drive(**{"force": [0.0, 0.01], "speed": SPEED, **change})
