"""`tactile-diffusers play`: the force that a finger would meet along a trajectory."""

import math
from pathlib import Path

import numpy as np

from ..export.convert import read_texture
from ..signal import DEVICE_RATE, REFERENCE_FORCE
from .program import Parser, command, existing_file, positive_number, program

SUFFIXES = (".wav", ".npz")


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
    add("--output", type=Path, required=True, metavar="FILE", help=".wav with its .wav.json, or .npz with force, "
        "friction and speed")  # fmt: skip
    add("--mean_friction", action="store_true", help="write the force on the finger, mean friction included, against "
        "its motion; without it: friction about its mean, positive = more")  # fmt: skip
    add("--drive_profile", type=existing_file, metavar="FILE.json", help="of a display: write its drive, V or relative "
        "amplitude, in place of newtons")  # fmt: skip
    add("--normal_force", type=positive_number, default=REFERENCE_FORCE, metavar="N",
        help=f"of the finger; default: {REFERENCE_FORCE}")  # fmt: skip
    add("--rate", type=positive_number, default=DEVICE_RATE, metavar="HZ",
        help=f"of what is written, a whole number above 2000; default: {DEVICE_RATE}")  # fmt: skip
    arguments = parser.parse_args(argv)
    if arguments.output.suffix not in SUFFIXES:
        parser.error(f"argument --output: {arguments.output} must end in {' or '.join(SUFFIXES)}")
    if arguments.drive_profile and arguments.mean_friction:
        parser.error("argument --mean_friction: leave it out, a drive has the mean as its bias")
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
    if arguments.mean_friction and position.ndim == 2 and arguments.output.suffix == ".wav":
        raise ValueError("--mean_friction on a plane is a force of two channels. Write it as .npz.")
    profile = TextureProfile(texture, about["sampling_rate"], about["reference_speed"])
    friction = 0.0 if math.isnan(about["friction_coefficient"]) else about["friction_coefficient"]
    played = play_trajectory(profile, friction, time, position, arguments.rate, arguments.normal_force)
    values, unit = (played.force if arguments.mean_friction else played.friction), "N"
    if arguments.drive_profile:
        values, unit = _drive(arguments.drive_profile, played)
    _write(arguments.output, values, unit, played, about)
    print(
        f"{arguments.output}: {len(values) / played.sampling_rate:.2f} s at {played.sampling_rate:g} Hz, peak "
        f"{np.abs(values).max():.3g} {'of full amplitude' if unit == '1' else unit}; a change of speed is felt "
        f"{1e3 * played.latency:.0f} ms later"
    )


def _drive(path, played):
    from ..display import DriveProfile

    display = DriveProfile.load(path)
    drive, report = display.drive(played.friction, played.speed, sampling_rate=played.sampling_rate)
    if report.clipped:
        print(report)
    return drive, display.drive_unit


def _write(path, values, unit, played, about):
    if path.suffix == ".wav" and unit == "N":
        from ..export.wav import write_wav

        known = {name: about[name] for name in ("friction_coefficient", "ratings", "seed", "checkpoint")}
        write_wav(path, values, sampling_rate=played.sampling_rate, **known, subtype="FLOAT")
        return
    if path.suffix == ".wav":
        raise ValueError(f"A drive in {unit} is no WAV file of newtons. Write it as .npz.")
    from ..io.files import atomic_path

    name = "drive" if unit != "N" else "force" if values is played.force else "friction"
    arrays = {name: values, "speed": played.speed, "sampling_rate": played.sampling_rate, "unit": unit}
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, **arrays)
