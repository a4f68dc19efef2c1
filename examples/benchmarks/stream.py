"""Is playback right at other speeds, with coarse sensors, and on time?

`python examples/benchmarks/stream.py --output report`
"""

import itertools
import sys
from pathlib import Path

import numpy as np
import torch
from benchmarking import finish, machine, make_parser, parse
from moving_finger import BLOCK, BUDGET, SENSOR_HZ, delays, largest_step, motion, play
from scipy import signal
from tqdm.auto import tqdm

from tactile_diffusers.cli.program import load_pipeline
from tactile_diffusers.evaluation.metrics.embedding import FEATURE_NAMES, tactile_features
from tactile_diffusers.evaluation.metrics.statistics import estimate, leaf
from tactile_diffusers.io.argument_types import count, positive_number
from tactile_diffusers.playback import FingerPath, TextureProfile, TextureStream, on_time
from tactile_diffusers.playback.force_laws import SPEED_EXPONENT
from tactile_diffusers.signal import DEVICE_RATE, REFERENCE_FORCE, SEGMENT_SAMPLES, band_levels_db, band_pass
from tactile_diffusers.virtual import friction, laws
from tactile_diffusers.virtual.exploration import VELOCITY_RATE, Exploration, steady_exploration, wandering
from tactile_diffusers.virtual.surface import VirtualSurface

sys.path.append(str(Path(__file__).parents[1]))  # examples, for `report`

from report.tables import markdown_table, title

SPEEDS = (20.0, 40.0, 80.0, 160.0, 320.0)
#: Speed at which the profiles are recorded, mm/s: that of the virtual explorers.
RECORDED_SPEED = 80.0
#: Surfaces, none of which any checkpoint learned from: of another seed than all data sets here.
SEED = 4711
#: Recorded seconds, after half a second that the filter needs.
SECONDS, SETTLING = 4.0, 0.5
#: Mean speeds of hands, and the limits of segments, mm/s.
HAND_SPEEDS, SPEED_LIMITS = (72.0, 92.0), (66.0, 99.0)
#: Speeds, mm/s, and normal forces, N, at which surfaces with stick-slip are played. They are others than those (0-399)
#: from which the thresholds of `separate_events` were chosen.
STICKING = ((40.0, 0.5), (160.0, 0.5), (80.0, 0.25), (80.0, 1.0))
FIRST_STICKING = 1000
#: Share of the power from which on a surface's stick-slip rules its error.
MUCH_STICK_SLIP = 0.1
#: Sensors: reports per second and resolution in mm.
SENSORS = ((60.0, 0.1), (125.0, 0.1), (125.0, 0.05), (250.0, 0.1), (1000.0, 0.1), (1000.0, 0.05))
#: No hand moves faster than this, Hz: what a path has beyond is the sensor's.
HAND_HZ = 15.0
#: Arguments of a stream whose values a single texture does not tell.
EXPONENTS = ("force_exponent", "speed_exponent")


def main(argv=None):
    """Measures and writes stream.json, stream.md and stream.png."""
    parser = make_parser("stream.py", "Playback against fresh recordings, with coarse sensors, and its time.")
    parser.add_argument("--surfaces", type=count, default=60, metavar="N", help="virtual ones; default: 60")
    parser.add_argument("--minutes", type=positive_number, default=10.0, help="of random motion; default: 10")
    arguments = parse(parser, argv)
    pipe, quiet = load_pipeline(arguments.checkpoint), arguments.quiet
    generator = torch.Generator().manual_seed(arguments.seed)
    out = pipe([[1.5, 0.0, -1.0], [-1.0, 1.0, 0.0]], generator=generator)
    profiles = [TextureProfile(texture, out.sampling_rate, out.reference_speed) for texture in out.textures]
    report = {
        "machine": machine(),
        "surfaces": arguments.surfaces,
        "minutes": arguments.minutes,
        "recordings": fresh_recordings(arguments.surfaces, quiet),
        "stick-slip": stick_slip(arguments.surfaces, quiet),
        "whose speed": whose_speed(arguments.surfaces, quiet),
        "sensors": {f"{rate:g} Hz, {step:g} mm": sensor(profiles, rate, step) for rate, step in SENSORS},
        "clock": clock(profiles, arguments.minutes, arguments.seed, quiet),
    }
    plot(report["recordings"], arguments.output / "stream.png")
    return finish(arguments, "stream", report, markdown(report))


def fresh_recordings(surfaces, quiet):
    """Nine-band error, dB, of what is read from a profile against fresh recordings at other speeds.

    Class of surface -> kind of playback -> speed -> mean error over surfaces.
    """
    found = {}
    for index in tqdm(range(surfaces), disable=quiet, desc="recordings"):
        surface = VirtualSurface(SEED, index)
        kind = "with stick-slip" if surface.parameters.stick > 0 else "without stick-slip"
        texture = _record(surface, RECORDED_SPEED, 0)[:SEGMENT_SAMPLES]
        for speed in SPEEDS:
            fresh = band_levels_db(_record(surface, speed, 1), DEVICE_RATE)
            for name, played in _played(surface, texture, speed).items():
                error = float(np.abs(band_levels_db(played, DEVICE_RATE) - fresh).mean())
                for group in (kind, f"all {surface.parameters.material}"):
                    found.setdefault(group, {}).setdefault(name, {}).setdefault(f"{speed:g} mm/s", []).append(error)
    return {
        group: {name: {speed: float(np.mean(values)) for speed, values in row.items()} for name, row in rows.items()}
        | {"surfaces": len(next(iter(rows["profile"].values())))}
        for group, rows in sorted(found.items(), reverse=True)
    }


def plot(recordings, path):
    """Errors over the speed of the finger."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.6), layout="constrained")
    groups = [group for group in recordings if group.startswith("with")]
    for panel, group in zip(figure.subplots(1, len(groups), sharey=True, squeeze=False)[0], groups, strict=True):
        for name, row in recordings[group].items():
            if name != "surfaces":
                panel.plot(SPEEDS, [row[f"{speed:g} mm/s"] for speed in SPEEDS], "o-", label=name)
        panel.axhline(2.2, color="grey", linestyle=":")  # what a fingertip tells apart (Israr, Tan and Reed 2006)
        panel.set(xscale="log", xlabel="speed of the finger, mm/s", title=group)
        panel.set_xticks(SPEEDS, [f"{speed:g}" for speed in SPEEDS], minor=False)
        panel.minorticks_off()
    figure.axes[0].set_ylim(bottom=0)
    figure.axes[0].set_ylabel("nine-band error, dB")
    figure.axes[-1].legend(fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


def whose_speed(surfaces, quiet):
    """Nine-band error, dB, of textures recorded by a hand whose speed wanders, placed in space in three ways.

    Way -> speed at which it is played -> mean error over surfaces without stick-slip.
    """
    found, rate = {}, DEVICE_RATE
    for index in tqdm(range(surfaces), disable=quiet, desc="whose speed"):
        surface, rng = VirtualSurface(SEED, index), np.random.default_rng([SEED, index, 9])
        if surface.parameters.stick > 0:
            continue
        samples = round((SETTLING + SECONDS) * VELOCITY_RATE)
        trace = np.clip(wandering(rng, samples, rng.uniform(*HAND_SPEEDS), 0.1, 2.0), *SPEED_LIMITS)
        hand = Exploration(trace, np.full(samples, REFERENCE_FORCE), np.zeros(samples), trace)
        kept = slice(round(SETTLING * rate), round(SETTLING * rate) + SEGMENT_SAMPLES)
        texture = band_pass(surface.record(hand, rng)[:, 0], rate)[kept]
        speed = np.interp(np.arange(len(texture)) + kept.start, np.arange(samples) * rate / VELOCITY_RATE, trace)
        position = np.cumsum(speed) / rate
        even = np.arange(position[0], position[-1], RECORDED_SPEED / rate)
        placed = {
            "along the recorded path": (np.interp(even, position, texture), RECORDED_SPEED),
            "at the segment's mean speed": (texture, speed.mean()),
            "at the collection's mean speed": (texture, RECORDED_SPEED),
        }
        for played in SPEEDS:
            fresh = band_levels_db(_record(surface, played, 1), rate)
            place = played * np.arange(round(SECONDS * rate)) / rate
            for name, (signal_, reference) in placed.items():
                profile = TextureProfile(signal_, rate, reference, separate=False)
                read = profile.read(place, np.full(len(place), played))
                levels = band_levels_db(read * (played / reference) ** SPEED_EXPONENT, rate)
                found.setdefault(name, {}).setdefault(f"{played:g} mm/s", []).append(np.abs(levels - fresh).mean())
    return {name: {speed: float(np.mean(values)) for speed, values in row.items()} for name, row in found.items()}


def stick_slip(surfaces, quiet):
    """What a `TextureStream` makes of surfaces with stick-slip at other speeds and loads, against fresh recordings.

    Group of surfaces -> "speed, load: way of playing" -> nine-band error (leaf, dB), number of events over that of
    fresh recordings (leaf, means over surfaces), and by how much it is off on the median surface.
    """
    found, chosen = {}, list(_sticking(surfaces))
    for surface, texture, first, much in tqdm(chosen, disable=quiet, desc="stick-slip"):
        profile, in_place = (TextureProfile(texture, DEVICE_RATE, RECORDED_SPEED, separate=s) for s in (True, False))
        found.setdefault("events found", []).append((first, much, profile.events is not None))
        own = {name: getattr(surface.parameters, name.replace("force", "load")) for name in EXPONENTS}
        for case in STICKING:
            other = _record(surface, case[0], 2, case[1])
            made = {
                "fresh": _record(surface, case[0], 1, case[1]),
                "stream": _stream(profile, *case),
                "events in place": _stream(in_place, *case),
                "stream, the surface's own exponents": _stream(profile, *case, **own),
                "nothing done": np.resize(texture, round(SECONDS * DEVICE_RATE)),
                "another recording, as short as the texture": np.resize(other[:SEGMENT_SAMPLES], other.shape),
                "another recording": other,
            }
            levels = band_levels_db(np.stack([*made.values()]), DEVICE_RATE)
            events = tactile_features(np.stack([*made.values()]))[:, FEATURE_NAMES.index("event_rate")]
            for way, level, rate in list(zip(made, levels, events, strict=True))[1:]:
                name = f"{case[0]:g} mm/s, {case[1]:g} N: {way}"
                found.setdefault(name, []).append((np.abs(level - levels[0]).mean(), rate, events[0]))
    first, much, events = np.array(found.pop("events found")).T
    groups = {"all": first, "a tenth of the power or more in stick-slip": much}
    caught = {"of those with much": int((events & much).sum()), "of the others": int((events & ~much).sum())}
    rows = {name: np.array(values) for name, values in found.items()}
    return {"events found": caught} | {
        f"{group} ({mask.sum()})": {name: _summary(values[mask]) for name, values in rows.items()}
        for group, mask in groups.items()
        if mask.sum() > 1
    }


def _sticking(surfaces):
    """The first surfaces with stick-slip, and as many as a third of them with much: yields each surface, a texture of
    it, whether it is among the first, and whether it has much.
    """
    count, wanted = 0, max(1, surfaces // 3)
    for index in itertools.count(FIRST_STICKING):
        surface = VirtualSurface(SEED, index)
        if surface.parameters.stick <= 0:
            continue
        texture = _record(surface, RECORDED_SPEED, 0)[:SEGMENT_SAMPLES]
        first, much = count < surfaces, bool(_stick_slip_share(surface, texture) >= MUCH_STICK_SLIP)
        if first or much:
            yield surface, texture, first, much
        count, wanted = count + 1, wanted - much
        if count >= surfaces and wanted <= 0:
            return


def _summary(values):
    """Of rows (surfaces, 3): error in dB, events a second, events a second of the fresh recording."""
    error, made, fresh = values.T
    ratio = estimate(lambda mask: made[mask].sum() / max(fresh[mask].sum(), 1e-9), np.arange(len(values)))
    off = np.abs(made - fresh) / np.maximum(fresh, 1 / SECONDS)
    return {
        "nine bands, dB": leaf(error),
        "events over fresh": ratio,
        "off on the median surface": float(np.median(off)),
    }


def _stick_slip_share(surface, texture):
    """Share of the power of a texture that its stick-slip has, from another draw of it."""
    samples, speed = (
        round((SETTLING + SECONDS) * DEVICE_RATE),
        np.full(round((SETTLING + SECONDS) * VELOCITY_RATE), 80.0),
    )
    sliding = laws.friction_coefficient(surface.parameters, REFERENCE_FORCE, speed) * REFERENCE_FORCE
    rng = np.random.default_rng([SEED, surface.index, 3])
    train = friction.stick_slip(rng, surface.parameters, sliding, speed, samples)
    train = friction.low_pass(train, np.full(samples, laws.finger_cutoff(RECORDED_SPEED)), DEVICE_RATE)
    return np.square(band_pass(train, DEVICE_RATE)).mean() / np.square(texture).mean()


def _stream(profile, speed, normal_force, **options):
    """What a stream gives a finger of steady speed and load: texture alone, N."""
    stream, times = TextureStream(profile, 0.0, 1000.0, **options), np.arange(0, SETTLING + SECONDS, 1e-3)
    stream.report(times, speed * times)
    blocks = [stream.read_friction(BLOCK, normal_force)[0] for _ in range(len(times) * 10 // BLOCK + 1)]
    return np.concatenate(blocks)[-round(SECONDS * DEVICE_RATE) :]


def _record(surface, speed, trial, normal_force=REFERENCE_FORCE):
    """Filtered lateral force of a straight slide, N."""
    exploration = steady_exploration(speed, normal_force, SETTLING + SECONDS)
    force = surface.record(exploration, np.random.default_rng([SEED, surface.index, round(speed), trial]))
    return band_pass(force[:, 0], DEVICE_RATE)[round(SETTLING * DEVICE_RATE) :]


def _played(surface, texture, speed):
    """What a finger of a speed is given: by the profile, by simpler profiles, and by what knows no speed."""
    samples = round(SECONDS * DEVICE_RATE)
    position, steady = speed * np.arange(samples) / DEVICE_RATE, np.full(samples, speed)
    louder = (speed / RECORDED_SPEED) ** SPEED_EXPONENT
    settings = (texture, DEVICE_RATE, RECORDED_SPEED)
    filled, held = (TextureProfile(*settings, fill=fill, separate=False) for fill in (True, False))
    return {
        "profile": louder * filled.read(position, steady),
        "not filled": louder * held.read(position, steady),
        "no law of speed": filled.read(position, steady),
        "time signal, whatever the speed": texture,
        "another recording at that speed": _record(surface, speed, 2),
    }


def sensor(profiles, rate, resolution):
    """What a sensor of a rate (Hz) and resolution (mm) adds to the force, in the worst of three motions: a dict."""
    motions = (lambda t: 80 * t, lambda t: 30 * t, lambda t: 40 * np.sin(np.pi * t))
    spurious, away = [], []
    smoother = signal.butter(4, HAND_HZ, fs=DEVICE_RATE, output="sos")
    for stroke in motions:
        path, place = _follow(stroke, rate, resolution, 6.0)
        smooth = signal.sosfiltfilt(smoother, place)
        kept = slice(DEVICE_RATE, len(place) - DEVICE_RATE)
        for profile in profiles:
            felt, wanted = (profile.read(x[kept], np.gradient(x[kept]) * DEVICE_RATE) for x in (place, smooth))
            spurious.append(10 * np.log10(np.mean((felt - wanted) ** 2) / np.mean(wanted**2)))
        away.append(np.abs(place - stroke(np.arange(len(place)) / DEVICE_RATE))[kept].max())
    return {"spurious dB": float(max(spurious)), "place mm": float(max(away)), "latency ms": 1e3 * path.latency}


def _follow(stroke, rate, resolution, seconds):
    path = FingerPath(DEVICE_RATE, rate)
    times = np.arange(0, seconds, 1 / rate)
    path.report(times, np.round(stroke(times) / resolution) * resolution)
    return path, np.concatenate([path.advance(BLOCK)[0][:, 0] for _ in range(int(seconds * DEVICE_RATE / BLOCK))])


def clock(profiles, minutes, seed, quiet):
    """Times of blocks while the finger moves at random and the surface changes twice a second: a dict."""
    blocks, place = round(minutes * 60 * DEVICE_RATE / BLOCK), motion(minutes, seed)
    stream, each = TextureStream(profiles[0], 0.0, SENSOR_HZ), round(0.5 * DEVICE_RATE / BLOCK)

    def change(index):
        if index % each == 0:
            stream.replace(profiles[index // each % 2], 0.0)

    with on_time():
        times, late, found = play(stream, place, blocks, change, quiet, "clock")
    fastest = float(np.abs(np.diff(place)).max() * SENSOR_HZ)
    own = max(largest_step(profile, fastest) for profile in profiles)
    return delays(times) | {
        "budget ms": 1e3 * BUDGET,
        "late blocks": int((times > BUDGET).sum()),
        "share of a core": float(times.sum() / (blocks * BUDGET)),
        "profiles' own mN": 1e3 * own,
        **found,
    }


def markdown(report):
    """The tables."""
    columns = [f"{speed:g} mm/s" for speed in SPEEDS]
    parts = [
        f"{title('Playback in space', 4)}Nine-band error, dB, of what a finger of another speed is given against fresh "
        f"recordings of the same {report['surfaces']} virtual surfaces there; profiles recorded at "
        f"{RECORDED_SPEED:g} mm/s. {report['machine']}."
    ]
    labels, materials = {column: column for column in columns}, {}
    for group, rows in report["recordings"].items():
        if group.startswith("all"):
            materials[f"{group} ({rows['surfaces']})"] = rows["profile"]
        else:
            table = {name: values for name, values in rows.items() if name != "surfaces"}
            parts.append(f"{group} ({rows['surfaces']})\n\n{markdown_table(table, labels=labels)}")
    parts.append(f"the profile, by material\n\n{markdown_table(materials, labels=labels)}")
    parts.append(
        "Recorded by a hand whose speed wanders between 66 and 99 mm/s, without stick-slip, and placed in space in "
        "three ways. Checkpoints carry the last one, `reference_speed`: the others gain little, and DALE would have "
        "to generate a speed.\n\n" + markdown_table(report["whose speed"], labels=labels)
    )
    parts.append(f"{title('Stick-slip', 4)}{_about_stick_slip(report['stick-slip'])}")
    for group, rows in report["stick-slip"].items():
        if group != "events found":
            parts.append(f"{group}\n\n{markdown_table(rows, interval=True)}")
    parts.append(
        f"{title('Sensors', 4)}What reports of a touch sensor add to the force, against the texture, in the worst of "
        "slow, fast and to-and-fro motion; how far the place is off; when a change of speed is felt.\n\n"
        + markdown_table(report["sensors"])
    )
    parts.append(
        f"{title('On time', 4)}Blocks of {BLOCK} samples at 10 kHz under random motion; the surface changes twice a "
        "second; without mean friction, so that steps are the texture's.\n\n"
        + markdown_table({"stream": report["clock"]}, 3)
    )
    return "\n\n".join(parts) + "\n"


def _about_stick_slip(report):
    found = report["events found"]
    return (
        f"Surfaces with stick-slip, from {FIRST_STICKING} on, recorded at {RECORDED_SPEED:g} mm/s and "
        f"{REFERENCE_FORCE:g} N, as a `TextureStream` plays them. Nine-band error against fresh recordings; number of "
        "events of the embedding over theirs; both with 95 % intervals over surfaces. One texture does not tell by "
        "which powers of speed and load it grows: the surface's own exponents would have to be measured. Events were "
        f"found in {found['of those with much']} textures with a tenth of their power or more in stick-slip and in "
        f"{found['of the others']} others."
    )


if __name__ == "__main__":
    sys.exit(main())
