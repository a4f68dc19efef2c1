"""A drive profile from a recording of a finger on the display under a pseudo-random or swept command."""

import math
import warnings
from dataclasses import dataclass

import numpy as np
from scipy import optimize, signal

from ..signal import BAND_HZ, band_edges
from ..signal.checks import check_number, check_samples
from ..signal.constants import LARGEST_FORCE_N
from .drive_curves import check_kind, check_lookup, friction_change
from .drive_profile import DriveProfile

#: Hann windows of 0.2 s, half overlapping: bins of 5 Hz, as in `signal.power_spectral_density`, and far longer than
#: the response of any low-pass with its corner in the band.
WINDOW_SECONDS = 0.2
#: A shorter recording has fewer than 20 windows: too few to distinguish coherence from chance, which gives 1 / windows.
SHORTEST_SECONDS = 2.1
#: Least mean coherence in each of the nine bands: half the power of the force answers to the command. A response at
#: coherence c from n windows has a random error of sqrt((1 - c) / (2 c n)) (Bendat & Piersol, Random Data): 5 % a bin
#: for 20 s at 0.5.
LEAST_COHERENCE = 0.5
#: Share of its range by which the force may bend away from the static curve, half-way, without a warning.
LARGEST_BEND = 0.05
#: Friction coefficients of fingers lie within 0.05 (on a film of air) and 3 (soft and moist on glass, lightly pressed):
#: beyond these wide limits a unit is wrong.
FRICTION_COEFFICIENTS = (0.01, 10.0)
#: Speeds of a sliding finger, mm/s: slower it sticks, and faster no hand is.
SLIDING_SPEEDS = (1.0, 3000.0)


@dataclass(frozen=True)
class DriveFit:
    """A fitted profile and what it was fitted to.

    Args:
        profile (`DriveProfile`): the result.
        frequencies (`np.ndarray`): (bins,) Hz, within 20-1000 Hz.
        response (`np.ndarray`): (bins,) complex, H1 estimate from friction change per gain to force, in units of gain.
        coherence (`np.ndarray`): (bins,) share of the force's power that the command explains, 0-1.
        misfit_db (`float`): RMS difference of |response| and the fitted first-order low-pass, dB.
    """

    profile: DriveProfile
    frequencies: np.ndarray
    response: np.ndarray
    coherence: np.ndarray
    misfit_db: float


def fit_drive_profile(command, measured, sampling_rate, *, kind, normal_force, speed, lookup=None):
    """Fits gain, offset and low-pass corner to one recording at a steady speed and normal force.

    Excite 20-1000 Hz: pseudo-random levels held for one to five samples, or a sweep, both about the middle of the
    drive's range (pseudo-random as in Osgouei, Kim, Choi, IEEE ToH 2020, for an electrovibration display). The command
    goes through the known static curve first; what is left is linear, and its response is estimated as
    H1 = S_xy / S_xx, which noise in the force does not bias. A UserWarning says where the curve does not hold, which
    two levels alone cannot tell: send four or more.

    Args:
        command (`np.ndarray`): (samples,) drive as commanded, V or relative amplitude (0-1).
        measured (`np.ndarray`): (samples,) lateral force along the sliding direction with its mean, N; the same
            instants. A delay of some ms does no harm.
        sampling_rate (`float`): Hz, above 2000.
        kind (`str`): `"electroadhesion"` or `"ultrasonic"`.
        normal_force (`float`): mean normal force, N.
        speed (`float`): mean finger speed, mm/s, 1-3000.
        lookup (`Sequence[tuple[float, float]]`, *optional*): for every display that saturates, and all ultrasonic
            ones, see `DriveProfile`; the fitted gain scales it.

    Returns:
        `DriveFit`: its `profile` has one cutoff, at `speed`, and as its `max_drive` the largest drive in `command`,
            beyond which nothing was measured; `dataclasses.replace(profile, max_drive=...)` sets the device's own.

    Raises:
        ValueError: if an argument is bad, the recording too short, the coherence too low in a band (which is named),
            or the response not that of such a display: the wrong sign, or a corner at or below the band; if force,
            normal force or speed cannot be a finger's in N and mm/s.
    """
    check_kind(kind)
    lookup = check_lookup(kind, lookup)
    rate = check_number("sampling_rate", sampling_rate, "Hz", above=2 * BAND_HZ[1])
    slowest, fastest = SLIDING_SPEEDS
    speed = check_number("speed", speed, "mm/s, as of a sliding finger", at_least=slowest, at_most=fastest)
    normal_force = check_number("normal_force", normal_force, "N", above=0, at_most=LARGEST_FORCE_N)
    command, measured = _check_recording(command, measured, rate, kind, lookup)

    change = friction_change(kind, lookup, command)
    frequencies, response, coherence = _transfer(change, measured, rate)
    _check_coherence(frequencies, coherence)
    _check_sign(response, kind)
    _check_curve(change, measured, rate, response, lookup)
    gain, cutoff, misfit_db = _fit_low_pass(frequencies, response, coherence, rate)
    profile = DriveProfile(
        kind=kind,
        gain=gain,
        offset=float(measured.mean() - gain * change.mean()),
        cutoffs=((speed, cutoff),),
        max_drive=float(np.abs(command).max()),
        normal_force=normal_force,
        lookup=lookup,
    )
    _check_units(profile, measured)
    return DriveFit(profile, frequencies, response, coherence, misfit_db)


def _check_recording(command, measured, rate, kind, lookup):
    command, measured = check_samples("command", command), check_samples("measured", measured)
    if len(command) != len(measured):
        raise ValueError(
            f"`command` and `measured` must be of one length, got {len(command)} and {len(measured)} samples. "
            "Cut both to the time in which both were recorded."
        )
    if len(command) < SHORTEST_SECONDS * rate:
        raise ValueError(
            f"`command` of {len(command) / rate:.3g} s is too short: record at least {SHORTEST_SECONDS} s, better 20 s."
        )
    volts = kind == "electroadhesion"  # +V and -V pull alike
    least = -lookup[-1][0] if lookup and volts else 0
    if lookup and not least <= command.min() <= command.max() <= lookup[-1][0]:
        remedy = "Measure `lookup` that far" if volts else "Divide it by the largest amplitude of the device"
        raise ValueError(
            f"`command` must be within the amplitudes of `lookup`, 0 to {lookup[-1][0]:g}, "
            f"got {command.min():.4g} to {command.max():.4g}. {remedy}."
        )
    change = friction_change(kind, lookup, command)
    if np.ptp(change) <= 1e-9 * np.abs(change).max():
        raise ValueError(
            "`command` does not modulate friction: its steady force is constant. For electroadhesion +V and -V pull "
            "alike, so switch between two levels of the same sign."
        )
    return command, measured


def _check_units(profile, measured):
    """Refuses a good fit to forces in mN, or to a normal force in g."""
    mean, normal_force = float(measured.mean()), profile.normal_force
    least, most = FRICTION_COEFFICIENTS
    # with the drive's own part: a gain that is too large shows as well
    coefficient = max(mean, np.ptp(profile.force_range)) / normal_force
    if not least <= coefficient <= most:
        which, other = ("measured", "normal_force") if coefficient > most else ("normal_force", "measured")
        raise ValueError(
            f"`measured` of {mean:.4g} N on average at a `normal_force` of {normal_force:.4g} N is a friction "
            f"coefficient of {coefficient:.3g}; fingers have {least:g} to {most:g}. `{which}` is probably in mN, or "
            f"`{other}` in a larger unit: give both in N."
        )


def _transfer(change, measured, rate):
    """H1 and coherence at the frequencies of the band."""
    window = round(WINDOW_SECONDS * rate)
    options = {"fs": rate, "window": "hann", "nperseg": window}
    frequencies, cross = signal.csd(change, measured, **options)
    power_in, power_out = (signal.welch(values, **options)[1] for values in (change, measured))
    band = (frequencies >= BAND_HZ[0]) & (frequencies <= BAND_HZ[1])
    frequencies, cross, power_in, power_out = (v[band] for v in (frequencies, cross, power_in, power_out))
    tiny = np.finfo(np.float64).tiny
    coherence = np.abs(cross) ** 2 / np.maximum(power_in * power_out, tiny)
    return frequencies, cross / np.maximum(power_in, tiny), coherence


def _check_coherence(frequencies, coherence):
    edges = band_edges()
    means = {}
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        mean = float(coherence[(frequencies >= low) & (frequencies <= high)].mean())
        if mean < LEAST_COHERENCE:
            means[f"{low:.0f}-{high:.0f} Hz"] = mean
    if means:
        bands = ", ".join(f"{mean:.2f} at {band}" for band, mean in means.items())
        raise ValueError(
            f"The coherence of `command` and `measured` must be at least {LEAST_COHERENCE:g} in every band, got "
            f"{bands}. Excite these frequencies more strongly, record longer at a steady speed, and check `kind` and "
            "that both channels start together."
        )


def _check_sign(response, kind):
    # the lowest bins, where neither the low-pass nor a delay has turned the phase
    if response[:3].real.sum() <= 0:
        raise ValueError(
            f"`measured` falls where the friction of an {kind} display rises. Give the force along the sliding "
            "direction as positive, or check `kind`."
        )


def _check_curve(change, measured, rate, response, lookup):
    """Warns where the force answers also to the square of the change, apart from what it has in common with it."""
    x = (change - change.mean()) / np.ptp(change)
    square = x**2 - np.polyval(np.polyfit(x, x**2, 1), x)
    if np.ptp(square) < 1e-6:
        return  # two levels
    to_force, to_change = (_transfer(square, values, rate)[1] for values in (measured, change))
    bend = 0.25 * np.vdot(response, to_force - response * to_change).real / np.vdot(response, response).real
    bend = abs(bend) / np.ptp(change)
    if bend > LARGEST_BEND:
        curve = "`lookup`" if lookup else "the square of the drive"
        warnings.warn(
            f"The force does not follow {curve}: half-way it is {100 * bend:.0f} % of its range off, as of a display "
            "that saturates. Give as `lookup` what friction steady drives add or take away.",
            UserWarning,
            stacklevel=3,
        )


def _fit_low_pass(frequencies, response, coherence, rate):
    """Gain, corner (Hz) and RMS misfit (dB) of the sampled first-order low-pass, by its logarithmic magnitude.

    The magnitude, not the phase: a delay of the recording must not pass for a low-pass.
    """
    measured = np.log(np.maximum(np.abs(response), np.finfo(np.float64).tiny))
    trusted = np.minimum(coherence, 0.99)  # no few bins may rule the fit
    weights = np.sqrt(trusted / (1 - trusted))  # one over the standard deviation of the logarithm

    def model(parameters):
        pole = np.exp(-2 * np.pi * np.exp(parameters[1]) / rate)
        return parameters[0] + np.log((1 - pole) / np.abs(1 - pole * np.exp(-2j * np.pi * frequencies / rate)))

    lowest, highest = BAND_HZ[0], rate / 2
    fit = optimize.least_squares(
        lambda parameters: weights * (model(parameters) - measured),
        x0=(measured[:3].mean(), math.log(math.sqrt(lowest * highest))),
        bounds=((-np.inf, math.log(lowest)), (np.inf, math.log(highest))),
    )
    gain, cutoff = np.exp(fit.x).tolist()
    if cutoff < 1.05 * lowest:
        raise ValueError(
            f"`measured` falls off over the whole band: the low-pass has its corner at or below {lowest:g} Hz, and its "
            "gain cannot be estimated. Check the sensor's own filter, or record at a higher speed."
        )
    return gain, cutoff, float(np.sqrt(np.mean((model(fit.x) - measured) ** 2)) * 20 / math.log(10))
