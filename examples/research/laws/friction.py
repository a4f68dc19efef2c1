"""Laws of the mean friction and of stick-slip."""

from dataclasses import replace

import numpy as np
from scipy import signal

from tactile_diffusers.signal import DEVICE_RATE, band_levels_db
from tactile_diffusers.virtual.friction import PERIOD_JITTER
from tactile_diffusers.virtual.laws import (
    AMPLITUDE_SPEED_EXPONENT,
    COMPLIANT_BACKGROUND_EXPONENT,
    COMPLIANT_FRICTION,
    COMPLIANT_SPEED_EXPONENT,
    SLIPPING_SHARE,
    stick_slip_rate,
)
from tactile_diffusers.virtual.percepts import STICK_SLIP_DUTY
from tactile_diffusers.virtual.profile import PERIOD_MM
from tactile_diffusers.virtual.recipe import CLASSES, load_exponent

from .law import PLAIN, Check, Law, draw_power_law, exponent, finish, slide
from .texture import FORCES, SPEEDS


def measured_friction(surface, speed, normal_force):
    """Mean lateral over mean normal force of one period of the surface."""
    force = slide(surface, speed, PERIOD_MM / speed, normal_force)
    return float(force[:, 0].mean() / force[:, 2].mean())


def friction_coefficient(quick=False):
    """Friction coefficient over normal force and speed."""
    loads, powers = (-1 / 3, -1 / 6, 0.0), (-0.15, 0.0, 0.15)
    by_load = {e: [measured_friction(replace(PLAIN, load_exponent=e), 80.0, f) for f in FORCES] for e in loads}
    by_speed = {e: [measured_friction(replace(PLAIN, speed_exponent=e), v, 0.5) for v in SPEEDS] for e in powers}
    slopes = [bound for material in CLASSES for bound in material.slope]
    checks = [
        Check("load exponent of the smoothest profile", -1 / 3, load_exponent(max(slopes)), 1e-9),
        Check("load exponent of the roughest profile", 0.0, load_exponent(min(slopes)), 1e-9),
        *(Check(f"exponent of force at {e:.2f}", e, exponent(FORCES, values), 0.01) for e, values in by_load.items()),
        *(Check(f"exponent of speed at {e:g}", e, exponent(SPEEDS, values), 0.01) for e, values in by_speed.items()),
        Check("coefficient at 0.5 N, 80 mm/s", PLAIN.friction, by_load[0.0][FORCES.index(0.5)], 0.01),
    ]

    def draw(panels):
        for number, (e, values) in enumerate(by_load.items()):
            draw_power_law(panels[0], FORCES, values, e, f"exponent {e:.2f}", f"C{number}")
        for number, (e, values) in enumerate(by_speed.items()):
            draw_power_law(panels[1], SPEEDS, values, e, f"exponent {e:g}", f"C{number}")
        finish(panels[0], "over force, 80 mm/s", "normal force, N", "friction coefficient", ticks=FORCES)
        finish(panels[1], "over speed, 0.5 N", "speed, mm/s", "friction coefficient", ticks=SPEEDS)

    source = "-1/3 on smooth glass to 0 on rough surfaces (PMC5332579; Seo 2009: -0.2); speed: recipe"
    return Law("Friction coefficient over normal force and speed", source, tuple(checks), 2, draw)


def compliant_grating(quick=False):
    """Friction and background of gratings of three compliances over speed."""
    takes, band = 4 if quick else 40, np.array([25.0, 100.0])
    friction, background = {}, {}
    for compliance in (0.0, 0.5, 1.0):
        # lines above 133 Hz; between 25 and 100 Hz only the background
        surface = replace(PLAIN, compliance=compliance, grating_level=0.4, wavelength=0.225, friction=0.6)
        friction[compliance] = [measured_friction(surface, speed, 0.5) for speed in SPEEDS]
        background[compliance] = [_band_power(surface, speed, band, takes) for speed in SPEEDS]
    checks = []
    for c in friction:
        more = friction[c][SPEEDS.index(80.0)] / friction[0.0][SPEEDS.index(80.0)]
        rise = exponent(SPEEDS, friction[c])
        fall = exponent(SPEEDS, background[c])
        checks += [
            Check(f"friction over that of a rigid one, c = {c:g}", 1 + COMPLIANT_FRICTION * c, more, 0.01),
            Check(f"exponent of friction over speed, c = {c:g}", COMPLIANT_SPEED_EXPONENT * c, rise, 0.01),
            # 40 (4) takes scatter by 0.03 (0.1)
            Check(f"exponent of background power, c = {c:g}", _background_exponent(c), fall, 0.3 if quick else 0.15),
        ]

    def draw(panels):
        for number, c in enumerate(friction):
            label, colour = f"compliance {c:g}", f"C{number}"
            draw_power_law(panels[0], SPEEDS, friction[c], COMPLIANT_SPEED_EXPONENT * c, label, colour)
            draw_power_law(panels[1], SPEEDS, background[c], _background_exponent(c), label, colour)
        finish(panels[0], "friction coefficient", "speed, mm/s", "", ticks=SPEEDS)
        finish(panels[1], "background, 25-100 Hz", "speed, mm/s", "N²", ticks=SPEEDS)

    source = "friction higher and rising, background falling with speed (Brewer, Meyer 2014); sizes: recipe"
    return Law("Compliant gratings over speed", source, tuple(checks), 2, draw)


def _background_exponent(compliance):
    """Of the power of a 1/f background over speed: squared amplitude, times that of the compliance."""
    return 2 * (AMPLITUDE_SPEED_EXPONENT + COMPLIANT_BACKGROUND_EXPONENT * compliance)


def _band_power(surface, speed, band, takes):
    forces = [slide(surface, speed, PERIOD_MM / speed, seed=take)[:, 0] for take in range(takes)]
    return float(np.mean(10 ** (band_levels_db(forces, DEVICE_RATE, band) / 10)))


def stick_slip(quick=False):
    """Periods between drops, and size of the fluctuation, on a sticky surface without texture."""
    surface = replace(PLAIN, amplitude=1e-3, friction=1.5, stick=0.7)
    sliding, seconds = surface.friction * 0.5, 10.0 if quick else 40.0
    forces = [slide(surface, speed, seconds, seed=number)[:, 0] for number, speed in enumerate(SPEEDS)]
    periods = [_periods(force) for force in forces]
    rates = np.array([1 / np.median(p) for p in periods])
    intended = np.array([stick_slip_rate(surface, sliding, speed) for speed in SPEEDS])
    ratio = rates / intended
    fluctuation = float(np.sqrt(np.mean([np.var(force) for force in forces]))) / sliding
    checks = (
        Check("rate over k v / (stick mu Fn), mean over speeds", 1.0, float(ratio.mean()), 0.05),
        Check("the same, fastest over slowest", 1.0, float(ratio[-1] / ratio[0]), 0.1),
        Check("spread of log periods", PERIOD_JITTER, float(np.mean([np.log(p).std() for p in periods])), 0.06),
        # slowly on and off (0.5 s): 60 (15) s of independent halves of a second a speed
        Check("rms over mean friction", _fluctuation(surface), fluctuation, 0.2 * _fluctuation(surface)),
    )

    def draw(panels):
        time = np.arange(2000) / DEVICE_RATE
        start = int(np.argmax(np.convolve(np.abs(np.diff(forces[3])), np.ones(2000), "valid")))
        panels[0].plot(time, forces[3][start : start + 2000], linewidth=0.7)
        finish(panels[0], "lateral force at 80 mm/s", "s", "N", legend=False)
        panels[1].plot(SPEEDS, rates, "o", markersize=4, label="median; line: k v / (stick mu Fn)")
        panels[1].plot(SPEEDS, intended, linewidth=1)
        finish(panels[1], "rate of drops", "speed, mm/s", "Hz")
        relative = np.log(np.concatenate([p / np.median(p) for p in periods]))
        panels[2].hist(relative, np.linspace(-1, 1, 41), density=True, alpha=0.5, label="measured")
        x = np.linspace(-1, 1, 200)
        normal = np.exp(-0.5 * (x / PERIOD_JITTER) ** 2) / PERIOD_JITTER / np.sqrt(2 * np.pi)
        panels[2].plot(x, normal, label="intended")
        finish(panels[2], "log period over its median", "", "density")

    source = "charge rate k v, drop of 5 % stick mu Fn, jitter: recipe; k rises by 4.04 N/m per mm/s (arXiv 2505.11162)"
    return Law("Stick-slip: rate over speed, and its fluctuation", source, checks, 3, draw)


def _periods(force):
    """Seconds between the ends of drops while stick-slip is on."""
    smooth = signal.sosfiltfilt(signal.butter(2, 1000, fs=DEVICE_RATE, output="sos"), force)
    ends, facts = signal.find_peaks(-smooth, prominence=0.005)
    periods = np.diff(ends) / DEVICE_RATE
    # a pause is no period: only between strong drops
    strong = facts["prominences"] > 0.01
    periods = periods[strong[1:] & strong[:-1]]
    return periods[periods < 2 * np.median(periods)]


def _fluctuation(surface):
    """rms of stick-slip over the mean friction: a triangle of log-normal periods, at `STICK_SLIP_DUTY` of its power.

    The mean square of (L w - 1/2) over time with w uniform in 0-1 is (E[L^3] / 3 - E[L^2] / 2 + E[L] / 4) / E[L].
    """
    moment = [np.exp(0.5 * (order * PERIOD_JITTER) ** 2) for order in (1, 2, 3)]
    square = (moment[2] / 3 - moment[1] / 2 + moment[0] / 4) / moment[0]
    return float(SLIPPING_SHARE * surface.stick * np.sqrt(STICK_SLIP_DUTY * square))
