"""The profile of a virtual surface over position: what the finger meets again when it comes back to the same place."""

from functools import lru_cache

import numpy as np
from scipy import fft

#: recipe: 5 um grid, repeated every 120 mm.
GRID_MM = 0.005
PERIOD_MM = 120.0
GRID_POINTS = round(PERIOD_MM / GRID_MM)
#: Spectrum is flat below this spatial frequency (1/mm).
FLAT_BELOW = 0.1
#: Nothing finer than 25 um: at 125 mm/s it would pass 5 kHz and fold.
FINEST = 40.0
HARMONICS = 6
#: Length (mm) over which the envelope of a profile changes, and spread of the log heights of catches (recipe).
ENVELOPE_LENGTH = 1.0
CATCH_SPREAD = 0.4
#: Length (mm) over which a catch lets go: short beside its loading, which gives the force its polarity (recipe).
RELEASE_LENGTH = 0.05


@lru_cache(maxsize=1)
def spatial_frequencies():
    """(GRID_POINTS // 2 + 1,) 1/mm."""
    return fft.rfftfreq(GRID_POINTS, GRID_MM)


def spectrum(surface, k=None):
    """Power spectrum of the random profile, unnormalised: max(k, 0.1/mm)^-slope with the asperity low-pass.

    Friction of flat surfaces fluctuates as 1/f (Wiertlewski, Hudin, Hayward 2011); asperity low-pass
    1/sqrt(1 + (k d)^4) in amplitude (recipe).

    Args:
        surface (`SurfaceParameters`): the surface.
        k (`np.ndarray`, *optional*): 1/mm; defaults to the grid's.
    """
    k = spatial_frequencies() if k is None else k
    power = np.maximum(k, FLAT_BELOW) ** -surface.slope / (1 + (k * surface.asperity) ** 4)
    return np.where((k > 0) & (k <= FINEST), power, 0.0)


def harmonic_amplitudes(surface):
    """Amplitudes of the grating's harmonics 1-6: i^-q, together of unit rms.

    Harmonics of gratings decay with a non-integer power law (Wiertlewski, Hudin, Hayward 2011).
    """
    amplitudes = np.arange(1, HARMONICS + 1) ** -surface.harmonic_decay
    return amplitudes / np.sqrt(0.5 * np.sum(amplitudes**2))


def random_profile(surface, rng):
    """Random profile of zero mean and unit variance: (GRID_POINTS,)."""
    magnitude = np.sqrt(spectrum(surface))
    noise = rng.standard_normal((2, len(magnitude)))
    profile = fft.irfft(magnitude * (noise[0] + 1j * noise[1]), GRID_POINTS)
    return profile / profile.std()


def grating_phase(surface, rng):
    """Phase of the grating over position: (GRID_POINTS,) rad, a whole number of jittered periods in 120 mm."""
    count = max(1, round(PERIOD_MM / surface.wavelength))
    periods = np.maximum(1 + surface.jitter * rng.standard_normal(count), 0.2)
    edges = np.concatenate([[0.0], np.cumsum(periods)])
    position = np.arange(GRID_POINTS) * (edges[-1] / GRID_POINTS)
    return 2 * np.pi * np.interp(position, edges, np.arange(count + 1))


def grating(surface, rng):
    """Grating of relative level: (GRID_POINTS,); zeros without random draws if the surface has none."""
    profile = np.zeros(GRID_POINTS)
    if surface.grating_level:
        phase, offsets = grating_phase(surface, rng), rng.uniform(0, 2 * np.pi, HARMONICS)
        for i, amplitude in enumerate(harmonic_amplitudes(surface), start=1):
            profile += surface.grating_level * amplitude * np.cos(i * phase + offsets[i - 1])
    return profile


def envelope(surface, rng):
    """Envelope of the profile over position, log-normal and of unit mean square: (GRID_POINTS,).

    One envelope for all frequencies, because the envelopes of a texture's bands move together (McDermott & Simoncelli
    2011). A Gaussian profile under it has a kurtosis of 3 exp(4 s^2), s the intermittency.
    """
    frequency = spatial_frequencies()
    magnitude = np.where(frequency > 0, 1 / (1 + (2 * np.pi * frequency * ENVELOPE_LENGTH) ** 2), 0.0)
    noise = rng.standard_normal((2, len(frequency)))
    field = fft.irfft(magnitude * (noise[0] + 1j * noise[1]), GRID_POINTS)
    return np.exp(surface.intermittency * field / field.std() - surface.intermittency**2)


def catch_response(surface, k=None):
    """Fourier transform of one catch of unit height over position, mm: it loads slowly and lets go fast.

    exp(x / l) before the edge and exp(-x / r) behind it, with l the length of loading and r = 0.05 mm: the polarity
    of a sawtooth.

    Args:
        surface (`SurfaceParameters`): the surface.
        k (`np.ndarray`, *optional*): 1/mm; defaults to the grid's.
    """
    omega = 2 * np.pi * (spatial_frequencies() if k is None else k)
    return surface.catch_length / (1 - 1j * omega * surface.catch_length) + RELEASE_LENGTH / (
        1 + 1j * omega * RELEASE_LENGTH
    )


def catches(surface, rng):
    """Isolated catches, met in the one direction and in the other: (2, GRID_POINTS).

    The finger loads before it slips, whichever way it comes; so a stroke back meets each catch mirrored in space.
    """
    count = rng.poisson(surface.catches * PERIOD_MM)
    places, heights = rng.integers(GRID_POINTS, size=count), np.exp(CATCH_SPREAD * rng.standard_normal(count))
    if not count:
        return np.zeros((2, GRID_POINTS))
    events = np.bincount(places, surface.catch_height * heights, GRID_POINTS) / GRID_MM
    spectrum_of_events, response = fft.rfft(events), catch_response(surface)
    both = fft.irfft(np.stack([spectrum_of_events * response, spectrum_of_events * response.conj()]), GRID_POINTS)
    return both - both.mean(axis=1, keepdims=True)


def profile_tables(surface, rng):
    """What the finger meets over position: a random part of unit variance, a grating of relative level, and catches.

    Args:
        surface (`SurfaceParameters`): the surface.
        rng (`np.random.Generator`): phases.

    Returns:
        `np.ndarray`: (GRID_POINTS, 3) float32, periodic: height-like profile, dimensionless, as a finger meets it that
        comes forwards and backwards, and its slope at unit variance; for a compliant grating (GRID_POINTS, 4), the
        random part of the profile last.
    """
    random, lines = random_profile(surface, rng), grating(surface, rng)
    moving = envelope(surface, rng)
    profile = (random + lines) * moving
    forwards, backwards = (profile + catches(surface, rng)).astype(np.float32)
    slope = np.roll(profile, -1) - np.roll(profile, 1)
    columns = [forwards, backwards, (slope / slope.std()).astype(np.float32)]
    if surface.compliance > 0:
        columns.append((random * moving).astype(np.float32))
    return np.stack(columns, axis=-1)


def look_up(tables, position):
    """Values of periodic profiles at finger positions, linearly interpolated.

    Args:
        tables (`np.ndarray`): (GRID_POINTS, profiles) float32.
        position (`np.ndarray`): (n,) mm along the track.

    Returns:
        `np.ndarray`: (n, profiles) float32.
    """
    place = np.mod(position, PERIOD_MM) / GRID_MM
    index = place.astype(np.int32)
    fraction = (place - index).astype(np.float32)[:, None]
    index[index >= GRID_POINTS] = 0  # rounding of np.mod
    here = tables[index]
    following = tables[(index + 1) % GRID_POINTS]
    return here + fraction * (following - here)
