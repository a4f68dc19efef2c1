"""Laws of the texture: spectra of profile and noise, gratings, impulses, amplitude, and the finger's low-pass."""

from dataclasses import replace

import numpy as np
from scipy import optimize, signal

from tactile_diffusers.signal import BAND_HZ, DEVICE_RATE, band_levels_db
from tactile_diffusers.signal.waveform_shape import waveform_shape
from tactile_diffusers.virtual.exploration import POPULATION_SPREAD, steady_exploration
from tactile_diffusers.virtual.friction import TEMPORAL_NOISE_N, contact_force, temporal_noise
from tactile_diffusers.virtual.laws import COMMON_GAIN, CUTOFF_PER_SPEED, finger_cutoff
from tactile_diffusers.virtual.relief import (
    CATCH_SPREAD,
    HARMONICS,
    PERIOD_MM,
    RELEASE_LENGTH,
    catch_response,
    profile_tables,
    spectrum,
)

from .law import FORCES, PLAIN, SPEEDS, Check, Law, exponent, slide


def mean_spectrum(surface, speed, takes, window=0.3, **finger):
    """Power spectrum of the lateral force, mean over `takes` surfaces that differ by their phases: Hz, N^2/Hz."""
    forces = [slide(surface, speed, PERIOD_MM / speed, seed=take, **finger)[:, 0] for take in range(takes)]
    frequency, power = signal.welch(np.array(forces), DEVICE_RATE, nperseg=int(window * DEVICE_RATE))
    return frequency, power.mean(0)


def profile_slope(quick=False):
    """Power of a surface without grating over spatial frequency."""
    takes, checks = 20 if quick else 60, []
    for slope in (-0.2, 0.4, 1.0, 1.6):
        frequency, power = mean_spectrum(replace(PLAIN, slope=slope), 80.0, takes)
        k = frequency / 80.0
        inside = (k > 0.3) & (k < 2.0)
        # 60 (20) takes leave a standard error of 0.02 (0.03); the finger's low-pass adds 0.02
        checks.append(Check(f"exponent at beta = {slope:g}", slope, -exponent(k[inside], power[inside]), 0.1))
    source = "friction of flat surfaces fluctuates as 1/f (Wiertlewski, Hudin, Hayward 2011); exponents: recipe"
    return Law("Spectrum of a surface without grating: power ~ k^-beta", source, tuple(checks))


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
    return Law("Noise in time: 1/f", "1/f: Wiertlewski, Hudin, Hayward 2011; 1.2 mN: recipe", checks)


def grating_line(quick=False):
    """Frequency of a grating's line at several speeds."""
    speeds, checks = np.array(SPEEDS), []
    for wavelength in (0.5, 1.25, 2.5):
        surface = replace(PLAIN, slope=0.6, asperity=0.2, grating_level=1.6, wavelength=wavelength, jitter=0.02)
        line = np.array([_peak(slide(surface, speed, 4.0 if quick else 10.0)[:, 0]) for speed in SPEEDS])
        # 2 %: resolution of 1 Hz, and a jitter of 2 % a period
        found = float(np.median(speeds / line))
        checks.append(Check(f"speed / frequency at {wavelength:g} mm", wavelength, found, 0.02 * wavelength, "mm"))
    title = "Line of a grating: frequency = speed / wavelength"
    return Law(title, "Wiertlewski, Hudin, Hayward 2011", tuple(checks))


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
    checks = []
    for decay in (1.2, 1.7, 2.2):
        surface = replace(PLAIN, slope=1.6, asperity=0.4, grating_level=1.6, harmonic_decay=decay)
        force = slide(surface, speed, seconds)[:, 0]
        values = 2 * np.abs(np.exp(-2j * np.pi * lines * time) @ force) / len(force) * finger
        # the random profile has a line at the same place: 2 % of the sixth harmonic's amplitude at worst
        checks.append(Check(f"exponent at q = {decay:g}", decay, -exponent(order, values), 0.05))
    source = "a non-integer power law (Wiertlewski, Hudin, Hayward 2011); exponents: recipe"
    return Law("Harmonics of a grating: amplitude ~ i^-q", source, tuple(checks))


def envelope(quick=False):
    """Kurtosis of a profile without catches, which its log-normal envelope sets."""
    takes, strengths = 20 if quick else 60, np.array([0.0, 0.15, 0.3, 0.45])
    measured = []
    for strength in strengths:
        surface = replace(PLAIN, slope=0.0, intermittency=strength)
        profile = np.stack([profile_tables(surface, np.random.default_rng(take))[:, 0] for take in range(takes)])
        measured.append(float(np.mean(profile**4) / np.mean(profile**2) ** 2))
    intended = 3 * np.exp(4 * strengths**2)
    # the envelope of 120 mm has about fifty independent parts: 60 (20) takes leave 2 % (4 %)
    share = 0.15 if quick else 0.08
    checks = [
        Check(f"kurtosis at intermittency {s:g}", float(k), m, share * float(k))
        for s, k, m in zip(strengths, intended, measured, strict=True)
    ]
    source = "envelopes of all bands move together (McDermott & Simoncelli 2011); sizes: recipe"
    return Law("Envelope of a profile: kurtosis = 3 exp(4 s²)", source, tuple(checks))


def catches(quick=False):
    """Power of isolated catches, and the polarity that they give the force in both directions of motion."""
    surface, speed, takes = replace(PLAIN, catches=5.0, catch_height=40.0), 80.0, 8 if quick else 30
    there = steady_exploration(speed, 0.5, PERIOD_MM / speed)
    forces = {sense: [] for sense in (1, -1)}
    for take in range(takes):
        tables = profile_tables(surface, np.random.default_rng(take))
        for sense, found in forces.items():
            stroke = replace(there, track_speed=sense * there.track_speed)
            found.append(contact_force(np.random.default_rng(take), surface, tables, stroke)[:, 0])
    frequency, power = signal.welch(np.array(forces[1]), DEVICE_RATE, nperseg=3000)
    power = power.mean(0)
    inside = (frequency >= BAND_HZ[0]) & (frequency <= BAND_HZ[1])
    height = surface.catch_height**2 * np.exp(2 * CATCH_SPREAD**2)
    shape = 2 * surface.catches * height * np.abs(catch_response(surface, frequency / speed)) ** 2
    expected = (COMMON_GAIN * 1e-3 * surface.amplitude) ** 2 * shape / speed
    expected = expected / (1 + (frequency / finger_cutoff(speed)) ** 2)
    skews = [float(waveform_shape(found)["slope_skew"].mean()) for found in forces.values()]
    # one catch as the finger passes it on: the third and second moments of its derivative give those of many
    step, keep = speed / DEVICE_RATE, np.exp(-2 * np.pi * finger_cutoff(speed) / DEVICE_RATE)
    x = np.arange(-10 * surface.catch_length, 20 * RELEASE_LENGTH, step)
    event = np.where(x < 0, np.exp(x / surface.catch_length), np.exp(-np.abs(x) / RELEASE_LENGTH))
    slope = np.diff(signal.lfilter([1 - keep], [1, -keep], event))
    skew = np.sum(slope**3) / np.sum(slope**2) ** 1.5 / np.sqrt(surface.catches * step) * np.exp(1.5 * CATCH_SPREAD**2)
    checks = (
        # 600 catches a surface, log-normal heights: the standard error is 1 % (2 %)
        Check("power over the expected, 20-1000 Hz", 1.0, float(power[inside].sum() / expected[inside].sum()), 0.1),
        Check("skew of the derivative, forwards", float(skew), skews[0], 0.1 * float(abs(skew))),
        Check("the same, backwards over forwards", 1.0, skews[1] / skews[0], 0.1),
    )
    source = "loading is slow and release is fast, as in stick-slip (Wiertlewski 2011); lengths, heights: recipe"
    return Law("Catches: power, and a polarity in both directions", source, checks)


def amplitude(quick=False):
    """rms of the friction fluctuation over force and speed, over whole periods of the surface."""
    # so coarse that the finger's low-pass does not matter
    coarse, takes = replace(PLAIN, slope=1.6, asperity=0.4), range(1 if quick else 3)
    checks = []
    for name, exponents, values in (("load", (-0.1, 0.03, 0.3), FORCES), ("speed", (0.0, 0.41, 0.8), SPEEDS)):
        for intended in exponents:
            surface = replace(coarse, **{f"{name}_exponent": intended})
            conditions = [(80.0, value) if name == "load" else (value, 0.5) for value in values]
            found = [np.mean([_fluctuation(surface, *where, take) for take in takes]) for where in conditions]
            checks.append(Check(f"exponent of {name} at {intended:g}", intended, exponent(values, found), 0.02))
    source = "exponents per surface, medians 0.03 and 0.41: measured with a stylus (HaTT, Culbertson et al. 2014)"
    return Law("Amplitude of the fluctuation over load and speed", source, tuple(checks))


def _fluctuation(surface, speed, normal_force, take):
    return slide(surface, speed, PERIOD_MM / speed, normal_force, take)[:, 0].std()


def finger_low_pass(quick=False):
    """Cutoff of the finger, from the spectrum of a nearly white surface whose own spectrum is known."""
    surface, takes = replace(PLAIN, slope=-0.2), 6 if quick else 50
    speeds, checks = np.array([20.0, 40.0, 60.0, 80.0, 100.0]), []
    for factor in (1.0, float(np.exp(POPULATION_SPREAD.cutoff))):
        cutoffs = np.array([_fit_cutoff(surface, speed, takes, factor) for speed in speeds])
        # the recursion at 10 kHz passes up to 6 % higher than an analogue filter of the same cutoff near 1.4 kHz
        found = float(np.mean(cutoffs / speeds))
        checks.append(Check(f"Hz per mm/s, cutoff factor {factor:.2f}", factor * CUTOFF_PER_SPEED, found, 1.0))
    source = "arXiv 2505.11162; factor of further fingers: recipe"
    return Law("Low-pass of the finger: 13.8 Hz per mm/s", source, tuple(checks))


def _fit_cutoff(surface, speed, takes, factor):
    """Cutoff (Hz) that explains the measured spectrum."""
    frequency, power = mean_spectrum(surface, speed, takes, window=0.05, cutoff=factor)
    highest = min(2 * finger_cutoff(speed, factor), 20 * speed)  # finer profiles are interpolated: not all there
    inside = (frequency > 40) & (frequency < highest)
    frequency, gain = frequency[inside], power[inside] / spectrum(surface, frequency[inside] / speed)

    def low_pass(f, scale, cutoff):
        return scale - np.log1p((f / cutoff) ** 2)

    start = np.log(gain[:5].mean()), finger_cutoff(speed)
    return abs(float(optimize.curve_fit(low_pass, frequency, np.log(gain), p0=start)[0][1]))
