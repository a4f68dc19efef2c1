"""Friction of a finger on a virtual surface over time: stick-slip, noise, the finger's low-pass, the contact force."""

import numpy as np
from scipy import fft

from ..signal import BAND_HZ, DEVICE_RATE
from .exploration import VELOCITY_RATE, ornstein_uhlenbeck
from .laws import (
    compliant_background,
    contact_stiffness,
    finger_cutoff,
    friction_coefficient,
    stick_slip_drop,
    stick_slip_rate,
    texture_amplitude,
)
from .profile import look_up

#: rms in N (recipe).
TEMPORAL_NOISE_N = 1.2e-3
SENSOR_NOISE_N = 0.2e-3
#: Part of a stick-slip period in which the force falls, and spread of the log periods (recipe).
FALL_SHARE = 0.15
PERIOD_JITTER = 0.25
#: Share of the surface's slope in the normal force, range of that of the fluctuation across (recipe, an assumption).
NORMAL_SHARE = 0.15
ACROSS_SHARE = (0.1, 0.3)


def stick_slip(rng, surface, sliding_friction, speed, samples):
    """Relaxation oscillation: slow charge, fall in 15 % of the period, jittered periods, slowly on and off.

    Args:
        sliding_friction, speed (`np.ndarray`): at the velocity rate, N and mm/s.
        samples (`int`): at the device rate.

    Returns:
        `np.ndarray`: (samples,) float32, N, mean near zero.
    """
    rate = _to_device_rate(stick_slip_rate(surface, sliding_friction, speed), samples)
    cycles = np.cumsum(rate, dtype=np.float64) / DEVICE_RATE  # float32 would lose the step in minutes of recording
    lengths = np.exp(PERIOD_JITTER * rng.standard_normal(int(cycles[-1] * 1.5) + 50))
    ends = np.cumsum(lengths)
    if ends[-1] < cycles[-1]:  # cannot happen with so many spare periods; cheap to be sure
        ends[-1] = cycles[-1] + 1
    period = np.searchsorted(ends, cycles, side="right")
    phase = (1 - (ends[period] - cycles) / lengths[period]).astype(np.float32)
    wave = np.minimum(phase / (1 - FALL_SHARE), (1 - phase) / FALL_SHARE)
    wave *= lengths[period].astype(np.float32)  # charged for longer, it drops by more
    on = 1 / (1 + np.exp(-4 * ornstein_uhlenbeck(rng, len(speed), 0.5, VELOCITY_RATE)))
    height = _to_device_rate(on * stick_slip_drop(surface, sliding_friction), samples)
    return height * (wave - np.float32(0.5))


def temporal_noise(rng, samples):
    """1/f noise in time, 1.2 mN rms within 20-1000 Hz: (samples,) float32 (Wiertlewski, Hudin, Hayward 2011: 1/f)."""
    length = fft.next_fast_len(samples, real=True)
    frequencies = fft.rfftfreq(length, 1 / DEVICE_RATE)
    low, high = BAND_HZ
    magnitude = 1 / np.sqrt(np.maximum(frequencies, 1.0))
    inside = (frequencies >= low) & (frequencies <= high)
    # irfft divides by `length`: variance = 2 * sum |X|^2 / length^2 with E|X|^2 = 2 magnitude^2
    magnitude *= TEMPORAL_NOISE_N * length / np.sqrt(4 * np.sum(magnitude[inside] ** 2))
    noise = rng.standard_normal((2, len(frequencies)), dtype=np.float32)
    return fft.irfft(magnitude.astype(np.float32) * (noise[0] + 1j * noise[1]), length)[:samples]


def low_pass(values, cutoff, rate, block=128):
    """First-order low-pass whose cutoff changes with time.

    y[n] = y[n-1] + b[n] (u[n] - y[n-1]) with b = 1 - exp(-2 pi fc / rate). Within a block the recursion is solved at
    once by a cumulative product, in float64.

    Args:
        values (`np.ndarray`): (n,); the filter starts settled on the first value.
        cutoff (`np.ndarray`): (n,) Hz.
        rate (`float`): Hz.
        block (`int`): samples solved at once; 128 at the highest cutoff of any finger shrink a state to 1e-90, far
            above underflow.

    Returns:
        `np.ndarray`: (n,) float64.
    """
    samples = len(values)
    padding = -samples % block
    values = np.pad(np.asarray(values, dtype=np.float64), (0, padding), mode="edge").reshape(-1, block)
    keep = np.exp(np.pad(np.asarray(cutoff, dtype=np.float64), (0, padding), mode="edge") * (-2 * np.pi / rate))
    keep = keep.reshape(-1, block)
    shrink = np.cumprod(keep, axis=1)
    own = shrink * np.cumsum((1 - keep) * values / shrink, axis=1)
    states = np.empty(len(own))
    state = values[0, 0]
    for i, (last, factor) in enumerate(zip(own[:, -1].tolist(), shrink[:, -1].tolist(), strict=True)):
        states[i] = state
        state = last + factor * state
    return (own + shrink * states[:, None]).reshape(-1)[:samples]


def force_direction(heading, speed, sliding_friction, stiffness):
    """Direction of the friction force: it follows the sliding direction after mu Fn / k of travel.

    The contact first shears elastically, so that in a turnaround the force turns smoothly and is briefly smaller.

    Returns:
        `np.ndarray`: (m, 2), of length 1 or less.
    """
    travel = sliding_friction / stiffness
    cutoff = speed / (2 * np.pi * travel)
    parts = [low_pass(part, cutoff, VELOCITY_RATE, block=32) for part in (np.cos(heading), np.sin(heading))]
    return np.stack(parts, axis=-1)


def _to_device_rate(values, samples):
    """Linear interpolation from the velocity rate to the device rate, both starting at once: (samples,) float32."""
    ratio = DEVICE_RATE // VELOCITY_RATE
    values = np.append(values, values[-1]).astype(np.float32)
    fraction = np.arange(ratio, dtype=np.float32) / ratio
    return (values[:-1, None] + np.diff(values)[:, None] * fraction).reshape(-1)[:samples]


def contact_force(rng, surface, tables, exploration, moisture=1.0, gain=1.0, cutoff=1.0):
    """Contact force that the finger exerts on a surface (recipe).

    F(t) = mu Fn + a(Fn, v) h(x(t)) + stick-slip + 1/f, all fluctuation through the finger's low-pass, along the sliding
    direction; a tenth to three tenths of the fluctuation across it; Fn and the surface's slope along the normal; sensor
    noise.

    Args:
        rng (`np.random.Generator`): the trial.
        surface (`SurfaceParameters`): the surface.
        tables (`np.ndarray`): (GRID_POINTS, 2 or 3) float32 from `profile_tables`.
        exploration (`Exploration`): what the hand does.
        moisture, gain, cutoff (`float`): the explorer's factors on friction, amplitude and the finger's cutoff.

    Returns:
        `np.ndarray`: (n, 3) float32, N, at `DEVICE_RATE`: x, y, normal.
    """
    speed, normal_force = exploration.speed, exploration.normal_force
    samples = len(speed) * (DEVICE_RATE // VELOCITY_RATE)
    start = rng.uniform(0, 1000)
    track_speed = _to_device_rate(exploration.track_speed, samples)
    position = start + np.cumsum(track_speed, dtype=np.float64) / DEVICE_RATE
    followed = look_up(tables, position)
    amplitude = _to_device_rate(texture_amplitude(surface, normal_force, speed, gain), samples)
    sliding_friction = friction_coefficient(surface, normal_force, speed, moisture) * normal_force

    profile, background = followed[:, 0], temporal_noise(rng, samples)
    if surface.compliance > 0:
        factor = _to_device_rate(compliant_background(surface, speed), samples)
        profile, background = profile + (factor - 1) * followed[:, 2], factor * background
    fluctuation = amplitude * profile + background
    if surface.stick > 0:
        fluctuation += stick_slip(rng, surface, sliding_friction, speed, samples)
    fluctuation = low_pass(fluctuation, _to_device_rate(finger_cutoff(speed, cutoff), samples), DEVICE_RATE)
    fluctuation = fluctuation.astype(np.float32)

    stiffness = contact_stiffness(surface, speed)
    direction = force_direction(exploration.heading, speed, sliding_friction, stiffness)
    along = [_to_device_rate(direction[:, i], samples) for i in range(2)]
    sliding = _to_device_rate(sliding_friction, samples) + fluctuation
    across = rng.uniform(*ACROSS_SHARE) * fluctuation
    force = rng.standard_normal((samples, 3), dtype=np.float32)
    force *= np.float32(SENSOR_NOISE_N)
    force[:, 0] += sliding * along[0] - across * along[1]
    force[:, 1] += sliding * along[1] + across * along[0]
    force[:, 2] += _to_device_rate(normal_force, samples) + np.float32(NORMAL_SHARE) * amplitude * followed[:, 1]
    return force
