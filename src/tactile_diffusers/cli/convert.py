"""`tactile-diffusers convert`: a texture from one format to another, and what was lost."""

from pathlib import Path

from ..export.convert import FORMATS, convert, read_texture
from ..export.device import DeviceProfile, what_is_lost
from ..io.argument_types import positive_number
from .program import Parser, command, existing_file, program


def parse_arguments(argv=None):
    """Arguments of the command."""
    parser = Parser(
        prog=program("convert.py"),
        description="Read a texture from a file of one format, write it in another, and say what was lost.",
        epilog="Formats go by the suffix: " + ", ".join(form.suffix for form in FORMATS.values()),
    )
    add = parser.add_argument
    add("--input", type=existing_file, required=True, metavar="FILE", help="a texture in any format of this package")
    add("--output", type=Path, metavar="FILE", help="the file to write")
    add("--pixel_pitch", type=positive_number, metavar="MM", help="of the display, mm; for friction.png")
    add("--normal_force", type=positive_number, metavar="N", help="at which it was recorded; for maps of friction")
    add("--device", type=existing_file, metavar="FILE.json", help="profile of a device: rate (Hz), band (Hz), "
        "one_signed, bits, amplitude (N); prints what is lost on it, band by band")  # fmt: skip
    arguments = parser.parse_args(argv)
    if arguments.output is None and arguments.device is None:
        parser.error("give --output, --device, or both: there is nothing to do")
    return arguments


@command("convert.py")
def main(argv=None):
    """Runs the command."""
    arguments = parse_arguments(argv)
    device = None if arguments.device is None else DeviceProfile.load(arguments.device)
    if arguments.output is not None:
        options = {name: getattr(arguments, name) for name in ("pixel_pitch", "normal_force")}
        given = {name: value for name, value in options.items() if value is not None}
        found = convert(arguments.input, arguments.output, **given)
        print(f"{arguments.output}: {found['bytes']} bytes", *(found["losses"] or ["Nothing was lost."]), sep="\n")
    if device is not None:
        texture, metadata = read_texture(arguments.input)
        print(what_is_lost(texture, metadata["sampling_rate"], device))
