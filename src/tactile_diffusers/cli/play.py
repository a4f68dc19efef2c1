"""`tactile-diffusers play`: the force that a finger would meet along a trajectory, and the drive of a display."""

import math
import warnings
from pathlib import Path

import numpy as np

from ..export.convert import read_texture
from ..io.argument_types import count, positive_number
from ..signal import DEVICE_RATE, REFERENCE_FORCE
from .program import Parser, command, existing_file, program, warn

SUFFIXES = (".wav", ".npz")
#: Counts of a 16-bit file at full scale.
_COUNTS = 2**15 - 1
#: A drive rises and falls over this time, s, at the ends of its file.
RAMP_SECONDS = 0.02
#: Slowest and fastest median speed, mm/s, of reports that move: beyond, positions are in another unit.
MOVING_SPEEDS = (1.0, 2000.0)


def gain(word):
    """A factor above zero, or "fit"."""
    return word if word == "fit" else positive_number(word)


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = Parser(
        prog=program("play.py"),
        description="Move a finger over a texture as a CSV file says, and write what it would meet. It starts, stops "
        "and turns as under a display that follows it, sensor's latency included.",
    )
    add = parser.add_argument
    add("--input", type=existing_file, required=True, metavar="FILE", help="a texture in any format of this package")
    add("--trajectory", type=existing_file, required=True, metavar="FILE.csv", help="time,position or time,x,y with "
        "this header, in s and mm; at least 17 rows per s")  # fmt: skip
    add("--output", type=Path, required=True, metavar="FILE", help=".npz with time, position, speed, force, friction "
        "about its mean and, with a profile, drive; or .wav with one of them and a .wav.json beside it")  # fmt: skip
    add("--mean_friction", action="store_true", help="of a .wav: the force on the finger, mean friction included, "
        "against its motion; without it: friction about its mean, positive = more")  # fmt: skip
    add("--drive_profile", type=existing_file, metavar="FILE.json", help="of a display: its drive, V or relative "
        "amplitude; a .wav of 16 bits holds it as a share of the largest")  # fmt: skip
    add("--gain", type=gain, default=1.0, metavar="G", help="factor on the friction about its mean, or `fit`: the "
        "largest, up to 1, that the display's range holds; default: 1")  # fmt: skip
    add("--normal_force", type=positive_number, default=REFERENCE_FORCE, metavar="N",
        help=f"of the finger; default: {REFERENCE_FORCE}")  # fmt: skip
    add("--rate", type=count, default=DEVICE_RATE, metavar="HZ",
        help=f"of what is written, a whole number above 2000; default: {DEVICE_RATE}")  # fmt: skip
    arguments = parser.parse_args(argv)
    if arguments.output.suffix not in SUFFIXES:
        parser.error(f"argument --output: {arguments.output} must end in {' or '.join(SUFFIXES)}")
    if arguments.drive_profile and arguments.mean_friction:
        parser.error("argument --mean_friction: leave it out, a drive has the mean as its bias")
    if arguments.gain != 1 and not arguments.drive_profile:
        parser.error("argument --gain: it is of a display's drive, give --drive_profile, too")
    return arguments


@command("play.py")
def main(argv=None):
    """Runs the command."""
    arguments = parse_arguments(argv)
    from ..playback import TextureProfile, play_trajectory, read_trajectory

    texture, about = read_texture(arguments.input)
    for name in ("reference_speed", "friction_coefficient"):
        if math.isnan(about[name]) and (name == "reference_speed" or arguments.mean_friction):
            raise ValueError(f"{arguments.input} knows no {name}, which --mean_friction or a position needs.")
    time, position = read_trajectory(arguments.trajectory)
    wav = arguments.output.suffix == ".wav"
    if arguments.mean_friction and position.ndim == 2 and wav:
        raise ValueError("--mean_friction on a plane is a force of two channels. Write it as .npz.")
    if math.isnan(about["friction_coefficient"]) and not wav:
        warn("play.py", f"{arguments.input} knows no friction_coefficient: `force` lacks the mean friction")
    profile = TextureProfile(texture, about["sampling_rate"], about["reference_speed"])
    friction = 0.0 if math.isnan(about["friction_coefficient"]) else about["friction_coefficient"]
    played = play_trajectory(profile, friction, time, position, arguments.rate, arguments.normal_force)
    values, beside = (played.force if arguments.mean_friction else played.friction), {}
    if arguments.drive_profile:
        values, beside = _drive(arguments, played)
    (_write_wav if wav else _write_npz)(arguments, values, beside, played, about)
    unit, steps = beside.get("drive_unit", "N"), np.diff(time)
    speed = np.linalg.norm(np.diff(position.reshape(len(time), -1), axis=0), axis=1) / steps
    usual = float(np.median(speed[speed > 0])) if speed.any() else 0.0
    if usual and not MOVING_SPEEDS[0] <= usual <= MOVING_SPEEDS[1]:
        warn("play.py", f"the finger moves at {usual:.3g} mm/s, its median: positions must be mm")
    print(
        f"{len(time)} reports, {1 / np.median(steps):.0f} Hz, longest gap {1e3 * steps.max():.0f} ms, {usual:.3g} mm/s "
        f"where they move; followed at 0 to {played.speed.max():.3g} mm/s, at rest or lifted "
        f"{100 * (played.speed < 1).mean():.0f} % of the time\n"
        f"peaks: force {np.abs(played.force).max():.3g} N, friction about its mean "
        f"{np.abs(played.friction).max():.3g} N\n"
        f"{arguments.output}: {len(values) / played.sampling_rate:.2f} s at {played.sampling_rate:g} Hz, the last "
        f"{1e3 * played.latency:.0f} ms after the last report, because a change of speed is felt so much later; peak "
        f"{np.abs(values).max():.3g} {'of full amplitude' if unit == '1' else unit}"
    )


def _drive(arguments, played):
    """The drive of a display, and what is written beside it; says what was clipped, and the gain that clips nothing."""
    from ..display import DriveProfile

    display, fits = DriveProfile.load(arguments.drive_profile), arguments.gain == "fit"
    if abs(arguments.normal_force / display.normal_force - 1) > 0.2:
        warn("play.py", f"--normal_force is {arguments.normal_force:g} N, the display was calibrated at "
            f"{display.normal_force:g} N: what its drive does to friction depends on it")  # fmt: skip
    gain, stream = 1.0 if fits else arguments.gain, display.stream(sampling_rate=played.sampling_rate)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of what was clipped so far: the report has the last word
        drive = stream.push(played.friction * gain, played.speed)
        if fits and stream.report.fitting_scale < 1:
            gain, stream = stream.report.fitting_scale, display.stream(sampling_rate=played.sampling_rate)
            print(f"gain {gain:.3g}")
            drive = stream.push(played.friction * gain, played.speed)
    if not fits and stream.report.clipped:
        print(f"{stream.report}: --gain {gain * stream.report.fitting_scale:.3g}, or --gain fit")
    ramp = (1 + np.arange(len(drive))) / (RAMP_SECONDS * played.sampling_rate)
    beside = {"drive_unit": display.drive_unit, "max_drive": display.max_drive, "normal_force": arguments.normal_force}
    beside |= {"gain": gain, "bias": stream.bias, "clipped_share": stream.report.share}
    return drive * np.minimum(1, np.minimum(ramp, ramp[::-1])), beside


def _write_npz(arguments, values, beside, played, about):
    from ..io.files import atomic_path

    names = ("time", "position", "speed", "force", "friction", "sampling_rate", "latency")
    arrays = {name: getattr(played, name) for name in names}
    if beside:
        arrays |= {"drive": values, **beside}
    with atomic_path(arguments.output) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, **arrays)


def _write_wav(arguments, values, beside, played, about):
    from ..export.metadata import UNITS
    from ..export.wav import write_wav, write_with_sidecar

    path = arguments.output
    if not beside:
        known = {name: about[name] for name in ("friction_coefficient", "ratings", "seed", "checkpoint")}
        which = "force on the finger, against its motion" if arguments.mean_friction else "friction about its mean"
        further = {"normal_force": arguments.normal_force, "latency": played.latency}
        further["units"] = UNITS | {"texture": f"N: {which}", "normal_force": "N", "latency": "s"}
        write_wav(path, values, sampling_rate=played.sampling_rate, **known, subtype="FLOAT", further=further)
        return
    scale = {"drive_per_count": beside["max_drive"] / _COUNTS, "unit": beside["drive_unit"], "latency": played.latency}
    samples = np.round(values / scale["drive_per_count"]).astype(np.int16)
    sidecar = {"sampling_rate": played.sampling_rate, **scale, **beside}
    write_with_sidecar(path, samples, played.sampling_rate, "PCM_16", sidecar)
