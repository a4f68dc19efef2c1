"""A profile fitted to a recording has the gain, offset and corner that made the recording."""

import json

import numpy as np
import pytest
from scipy import signal

from tactile_diffusers.display import fit_drive_profile, read_drive_calibration
from tactile_diffusers.signal import nine_band_error_db

RATE = 10_000
KINDS = ("electroadhesion", "ultrasonic")
GAINS = {"electroadhesion": 6e-6, "ultrasonic": 1.0}


@pytest.fixture
def recording(make_profile, feel, excitation):
    """Arguments of `fit_drive_profile` for a simulated recording."""

    def make(kind="electroadhesion", cutoff=300.0, shape="random", noise=0.0, seconds=6.0):
        command = excitation(kind, shape, seconds)
        return {
            "command": command,
            "measured": feel(kind, command, cutoff, noise=noise),
            "sampling_rate": RATE,
            "kind": kind,
            "normal_force": 0.5,
            "speed": 80.0,
            "lookup": make_profile(kind).lookup,
        }

    return make


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("shape", ["random", "sweep"])
@pytest.mark.parametrize("cutoff", [60.0, 300.0, 900.0])
def test_the_fit_finds_what_made_the_recording(recording, kind, shape, cutoff):
    fit = fit_drive_profile(**recording(kind, cutoff, shape))
    profile = fit.profile
    [(speed, corner)] = profile.cutoffs
    # without noise only the leakage of the windows errs: 0.2 % in gain and corner at 60 Hz, less above
    assert corner == pytest.approx(cutoff, rel=0.005)
    assert profile.gain == pytest.approx(GAINS[kind], rel=0.003)
    assert profile.offset == pytest.approx(0.3, abs=0.0003)
    assert (speed, profile.normal_force) == (80.0, 0.5)
    assert fit.misfit_db < 0.05 and fit.coherence.min() > 0.99
    assert fit.frequencies[0] >= 20 and fit.frequencies[-1] <= 1000
    assert fit.response.shape == fit.coherence.shape == fit.frequencies.shape
    assert profile.max_drive == (140.0 if kind == "electroadhesion" else pytest.approx(0.7))  # the largest calibrated


@pytest.mark.parametrize("saturates", [False, True])
@pytest.mark.parametrize("levels", [(60, 100, 130, 160), tuple(range(161))])
def test_a_display_that_saturates_is_noticed(levels, saturates, recwarn):
    rng = np.random.default_rng(0)
    volts = np.repeat(rng.choice(np.array(levels, dtype=float), 30_000), 2)
    steady = 0.12 * np.tanh((volts / 140) ** 2) if saturates else 6e-6 * volts**2
    force = 0.3 + signal.lfilter([0.17], [1, -0.83], steady) + rng.normal(0, 0.005, len(volts))
    options = {"kind": "electroadhesion", "normal_force": 0.5, "speed": 80.0}
    fit_drive_profile(volts, np.roll(force, 30), RATE, **options)  # 3 ms late
    assert ["does not follow the square of the drive" in str(one.message) for one in recwarn] == [True] * saturates
    if saturates:
        table = [(v, 0.12 * np.tanh((v / 140) ** 2)) for v in range(0, 161, 20)]
        recwarn.clear()
        fit = fit_drive_profile(volts, force, RATE, lookup=table, **options)
        assert not recwarn and fit.profile.steady_force(80) == pytest.approx(0.0379, rel=0.02)


@pytest.mark.parametrize("shape", ["random", "sweep"])
@pytest.mark.parametrize("cutoff", [300.0, 900.0])
def test_noise_and_a_delay_do_not_bias_the_fit(recording, shape, cutoff):
    """5 mN of white noise, the coherence falls to 0.7; and the force comes 3 ms late."""
    arguments = recording(cutoff=cutoff, shape=shape, noise=0.005)
    late = 30
    arguments["command"], arguments["measured"] = arguments["command"][:-late], arguments["measured"][late:]
    arguments["command"], arguments["measured"] = arguments["command"][late:], arguments["measured"][:-late]
    profile = fit_drive_profile(**arguments).profile
    # about 50 windows and 200 bins: 1 % in the corner, tested at three times that
    assert profile.cutoffs[0][1] == pytest.approx(cutoff, rel=0.03)
    assert profile.gain == pytest.approx(6e-6, rel=0.01)


@pytest.mark.parametrize("kind", KINDS)
def test_from_recording_to_finger(recording, feel, noise_texture, kind):
    """Calibrate with noise, then play: within the decibel, and in fact within a fifth of one."""
    profile = fit_drive_profile(**recording(kind, noise=0.002)).profile
    texture = noise_texture(seed=5, rms=0.004)
    drive, report = profile.drive(texture, 80.0)
    assert report.clipped == 0
    felt = feel(kind, drive, 300.0)
    assert nine_band_error_db(felt - felt.mean(), texture, RATE) < 0.2


def test_a_flat_display_is_fitted_too(recording):
    """No low-pass in the band: the corner is somewhere above, and the gain right."""
    arguments = recording()
    arguments["measured"] = 0.3 + 6e-6 * arguments["command"] ** 2
    profile = fit_drive_profile(**arguments).profile
    assert profile.cutoffs[0][1] > 2000
    # the corner ends at half the rate, which bends the top of the band by 0.3 %
    assert profile.gain == pytest.approx(6e-6, rel=0.005)


def test_low_coherence_is_refused_and_the_band_named(recording, excitation):
    # a sweep up to 400 Hz leaves the two highest bands to the noise
    arguments = recording(noise=0.002)
    time = np.arange(len(arguments["command"])) / RATE
    noise = arguments["measured"] - recording()["measured"]
    command = np.sqrt(
        1e4 + 6e3 * signal.chirp(time, 10, time[-1], 400, method="logarithmic")
    )  # no harmonic in its square
    arguments |= {"command": command, "measured": 0.3 + 6e-6 * command**2 + noise}
    with pytest.raises(ValueError, match="coherence.*at least 0.5 in every band, got 0.[01].*at 419-647 Hz, 0.0"):
        fit_drive_profile(**arguments)
    with pytest.raises(ValueError, match="at 20-31 Hz.*at 31-48 Hz.*at 647-1000 Hz"):
        unrelated = np.random.default_rng(7).normal(size=len(command))
        fit_drive_profile(**{**recording(), "measured": unrelated})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"measured": np.zeros(60000)[:-1]}, "`command` and `measured` must be of one length, got 60000 and 59999"),
        ({"measured": np.r_[np.zeros(59999), np.nan]}, "`measured` must be finite, got nan at sample 59999"),
        ({"sampling_rate": 1000}, "`sampling_rate` must be.*above 2000"),
        ({"sampling_rate": 100_000}, "`command` of 0.6 s is too short: record at least 2.1 s"),
        ({"speed": 0.08}, "`speed` must be .* of at least 1 and of at most 3000 in mm/s, as of a sliding finger"),
        ({"normal_force": -0.5}, "`normal_force` must be.*got -0.5"),
        ({"kind": "magnetic"}, "`kind` must be one of"),
        ({"kind": "ultrasonic"}, "`lookup` is missing"),
        ({"lookup": ((0.0, 0.0), (25.0, 0.4), (50.0, 1.0))}, "`command` must be within .*Measure `lookup` that far"),
        ({"command": np.full(60000, 100.0)}, "`command` does not modulate friction"),
        ({"command": np.where(np.arange(60000) % 7 < 3, -100.0, 100.0)}, "does not modulate.*two levels of the same"),
    ],
)
def test_bad_arguments(recording, change, message):
    with pytest.raises(ValueError, match=message):
        fit_drive_profile(**{**recording(), **change})


@pytest.mark.parametrize(
    ("measured", "change", "message"),
    [
        (lambda force: -force, {}, "`measured` falls where the friction of an electroadhesion display rises"),
        (lambda force: force - force.mean(), {}, "`offset`"),
        (lambda force: 1000 * force, {"normal_force": 500.0}, "`normal_force` must be .* at most 100 in N, got 500"),
        (lambda force: 50 * force, {}, "friction coefficient of 36.9; .*`measured` is probably in mN"),
        (lambda force: force, {"normal_force": 50.0}, "coefficient of 0.00738.*`normal_force` is probably in mN"),
    ],
)
def test_bad_recordings(recording, measured, change, message):
    arguments = recording()
    with pytest.raises(ValueError, match=message):
        fit_drive_profile(**{**arguments, "measured": measured(arguments["measured"]), **change})


def test_a_corner_below_the_band_and_percent_are_refused(recording):
    with pytest.raises(ValueError, match="corner at or below 20 Hz"):
        fit_drive_profile(**recording(cutoff=4.0))
    ultrasonic = recording("ultrasonic")
    with pytest.raises(ValueError, match="`command` must be within the amplitudes of `lookup`, 0 to 1, got 30 to 70"):
        fit_drive_profile(**{**ultrasonic, "command": 100 * ultrasonic["command"]})


@pytest.fixture
def calibration(tmp_path, recording):
    """Writes the files of a calibration and returns the JSON file and its content."""

    def write(kind="electroadhesion", **changes):
        arguments = recording(kind, seconds=2.5)
        table, lookup = np.stack([arguments.pop("command"), arguments.pop("measured")], axis=1), arguments["lookup"]
        np.savetxt(tmp_path / "strokes.csv", table, delimiter=",", header="drive,lateral_force", comments="")
        if lookup:
            options = {"delimiter": ",", "header": "amplitude,friction_reduction", "comments": ""}
            np.savetxt(tmp_path / "curve.csv", lookup, **options)
        units = {"force": "N", "speed": "mm/s", "frequency": "Hz", "drive": "1" if lookup else "V"}
        content = {"format": "tactile-drive-calibration", "version": 1, "units": units, **arguments}
        content |= {"recording": "strokes.csv", "lookup": "curve.csv" if lookup else None, **changes}
        path = tmp_path / "calibration.json"
        path.write_text(json.dumps(content), encoding="utf-8")
        return path

    return write


@pytest.mark.parametrize("kind", KINDS)
def test_a_calibration_file_makes_a_profile(calibration, kind):
    profile = fit_drive_profile(**read_drive_calibration(calibration(kind))).profile
    assert profile.kind == kind and profile.normal_force == 0.5
    assert profile.cutoffs[0] == (80.0, pytest.approx(300.0, rel=0.01))


def test_bad_calibration_files(calibration):
    with pytest.raises(ValueError, match='"format": "tactile-drive-calibration"'):
        read_drive_calibration(calibration(format="tactile-drive-profile"))
    with pytest.raises(FileNotFoundError, match="other.csv, which .* names as its `recording`"):
        read_drive_calibration(calibration(recording="other.csv"))
