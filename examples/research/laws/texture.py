"""Laws of the texture: spectra of profile and noise, gratings, amplitude, and the finger that low-passes them."""

from dataclasses import replace

import numpy as np
from scipy import optimize, signal

from tactile_diffusers.signal import BAND_HZ, DEVICE_RATE, band_levels_db
from tactile_diffusers.virtual.exploration import POPULATION_SPREAD
from tactile_diffusers.virtual.friction import TEMPORAL_NOISE_N, temporal_noise
from tactile_diffusers.virtual.laws import (
    AMPLITUDE_LOAD_EXPONENT,
    AMPLITUDE_SPEED_EXPONENT,
    CUTOFF_PER_SPEED,
    finger_cutoff,
)
from tactile_diffusers.virtual.profile import HARMONICS, PERIOD_MM, spectrum

from .law import PLAIN, Check, Law, draw_power_law, exponent, finish, slide

SPEEDS = (30.0, 45.0, 66.0, 80.0, 99.0, 120.0)
FORCES = (0.2, 0.3, 0.4, 0.5, 0.6, 0.9)


def mean_spectrum(surface, speed, takes, window=0.3, **finger):
    """Power spectrum of the lateral force, mean over `takes` surfaces that differ by their phases: Hz, N^2/Hz."""
    forces = [slide(surface, speed, PERIOD_MM / speed, seed=take, **finger)[:, 0] for take in range(takes)]
    frequency, power = signal.welch(np.array(forces), DEVICE_RATE, nperseg=int(window * DEVICE_RATE))
    return frequency, power.mean(0)


def profile_slope(quick=False):
    """Power of a surface without grating over spatial frequency."""
    takes, results = 20 if quick else 60, {}
    for slope in (-0.2, 0.4, 1.0, 1.6):
        frequency, power = mean_spectrum(replace(PLAIN, slope=slope), 80.0, takes)
        k = frequency / 80.0
        inside = (k > 0.3) & (k < 2.0)
        results[slope] = k[inside], power[inside] * 80.0, -exponent(k[inside], power[inside])
    # 60 (20) takes leave a standard error of 0.02 (0.03); the finger's low-pass adds 0.02
    checks = (Check(f"exponent at beta = {slope:g}", slope, measured, 0.1) for slope, (*_, measured) in results.items())

    def draw(panels):
        for number, (slope, (k, power, _)) in enumerate(results.items()):
            draw_power_law(panels[0], k, power, -slope, f"beta = {slope:g}", f"C{number}")
        finish(panels[0], "random profile at 80 mm/s", "1/mm", "N² mm", ticks=(0.3, 0.5, 1, 2))

    source = "friction of flat surfaces fluctuates as 1/f (Wiertlewski, Hudin, Hayward 2011); exponents: recipe"
    return Law("Spectrum of a surface without grating: power ~ k^-beta", source, tuple(checks), 1, draw)


def noise_in_time(quick=False):
    """Noise that does not come from the surface."""
    noise = temporal_noise(np.random.default_rng(0), (40 if quick else 120) * DEVICE_RATE)
    frequency, power = signal.welch(noise, DEVICE_RATE, nperseg=DEVICE_RATE)
    inside = (frequency >= BAND_HZ[0]) & (frequency <= BAND_HZ[1])
    level = 10 ** (band_levels_db(noise, DEVICE_RATE, np.array(BAND_HZ))[0] / 20)
    checks = (
        Check("exponent", -1.0, exponent(frequency[inside], power[inside]), 0.05),
        Check("rms, 20-1000 Hz", 1e3 * TEMPORAL_NOISE_N, 1e3 * level, 0.04, "mN"),
    )

    def draw(panels):
        draw_power_law(panels[0], frequency[inside][::5], power[inside][::5], -1.0, "measured; line: 1/f", "C0")
        finish(panels[0], "noise in time", "Hz", "N²/Hz", ticks=(20, 50, 100, 200, 500, 1000))

    source = "1/f: Wiertlewski, Hudin, Hayward 2011; 1.2 mN: recipe"
    return Law("Noise in time: 1/f", source, checks, 1, draw)


def grating_line(quick=False):
    """Frequency of a grating's line at several speeds."""
    wavelengths, seconds = (0.5, 1.25, 2.5), 4.0 if quick else 10.0
    lines = {}
    for wavelength in wavelengths:
        surface = replace(PLAIN, slope=0.6, asperity=0.2, grating_level=1.6, wavelength=wavelength, jitter=0.02)
        lines[wavelength] = [_peak(slide(surface, speed, seconds)[:, 0]) for speed in SPEEDS]
    # 2 %: resolution of 1 Hz, and a jitter of 2 % a period
    checks = (
        Check(
            f"speed / frequency at {wavelength:g} mm", wavelength, float(np.median(SPEEDS / np.array(line))), tol, "mm"
        )
        for (wavelength, line), tol in zip(lines.items(), 0.02 * np.array(wavelengths), strict=True)
    )

    def draw(panels):
        for number, (wavelength, line) in enumerate(lines.items()):
            panels[0].plot(SPEEDS, line, "o", color=f"C{number}", markersize=4, label=f"{wavelength:g} mm; line: v / λ")
            panels[0].plot(SPEEDS, np.array(SPEEDS) / wavelength, color=f"C{number}", linewidth=1)
        finish(panels[0], "strongest line of a grating", "speed, mm/s", "Hz")

    source = "Wiertlewski, Hudin, Hayward 2011"
    return Law("Line of a grating: frequency = speed / wavelength", source, tuple(checks), 1, draw)


def _peak(force):
    frequency, power = signal.welch(force, DEVICE_RATE, nperseg=DEVICE_RATE)
    return frequency[np.argmax(np.where(frequency < 10, 0, power))]


def harmonic_decay(quick=False):
    """Amplitudes of a grating's harmonics; the finger's low-pass is undone."""
    speed, wavelength = 80.0, 1.25
    order = np.arange(1, HARMONICS + 1)
    seconds = PERIOD_MM / speed * (2 if quick else 4)  # whole periods: every line is a bin
    time = np.arange(round(seconds * DEVICE_RATE)) / DEVICE_RATE
    lines = order[:, None] * speed / wavelength
    finger = np.sqrt(1 + (lines[:, 0] / finger_cutoff(speed)) ** 2)
    amplitudes = {}
    for decay in (1.2, 1.7, 2.2):
        surface = replace(PLAIN, slope=1.6, asperity=0.4, grating_level=1.6, harmonic_decay=decay)
        force = slide(surface, speed, seconds)[:, 0]
        amplitudes[decay] = 2 * np.abs(np.exp(-2j * np.pi * lines * time) @ force) / len(force) * finger
    # the random profile has a line at the same place: 2 % of the sixth harmonic's amplitude at worst
    checks = (
        Check(f"exponent at q = {decay:g}", decay, -exponent(order, values), 0.05)
        for decay, values in amplitudes.items()
    )

    def draw(panels):
        for number, (decay, values) in enumerate(amplitudes.items()):
            draw_power_law(panels[0], order, 1e3 * values, -decay, f"q = {decay:g}", f"C{number}")
        finish(panels[0], "harmonics of a grating, 64 Hz", "harmonic", "amplitude, mN", ticks=order)

    source = "a non-integer power law (Wiertlewski, Hudin, Hayward 2011); exponents: recipe"
    return Law("Harmonics of a grating: amplitude ~ i^-q", source, tuple(checks), 1, draw)


def amplitude(quick=False):
    """rms of the friction fluctuation over force and speed, over whole periods of the surface."""
    surface = replace(PLAIN, slope=1.6, asperity=0.4)  # so coarse that the finger's low-pass does not matter
    takes = range(1 if quick else 3)

    def fluctuation(speed, normal_force):
        return np.mean([slide(surface, speed, PERIOD_MM / speed, normal_force, take)[:, 0].std() for take in takes])

    by_force = [fluctuation(80.0, force) for force in FORCES]
    by_speed = [fluctuation(speed, 0.5) for speed in SPEEDS]
    checks = (
        Check("exponent of force", AMPLITUDE_LOAD_EXPONENT, exponent(FORCES, by_force), 0.02),
        Check("exponent of speed", AMPLITUDE_SPEED_EXPONENT, exponent(SPEEDS, by_speed), 0.02),
    )

    def draw(panels):
        label = "measured; line: intended"
        draw_power_law(panels[0], FORCES, 1e3 * np.array(by_force), AMPLITUDE_LOAD_EXPONENT, label, "C0")
        draw_power_law(panels[1], SPEEDS, 1e3 * np.array(by_speed), AMPLITUDE_SPEED_EXPONENT, label, "C1")
        finish(panels[0], "fluctuation over force, 80 mm/s", "normal force, N", "rms, mN", ticks=FORCES)
        finish(panels[1], "fluctuation over speed, 0.5 N", "speed, mm/s", "rms, mN", ticks=SPEEDS)

    title = "Amplitude of the fluctuation: ~ force^0.8 speed^0.3"
    return Law(title, "recipe; power grows with speed (Bensmaia & Hollins 2003)", checks, 2, draw)


def finger_low_pass(quick=False):
    """Cutoff of the finger, from the spectrum of a nearly white surface whose own spectrum is known."""
    surface, takes = replace(PLAIN, slope=-0.2), 6 if quick else 50
    speeds = (20.0, 40.0, 60.0, 80.0, 100.0)
    other = float(np.exp(POPULATION_SPREAD.cutoff))
    fits = {factor: [_fit_cutoff(surface, speed, takes, factor) for speed in speeds] for factor in (1.0, other)}
    cutoffs = {factor: np.array([cutoff for cutoff, _ in fit]) for factor, fit in fits.items()}
    # the recursion at 10 kHz passes up to 6 % higher than an analogue filter of the same cutoff near 1.4 kHz
    checks = (
        Check(
            f"Hz per mm/s, cutoff factor {factor:.2f}", factor * CUTOFF_PER_SPEED, float(np.mean(values / speeds)), 1.0
        )
        for factor, values in cutoffs.items()
    )

    def draw(panels):
        for number, (speed, (_, (frequency, gain))) in enumerate(zip(speeds, fits[1.0], strict=True)):
            panels[0].loglog(frequency, gain, color=f"C{number}", linewidth=0.8, label=f"{speed:g} mm/s")
            intended = 1 / (1 + (frequency / finger_cutoff(speed)) ** 2)
            panels[0].loglog(frequency, intended, color=f"C{number}", linestyle="--", linewidth=0.8)
        panels[0].set_ylim(0.2, 1.5)
        finish(panels[0], "gain of the finger (power); dashed: intended", "Hz", "", ticks=(50, 100, 200, 500, 1000))
        for number, (factor, values) in enumerate(cutoffs.items()):
            label = f"factor {factor:.2f}; line: intended"
            panels[1].plot(speeds, values, "o", color=f"C{number}", markersize=4, label=label)
            panels[1].plot(speeds, [finger_cutoff(v, factor) for v in speeds], color=f"C{number}", linewidth=1)
        finish(panels[1], "cutoff over speed", "speed, mm/s", "Hz")

    source = "arXiv 2505.11162; factor of further fingers: recipe"
    return Law("Low-pass of the finger: 13.8 Hz per mm/s", source, tuple(checks), 2, draw)


def _fit_cutoff(surface, speed, takes, factor):
    """Cutoff (Hz) that explains the measured spectrum, and (frequencies, gain of the power)."""
    frequency, power = mean_spectrum(surface, speed, takes, window=0.05, cutoff=factor)
    highest = min(2 * finger_cutoff(speed, factor), 20 * speed)  # finer profiles are interpolated: not all there
    inside = (frequency > 40) & (frequency < highest)
    frequency, gain = frequency[inside], power[inside] / spectrum(surface, frequency[inside] / speed)

    def low_pass(f, scale, cutoff):
        return scale - np.log1p((f / cutoff) ** 2)

    start = np.log(gain[:5].mean()), finger_cutoff(speed)
    (scale, cutoff), _ = optimize.curve_fit(low_pass, frequency, np.log(gain), p0=start)
    return abs(float(cutoff)), (frequency, gain / np.exp(scale))
