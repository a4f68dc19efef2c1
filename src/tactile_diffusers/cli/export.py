"""`tactile-diffusers export`: textures that this package wrote, as files for devices and other programs."""

import argparse
import math
import warnings
from pathlib import Path

from ..export.convert import FORMATS, format_of, read_texture
from ..export.generated import find_shards, read_generated
from ..export.png import HEIGHT, PIXEL_PITCH
from ..io.argument_types import count, positive_number
from ..signal import REFERENCE_FORCE
from .program import Parser, add_output_argument, command, program, warn


def parse_arguments(argv=None):
    """Arguments of the command."""
    width = max(map(len, FORMATS))
    parser = Parser(
        prog=program("export.py"),
        description="Write textures in the formats of devices and other programs.",
        epilog="formats:\n"
        + "\n".join(f"  {name:{width}}  {form.kind:8}  {form.description}" for name, form in FORMATS.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--input", type=Path, required=True, metavar="PATH", help="a file of this package in any of the "
        "formats, a folder of .npz files, or one of examples/generate_dataset.py")  # fmt: skip
    add_output_argument(parser, "folder of the files")
    add("--formats", nargs="+", choices=FORMATS, default=list(FORMATS), metavar="FORMAT", help="default: all")
    add("--pixel_pitch", type=positive_number, default=PIXEL_PITCH, metavar="MM", help="distance of two pixels on the "
        f"display, mm; for png; default: {PIXEL_PITCH}")  # fmt: skip
    add("--height", type=count, default=HEIGHT, metavar="ROWS", help=f"of the picture; for png; default: {HEIGHT}")
    add("--normal_force", type=positive_number, metavar="N", help="at which the texture was recorded, N; for png and "
        f"hjif-friction; default: what the input says, else {REFERENCE_FORCE}")  # fmt: skip
    arguments = parser.parse_args(argv)
    if not arguments.input.exists():
        parser.error(f"argument --input: {arguments.input} does not exist")
    source = arguments.input if arguments.input.is_dir() else arguments.input.parent
    if arguments.output.resolve() == source.resolve():
        parser.error(f"argument --output: {arguments.output} is where --input lies; give another folder")
    return arguments


@command("export.py")
def main(argv=None):
    """Runs the command."""
    arguments = parse_arguments(argv)
    for name, texture, metadata in read_textures(arguments.input):
        _write(name, texture, metadata, arguments)


def read_textures(path):
    """Yields the textures of a file or a folder: a name for files, the texture (samples,) in N, and its metadata."""
    if path.is_file():
        if FORMATS[format_of(path)].kind == "preview":
            warn(
                "export.py", f"{path} is a preview, amplitude and frequency alone: what is written is no more than it."
            )
        yield (_stem(path), *read_texture(path))
    elif find_shards(path):
        yield from _read_generated(path)
    else:
        files = sorted(file for file in path.glob("*.npz") if not file.name.startswith("."))  # "._a.npz" of a Mac's
        if not files:
            raise ValueError(f"The folder {path} holds neither data/train-*.parquet nor .npz files: give another one.")
        for file in files:
            yield (_stem(file), *FORMATS["npz"].read(file))


def _read_generated(folder):
    data = read_generated(folder)
    friction, ratings, seeds = (data.column(name) for name in ("friction_coefficient", "ratings", "seed"))
    speed = data.settings.get("reference_speed")
    common = {"sampling_rate": data.sampling_rate, "checkpoint": data.about.get("checkpoint")}
    common["reference_speed"] = math.nan if speed is None else speed
    for row in range(len(data)):
        own = {"friction_coefficient": float(friction[row]), "ratings": ratings[row].tolist(), "seed": int(seeds[row])}
        yield f"texture-{row:05d}", data[row], common | own


def _stem(path):
    """The name without the suffix of its format: `a.16bit.wav` is of `a`."""
    suffixes = sorted((form.suffix for form in FORMATS.values()), key=len, reverse=True)
    return path.name.removesuffix(next((suffix for suffix in suffixes if path.name.endswith(suffix)), path.suffix))


def _write(name, texture, metadata, arguments):
    """Writes one texture in every format."""
    spatial = [chosen for chosen in arguments.formats if FORMATS[chosen].spatial]
    if spatial and math.isnan(metadata["reference_speed"]):  # before any file of this texture is written
        raise ValueError(
            f"{arguments.input} knows no reference speed, so {', '.join(spatial)} cannot be written over position. "
            "Leave them out of --formats."
        )
    arguments.output.mkdir(parents=True, exist_ok=True)
    for chosen in arguments.formats:
        form = FORMATS[chosen]
        path = arguments.output / f"{name}{form.suffix}"
        given = {option: value for option in form.options if (value := getattr(arguments, option)) is not None}
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", UserWarning)
            form.write(path, texture, **form.keywords(metadata, given))
        for warning in caught:
            warn("export.py", f"{path.name}: {warning.message}")
        print(f"{path}: {form.kind}, {form.description}")
