"""Percepts of virtual surfaces, from the expected spectrum of the friction force."""

import json
from functools import lru_cache
from importlib.resources import files

import numpy as np
from scipy.special import ndtri

from ..signal import BAND_HZ, REFERENCE_FORCE
from .friction import FALL_SHARE, TEMPORAL_NOISE_N, stick_slip_gate
from .laws import finger_cutoff, friction_coefficient, stick_slip_drop, stick_slip_rate, texture_amplitude
from .recipe import RECIPE_VERSION, REFERENCE_SPEED_MM_S
from .relief import CATCH_SPREAD, HARMONICS, PERIOD_MM, catch_response, harmonic_amplitudes, spectrum

CALIBRATION_FILE = "calibration.json"
#: Frequencies (Hz) at which continuous spectra are evaluated.
FREQUENCIES = np.geomspace(*BAND_HZ, 201)
#: Below this, Hz, vibration counts as relief rather than as fine texture (recipe).
COARSE_BELOW_HZ = 80.0
#: Share of fine power that is subtracted from coarse power in bumpiness: gives r(rough, bumpy) = 0.40 (recipe).
FINE_IN_BUMPINESS = 0.85
#: Mean square of the gate and of the bursts of stick-slip: the gate over quantiles of a normal process.
STICK_SLIP_POWER = float(np.mean(stick_slip_gate(ndtri((np.arange(1000) + 0.5) / 1000)) ** 2))


def expected_powers(surface):
    """Expected power of the friction fluctuation at 80 mm/s and 0.5 N, computed from parameters alone.

    Args:
        surface (`SurfaceParameters`): the surface.

    Returns:
        `tuple[float, float]`: Pacinian-weighted power and power from 20 to 80 Hz, dB re 1 N^2.
    """
    frequency, power = expected_spectrum(surface)
    # what counts as fine roughness: a log-normal weight around 250 Hz, after Bensmaia & Hollins (2003)
    fine = np.sum(np.exp(-0.5 * (np.log(frequency / 250.0) / 0.75) ** 2) * power)
    return float(10 * np.log10(fine)), float(10 * np.log10(np.sum(power[frequency < COARSE_BELOW_HZ])))


def expected_spectrum(surface):
    """Frequencies (n,), Hz, and the power of the friction fluctuation at each, N^2: `expected_powers` sums it up."""
    line_frequencies, line_powers = _lines(surface)
    frequency = np.concatenate([FREQUENCIES, line_frequencies])
    power = np.concatenate([_continuum(surface) * np.gradient(FREQUENCIES), line_powers])
    power = power / (1 + (frequency / finger_cutoff(REFERENCE_SPEED_MM_S)) ** 2)
    return frequency, np.where((frequency >= BAND_HZ[0]) & (frequency <= BAND_HZ[1]), power, 0.0)


def _continuum(surface):
    """Density of the random profile, of catches and of the temporal noise at `FREQUENCIES`, N^2/Hz.

    A compliant grating's factor on them is 1 at 80 mm/s, and the envelope's mean square is 1.
    """
    k = FREQUENCIES / REFERENCE_SPEED_MM_S
    variance = np.sum(spectrum(surface)) / PERIOD_MM
    amplitude = texture_amplitude(surface, REFERENCE_FORCE, REFERENCE_SPEED_MM_S)
    profile = spectrum(surface, k) / variance
    height = surface.catch_height**2 * np.exp(2 * CATCH_SPREAD**2)
    profile = profile + 2 * surface.catches * height * np.abs(catch_response(surface, k)) ** 2
    return (
        amplitude**2 * profile / REFERENCE_SPEED_MM_S
        + TEMPORAL_NOISE_N**2 / np.log(BAND_HZ[1] / BAND_HZ[0]) / FREQUENCIES
    )


def _lines(surface):
    """Frequencies (Hz) and powers (N^2) of the grating's and the stick-slip's harmonics."""
    order = np.arange(1, HARMONICS + 1)
    amplitude = texture_amplitude(surface, REFERENCE_FORCE, REFERENCE_SPEED_MM_S) * surface.grating_level
    grating = 0.5 * (amplitude * harmonic_amplitudes(surface)) ** 2
    sliding = reference_friction(surface) * REFERENCE_FORCE
    # Fourier series of a triangle that rises for 1 - FALL_SHARE of its period
    rise = 1 - FALL_SHARE
    wave = np.sin(np.pi * order * rise) / ((np.pi * order) ** 2 * rise * FALL_SHARE)
    stick = 0.5 * STICK_SLIP_POWER * (stick_slip_drop(surface, sliding) * wave) ** 2
    rate = stick_slip_rate(surface, sliding, REFERENCE_SPEED_MM_S)
    return np.concatenate([order * REFERENCE_SPEED_MM_S / surface.wavelength, order * rate]), np.append(grating, stick)


def reference_friction(surface):
    """Friction coefficient at 0.5 N and 80 mm/s of a finger of moisture 1, compliance included."""
    return float(friction_coefficient(surface, REFERENCE_FORCE, REFERENCE_SPEED_MM_S))


def percept_inputs(surface):
    """The quantities that percepts are combined from, before normalisation: a dict of floats."""
    fine, coarse = expected_powers(surface)
    return {
        "fine_power": fine,
        "coarse_power": coarse,
        "coarse_over_fine": coarse - FINE_IN_BUMPINESS * fine,
        "grating": surface.grating_level * np.log1p(surface.wavelength),
        "log_friction": float(np.log(reference_friction(surface))),
        "stick": surface.stick,
        "slope": surface.slope,
    }


def combine(inputs, standardise):
    """Roughness, bumpiness and slipperiness from `percept_inputs`; the weights are an assumption of the recipe.

    Coarse power weighs as much as fine power in roughness, so that a grating feels rougher as its period grows from 0.5
    to 2 mm (Drewing 2016), although its vibration then leaves the Pacinian range.

    This is the physics: what of two percepts goes together because surfaces that vibrate more also grip more. How
    raters judge them together is `raters.judgement`.

    Args:
        inputs (`dict`): values or arrays.
        standardise (`callable`): (name, values) -> z-scores over the population of surfaces.

    Returns:
        `tuple`: the three percepts, of unit variance over the population; positive slipperiness = more slippery.
    """
    z = {name: standardise(name, values) for name, values in inputs.items()}
    rough = standardise("roughness", 0.6 * z["fine_power"] + 0.6 * z["coarse_power"] - 0.25 * inputs["slope"])
    bumpy = standardise("bumpiness", 0.6 * z["coarse_over_fine"] + 0.7 * z["grating"])
    slippery = standardise("slipperiness", -0.85 * z["log_friction"] - 0.25 * z["stick"])
    return rough, bumpy, slippery


@lru_cache(maxsize=1)
def calibration():
    """What `calibration.json` holds.

    Raises:
        ValueError: if it belongs to another version of the recipe.
    """
    stored = json.loads(files(__package__).joinpath(CALIBRATION_FILE).read_text())
    if stored["recipe_version"] != RECIPE_VERSION:
        raise ValueError(
            f"{CALIBRATION_FILE} belongs to recipe {stored['recipe_version']}, the code is recipe {RECIPE_VERSION}: "
            "run examples/research/calibrate_virtual.py."
        )
    return stored


def further_inputs(surface):
    """What percepts beside the three follow from: a dict of floats.

    Regular is what repeats: the share of the profile's power in its grating, less what the envelope wanders. Fine is
    what is small: the spectrum's centre of power, in octaves, which is one of spatial frequency at one speed. (Recipe;
    SENS3's raters judged both pairs, arXiv 2401.01818.)
    """
    frequency, power = expected_spectrum(surface)
    grating = surface.grating_level**2
    return {
        "regularity": grating / (1 + grating) - surface.intermittency - surface.jitter,
        "fineness": float(np.sum(power * np.log2(frequency)) / np.sum(power)),
    }


def further_percept(surface, name):
    """Regularity or fineness of a surface, in standard deviations over the population of surfaces."""
    constants = calibration()["further"][name]
    return (further_inputs(surface)[name] - constants["mean"]) / constants["scale"]


def percepts(surface):
    """(3,) roughness, bumpiness, slipperiness of a surface, in standard deviations over the population of surfaces."""
    constants = calibration()["constants"]

    def standardise(name, value):
        return (value - constants[name]["mean"]) / constants[name]["scale"]

    return np.array(combine(percept_inputs(surface), standardise))


def percept_correlation():
    """(3, 3) correlations of the percepts over the population of surfaces."""
    return np.array(calibration()["correlation"])
