"""Two made-up displays, a finger on them, and noise for textures. Their numbers are nobody's device."""

import numpy as np
import pytest
from scipy import signal

from tactile_diffusers.display import DriveProfile
from tactile_diffusers.display.drive_stream import inverse_coefficients
from tactile_diffusers.signal import band_pass

RATE = 10_000


def _square_law(volts):
    return 6e-6 * np.square(volts)  # N


def _squeeze_film(amplitude):
    return -0.2 * amplitude**2 / (0.2 + amplitude**2)  # N: flat at first, then saturating


@pytest.fixture
def response():
    """What arrives at the finger of a force sent through `drive`, at a constant speed, unclipped; 1 = unchanged.

    The delay of one sample of a held drive is left out.
    """

    def respond(profile, frequencies, speed, sampling_rate=RATE):
        [pole], [bandwidth], [share] = inverse_coefficients(profile, np.array([float(speed)]), sampling_rate)
        angle = np.pi * np.asarray(frequencies, dtype=np.float64) / sampling_rate
        display = (1 - pole) / (1 - pole * np.exp(-2j * angle))
        place = 1j * np.tan(angle) / bandwidth if share else 0
        return (1 - share) * display + share / (1 + np.sqrt(2) * place + place**2)

    return respond


@pytest.fixture
def make_profile():
    """Builds the profile of either display, with arguments changed."""

    def make(kind="electroadhesion", **changes):
        values = {"kind": kind, "offset": 0.3, "cutoffs": [(80.0, 300.0)], "normal_force": 0.5}
        if kind == "electroadhesion":
            values |= {"gain": 6e-6, "max_drive": 180.0}
        else:
            amplitudes = np.linspace(0, 1, 21)
            table = np.stack([amplitudes, -_squeeze_film(amplitudes)], axis=1)
            values |= {"gain": 1.0, "max_drive": 1.0, "lookup": table}
        return DriveProfile(**{**values, **changes})

    return make


@pytest.fixture
def feel():
    """What the finger feels of a drive: true static law, continuous first-order low-pass, offset."""

    def simulate(kind, drive, cutoff, offset=0.3, noise=0.0):
        steady = (_square_law if kind == "electroadhesion" else _squeeze_film)(np.asarray(drive))
        # 1 / (1 + s / w) under a drive held for each sample, as a converter does; SciPy's exact solution
        system = ([1.0], [1 / (2 * np.pi * cutoff), 1.0])
        numerator, denominator, _ = signal.cont2discrete(system, 1 / RATE, method="zoh")
        start = signal.lfilter_zi(numerator.ravel(), denominator) * steady[0]
        force, _ = signal.lfilter(numerator.ravel(), denominator, steady, zi=start)
        return offset + force + noise * np.random.default_rng(9).normal(size=len(force))

    return simulate


@pytest.fixture
def noise_texture():
    """Noise with a power density that falls as 1/f^slope, band-passed, at an RMS in N."""

    def make(seed=0, slope=1.0, samples=2**14, rms=0.008):
        spectrum = np.fft.rfft(np.random.default_rng(seed).normal(size=samples))
        frequencies = np.fft.rfftfreq(samples, 1 / RATE)
        spectrum[1:] *= frequencies[1:] ** (-slope / 2)
        texture = band_pass(np.fft.irfft(spectrum, samples), RATE)
        return rms * texture / texture.std()

    return make


@pytest.fixture
def excitation():
    """Pseudo-random or swept drive in the middle of the range: (samples,) in V or relative amplitude."""

    def make(kind, shape="random", seconds=6.0, seed=3):
        samples = int(seconds * RATE)
        if shape == "random":
            levels = np.random.default_rng(seed).integers(0, 2, size=samples // 2 + 1)
            place = np.repeat(levels, 2)[:samples]
        else:
            time = np.arange(samples) / RATE
            place = 0.5 + 0.5 * signal.chirp(time, 10.0, seconds, 1200.0, method="logarithmic")
        return 60.0 + 80.0 * place if kind == "electroadhesion" else 0.3 + 0.4 * place

    return make
