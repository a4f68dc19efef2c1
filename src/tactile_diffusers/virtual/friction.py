"""Friction of a finger on a virtual surface over time: stick-slip, noise, the finger's low-pass, the contact force."""

import numpy as np
from scipy import fft

from ..signal import BAND_HZ, DEVICE_RATE
from .exploration import VELOCITY_RATE, ornstein_uhlenbeck
from .laws import (
    compliant_background,
    contact_stiffness,
    finger_cutoff,
    first_slip,
    friction_coefficient,
    stick_slip_drop,
    stick_slip_rate,
    stick_slip_readiness,
    texture_amplitude,
)
from .relief import look_up

#: rms in N (recipe).
TEMPORAL_NOISE_N = 1.2e-3
SENSOR_NOISE_N = 0.2e-3
#: Part of a stick-slip period in which the force falls, and spread of the log periods (recipe).
FALL_SHARE = 0.15
PERIOD_JITTER = 0.25
#: Gate of stick-slip: steepness over a process of unit variance, and its time constant, s; bursts: spread of the log
#: heights and how many periods they last (recipe).
GATE_STEEPNESS, GATE_SECONDS = 4.0, 0.3
BURST_SPREAD, BURST_PERIODS = 0.5, 6.0
#: Share of the surface's slope in the normal force, range of that of the fluctuation across (recipe, an assumption).
NORMAL_SHARE = 0.15
ACROSS_SHARE = (0.1, 0.3)


def stick_slip(rng, surface, sliding_friction, speed, samples, readiness=0.0):
    """Relaxation oscillation: slow charge, fall in 15 % of the period, jittered periods, in bursts, on and off.

    Args:
        sliding_friction, speed (`np.ndarray`): at the velocity rate, N and mm/s.
        samples (`int`): at the device rate.
        readiness (`float` or `np.ndarray`): from `stick_slip_readiness`.

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
    bursts = np.exp(BURST_SPREAD * ornstein_uhlenbeck(rng, len(lengths), BURST_PERIODS, 1.0) - BURST_SPREAD**2)
    size = (lengths * bursts).astype(np.float32)  # charged for longer, it drops by more
    gate = stick_slip_gate(ornstein_uhlenbeck(rng, len(speed), GATE_SECONDS, VELOCITY_RATE) + readiness)
    height = _to_device_rate(gate * stick_slip_drop(surface, sliding_friction), samples)
    return height * size[period] * (wave - np.float32(0.5))


def stick_slip_gate(drive):
    """From 0 (steady sliding) to 1 (stick-slip): a steep function of a process of unit variance and the readiness."""
    return 1 / (1 + np.exp(-GATE_STEEPNESS * drive))


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


def low_pass(values, cutoff, rate, block=128, start=1.0):
    """First-order low-pass whose cutoff changes with time.

    y[n] = y[n-1] + b[n] (u[n] - y[n-1]) with b = 1 - exp(-2 pi fc / rate). Within a block the recursion is solved at
    once by a cumulative product, in float64.

    Args:
        values (`np.ndarray`): (n,).
        cutoff (`np.ndarray`): (n,) Hz.
        rate (`float`): Hz.
        block (`int`): samples solved at once; 128 at the highest cutoff of any finger shrink a state to 1e-90, 32 at
            three times the rate to 1e-262: no underflow.
        start (`float`): state before the first value, as a share of it: 1 = settled.

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
    state = start * values[0, 0]
    for i, (last, factor) in enumerate(zip(own[:, -1].tolist(), shrink[:, -1].tolist(), strict=True)):
        states[i] = state
        state = last + factor * state
    return (own + shrink * states[:, None]).reshape(-1)[:samples]


def force_direction(heading, speed, sliding_friction, stiffness):
    """Direction of the friction force: it follows the sliding direction after mu Fn / k of travel.

    The contact first shears elastically, so that in a turnaround the force turns smoothly and is briefly smaller, and
    that a finger which begins to move is loaded before it slips.

    Returns:
        `np.ndarray`: (m, 2), of length 1 or less.
    """
    travel = sliding_friction / stiffness
    cutoff = np.minimum(speed / (2 * np.pi * travel), 3 * VELOCITY_RATE)  # which one sample settles
    starts = 0.0 if speed[0] == 0 else 1.0  # at rest nothing is loaded yet
    parts = [low_pass(part, cutoff, VELOCITY_RATE, 32, starts) for part in (np.cos(heading), np.sin(heading))]
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
    noise. A finger that starts from rest loads the contact first and slips from static friction.

    Args:
        rng (`np.random.Generator`): the trial.
        surface (`SurfaceParameters`): the surface.
        tables (`np.ndarray`): (GRID_POINTS, 3 or 4) float32 from `profile_tables`.
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

    profile = np.where(track_speed < 0, followed[:, 1], followed[:, 0])
    background = temporal_noise(rng, samples)
    if surface.compliance > 0:
        factor = _to_device_rate(compliant_background(surface, speed), samples)
        profile, background = profile + (factor - 1) * followed[:, 3], factor * background
    fluctuation = amplitude * profile + background
    if surface.stick > 0:
        readiness = stick_slip_readiness(normal_force, speed, moisture)
        fluctuation += stick_slip(rng, surface, sliding_friction, speed, samples, readiness)
    fluctuation = low_pass(fluctuation, _to_device_rate(finger_cutoff(speed, cutoff), samples), DEVICE_RATE)
    fluctuation = fluctuation.astype(np.float32)

    if speed[0] == 0:
        sliding_friction = sliding_friction * first_slip(np.cumsum(speed) / VELOCITY_RATE)
    stiffness = contact_stiffness(surface, speed)
    direction = force_direction(exploration.heading, speed, sliding_friction, stiffness)
    along = [_to_device_rate(direction[:, i], samples) for i in range(2)]
    sliding = _to_device_rate(sliding_friction, samples) + fluctuation
    across = rng.uniform(*ACROSS_SHARE) * fluctuation
    force = rng.standard_normal((samples, 3), dtype=np.float32)
    force *= np.float32(SENSOR_NOISE_N)
    force[:, 0] += sliding * along[0] - across * along[1]
    force[:, 1] += sliding * along[1] + across * along[0]
    force[:, 2] += _to_device_rate(normal_force, samples) + np.float32(NORMAL_SHARE) * amplitude * followed[:, 2]
    return force
