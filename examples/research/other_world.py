#!/usr/bin/env python
"""A small world of surfaces that shares no law with `tactile_diffusers.virtual`, to measure adaptation on.

    python examples/research/other_world.py --surfaces 100 --seed 0 recordings.h5
    python examples/prepare_data.py --source recordings --recordings recordings.h5 --prepared prepared.h5 --test 50

What differs: the finger circles at the edge of a plate; friction falls with the load as adhesion of a soft sphere
(Adams et al. 2013) and with speed (Stribeck); its fluctuations over distance have a power law (Wiertlewski et al.
2011), lines of a weave (Weber et al. 2013), domes, or stick and slip; the fingertip is a damped resonator (Wiertlewski
and Hayward 2012). Raters follow powers of what vibrates, weighted as the Pacinian channel does (Bolanowski 1988).
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import signal

from tactile_diffusers.data import RecordingsWriter
from tactile_diffusers.signal import RATING_AXES

RATE, VELOCITY_RATE = 2500, 250  # Hz
RADIUS = 35.0  # mm
#: Grid along the path, mm.
STEP = 0.02
RATERS = 10
#: Of each family: log friction, exponent of the power law, logs of the shares of power law, weave and domes.
FAMILIES = {
    "film": (-0.2, 0.9, (-3.9, -6.0, -7.0)),
    "textile": (-0.9, 0.7, (-3.7, -3.9, -6.5)),
    "grain": (-0.7, 0.5, (-3.2, -6.0, -5.5)),
    "dots": (-0.5, 0.8, (-3.8, -6.0, -3.3)),
}


@dataclass(frozen=True)
class Surface:
    """Laws of one surface: friction, and the spatial spectrum of its fluctuations."""

    friction: float  # at 1 N, far above the Stribeck speed
    adhesion: float  # by how much friction is higher at rest
    exponent: float  # of the power law over spatial frequency
    fluctuation: float  # RMS of the power law, share of the lateral force
    period: float  # mm, of the weave
    weave: float  # its amplitude, share of the lateral force
    domes: float  # a cm
    dome_height: float  # share of the lateral force
    dome_width: float  # mm
    slips: float  # share of the lateral force that a slip releases


def draw_surface(rng):
    """A surface of one of four families, each with its own habits: `Surface`."""
    family = rng.choice(list(FAMILIES))
    fluctuation, weave, dome = np.exp(np.asarray(FAMILIES[family][2]) + rng.normal(0, [0.4, 0.5, 0.5]))
    friction = np.exp(rng.normal(FAMILIES[family][0], 0.3))
    slipping = family == "film" and friction > 0.8
    return Surface(
        friction,
        adhesion=rng.uniform(0.0, 0.6) * friction,
        exponent=rng.normal(FAMILIES[family][1], 0.12),
        fluctuation=fluctuation,
        period=np.exp(rng.normal(-0.2, 0.3)),
        weave=weave,
        domes=rng.uniform(1.0, 5.0),
        dome_height=dome,
        dome_width=rng.uniform(0.4, 1.5),
        slips=rng.uniform(0.03, 0.12) if slipping else 0.0,
    )


def fluctuations(surface, length, rng):
    """Share by which the lateral force departs from its mean along a path of `length` mm: (points,) at `STEP`."""
    points = int(np.ceil(length / STEP)) + 1
    frequencies = np.fft.rfftfreq(points, STEP)  # 1/mm
    # the patch of contact averages over a tenth of a millimetre; slower than the circle there is no texture
    gains = np.maximum(frequencies, 0.05) ** -surface.exponent * np.exp(-frequencies * 0.06)
    white = rng.normal(size=(len(frequencies), 2)).view(np.complex128)[:, 0]
    rough = np.fft.irfft(white * gains, points)
    place = np.arange(points) * STEP
    wander = 0.6 * np.cumsum(rng.normal(0, STEP**0.5, points))  # a weave is not quite regular
    lines = signal.sawtooth(2 * np.pi * (place / surface.period) + wander, rng.uniform(0.3, 0.7))
    bumps = np.zeros(points)
    count = rng.poisson(surface.domes * length / 10)
    bumps[rng.integers(0, points, count)] = rng.lognormal(0, 0.3, count)
    reach = np.arange(-4 * surface.dome_width, 4 * surface.dome_width, STEP) / surface.dome_width
    bumps = signal.fftconvolve(bumps, -reach * np.exp(0.5 - reach**2 / 2), mode="same")
    return surface.fluctuation * rough / rough.std() + surface.weave * lines + surface.dome_height * bumps


def slips(surface, speed, force, rng):
    """Saw teeth of stick and slip, shares of the lateral force: (samples,). The skin is a spring of 1 N/mm."""
    teeth = np.zeros(len(speed))
    if surface.slips:
        drop = surface.slips * np.maximum(force, 0.05)
        phase = np.cumsum(speed / RATE / drop * np.exp(rng.normal(0, 0.3, len(speed))))
        teeth = surface.slips * (0.5 - np.abs((phase % 1.0) ** 2))
    return teeth


def explore(surface, seconds, rng):
    """Force (n, 3) in N at `RATE`, velocity (m, 2) in mm/s at `VELOCITY_RATE`, of circles under a wavering load."""
    samples = int(seconds * RATE)

    def wavering(mean, spread, cutoff):
        sos = signal.butter(2, cutoff, fs=RATE, output="sos")
        noise = signal.sosfiltfilt(sos, rng.normal(size=samples))
        return mean * np.exp(spread * noise / noise.std())

    load, speed = wavering(rng.uniform(0.46, 0.54), 0.06, 0.7), wavering(rng.uniform(74, 90), 0.07, 0.5)
    path = np.cumsum(speed) / RATE
    profile = fluctuations(surface, path[-1], rng)
    share = np.interp(path, np.arange(len(profile)) * STEP, profile)
    friction = (surface.friction + surface.adhesion * np.exp(-speed / 60)) * load ** (-1 / 3)
    lateral = friction * load
    share = share + slips(surface, speed, lateral, rng)
    # the fingertip: a resonator near 180 Hz, damped at half its critical value, beside what is rigid
    w, damping = 2 * np.pi * 180, 0.5
    filtered = signal.lfilter(*signal.bilinear([2 * damping * w, w * w], [1, 2 * damping * w, w * w], RATE), share)
    lateral = lateral * (1 + 0.7 * filtered + 0.3 * share) + 2e-4 * rng.normal(size=samples)
    angle = path / RADIUS
    towards = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    force = np.column_stack([lateral[:, None] * towards, load])
    return force, (speed[:, None] * towards)[:: RATE // VELOCITY_RATE], lateral


def percepts(surface, lateral):
    """What raters rate, in the order of `RATING_AXES`: logs of vibration, of slow vibration, and less friction."""
    frequencies, power = signal.welch(lateral, RATE, nperseg=2048)
    fast = (frequencies > 30) & (frequencies < 800)
    pacinian = np.minimum(frequencies / 200, 200 / np.maximum(frequencies, 1)) ** 2
    vibration = 0.5 * np.log((power * pacinian)[fast].sum())
    slow = 0.5 * np.log(power[(frequencies > 8) & (frequencies < 60)].sum())
    friction = np.log(surface.friction)
    return np.array([vibration + 0.2 * friction, slow - 0.4 * vibration, -friction - 0.15 * vibration])


def rate(values, rng):
    """Answers on the scale from 0 to 8, whole and half numbers, (raters, surfaces, axes); one in twenty is missing."""
    values = (values - values.mean(0)) / values.std(0)
    answers = []
    for _ in range(RATERS):
        mixed = values @ (np.eye(values.shape[1]) + rng.normal(0, 0.15, (values.shape[1],) * 2))
        mixed = mixed + rng.normal(0, 0.6, mixed.shape)
        answers.append(8 / (1 + np.exp(-rng.uniform(0.7, 1.3) * mixed - rng.normal(0, 0.4))))
    answers = np.round(2 * np.stack(answers)) / 2
    answers[rng.random(answers.shape) < 0.05] = np.nan
    return answers


def write_world(path, surfaces=100, seconds=16.0, seed=0):
    """Writes `recordings.h5` of so many surfaces, two recordings each, and their ratings."""
    rng, names, felt = np.random.default_rng(seed), [], []
    with RecordingsWriter(path, source="another simulated world", licence="CC0-1.0", seed=seed) as writer:
        for number in range(surfaces):
            surface, values = draw_surface(rng), []
            names.append(f"sample-{number:03d}")
            for trial in range(2):
                force, velocity, lateral = explore(surface, seconds, rng)
                writer.add_recording(
                    *(names[-1], "finger", str(trial)),
                    force=force, force_rate=RATE, velocity=velocity, velocity_rate=VELOCITY_RATE,
                )  # fmt: skip
                values.append(percepts(surface, lateral))
            felt.append(np.mean(values, 0))
        raters = [f"person-{number}" for number in range(RATERS)]
        writer.set_ratings(rate(np.array(felt), rng), raters, names, RATING_AXES)


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path, help="recordings.h5, written")
    parser.add_argument("--surfaces", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=16.0, help="of each of two recordings")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args(argv)
    write_world(args.output, args.surfaces, args.seconds, args.seed)


if __name__ == "__main__":
    main()
