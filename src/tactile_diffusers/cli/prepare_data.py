"""`tactile-diffusers prepare`: generates or converts recordings, and prepares a data set from them."""

import argparse
from pathlib import Path

import pandas as pd

from .. import virtual
from ..data import HoldOut, PreparedDataset, SegmentLimits, prepare_recordings, split_surfaces
from ..data.folder import convert_folder, draft_layout, inspect_folder
from ..data.splits import check_split
from ..data.turnarounds import DEFAULT_TURNAROUNDS, TURNAROUNDS
from ..io.argument_types import count, positive_number, seed
from ..io.files import check_parent, write_text
from ..signal import BAND_HZ, DEVICE_RATE, SEGMENT_SECONDS
from ..virtual.raters import FURTHER_AXES, RATERS, RATING_CORRELATION
from .program import Parser, command, existing_file, existing_folder, program

#: Options of each source with their defaults; `None` = required.
SOURCE_OPTIONS = {
    "virtual": {
        "surfaces": 50,
        "seconds": 30.0,
        "explorers": 2,
        "seed": 0,
        "agreement": 1.0,
        "raters": RATERS,
        "rating_correlation": RATING_CORRELATION,
        "impulsiveness": 1.0,
        "further_axes": (),
        "workers": 1,
        "output": None,
    },
    "folder": {"root": None, "layout": None, "output": None},
    "recordings": {"recordings": None},
}
DESCRIPTION = """\
Brings recordings into one file (recordings.h5) and prepares a data set from it.

  --source virtual     virtual surfaces, explored and rated, are written to --output
  --source folder      the folder --root, described by --layout, is converted to --output; the keys of a layout are
                       explained at the top of src/tactile_diffusers/data/folder/layout.py
                       (pydoc tactile_diffusers.data.folder.layout), examples/configs/sens3_layout.toml is one
  --source recordings  an existing recordings.h5

With --prepared the recordings are then filtered, cut into segments and split by surface. On its own:

  --inspect DIR        drafts a layout of a folder, with TODO where it could not tell; --draft layout.toml writes it
"""


def build_parser():
    """The parser, with defaults and units in --help."""
    parser = Parser(
        prog=program("prepare_data.py"),
        usage="%(prog)s [--source SOURCE] [options of the source; --help lists them]",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--source", choices=tuple(SOURCE_OPTIONS), default="virtual", help="default: virtual")
    parser.add_argument("--quiet", action="store_true", help="no progress bars")
    _add_files(parser.add_argument_group("files").add_argument)
    _add_virtual(parser.add_argument_group("virtual surfaces").add_argument)
    _add_segments(parser.add_argument_group("segments").add_argument)
    _add_splits(parser.add_argument_group("split by surface").add_argument)
    return parser


def _add_files(add):
    file, folder = {"type": existing_file, "metavar": "FILE"}, {"type": existing_folder, "metavar": "FOLDER"}
    add("--output", type=Path, metavar="FILE", help="recordings.h5 to write; required unless --source recordings")
    add("--recordings", **file, help="recordings.h5 to read; required by --source recordings")
    add("--root", **folder, help="folder of the recordings; required by --source folder")
    add("--layout", **file, help="layout.toml of the folder; required by --source folder")
    add("--prepared", type=Path, metavar="FILE", help="prepared data set to write; default: none")
    add("--inspect", **folder, help="draft a layout of a folder, and stop")
    add("--draft", type=Path, metavar="FILE", help="with --inspect: layout to write; default: none")


def _add_virtual(add):
    def number(name, convert, purpose):
        add(f"--{name}", type=convert, metavar="N", help=f"{purpose}; default: {SOURCE_OPTIONS['virtual'][name]:g}")

    number("surfaces", count, "number of surfaces")
    number("seconds", positive_number, "mean duration of a recording, s")
    number("explorers", count, "recordings per surface, by other fingers from the third on")
    number("raters", count, "number of raters")
    number("seed", seed, "seed of surfaces, explorations and raters")
    number("agreement", positive_number, "divides the raters' disagreement")
    number("impulsiveness", float, "0 = Gaussian textures, 1 = as fingers measure them, 2 = twice as many catches")
    shown = "{:g} {:g} {:g}".format(*RATING_CORRELATION)
    purpose = f"correlations of (rough, bumpy), (rough, slippery), (bumpy, slippery) in the ratings; default: {shown}"
    add("--rating_correlation", nargs=3, type=float, metavar="R", help=purpose)
    shown = f"axes beside the three on which the raters answer, of {', '.join(FURTHER_AXES)}; default: none"
    add("--further_axes", nargs="+", choices=FURTHER_AXES, metavar="AXIS", help=shown)
    number("workers", count, "processes; the result does not depend on it")


def _add_segments(add):
    limits = SegmentLimits()
    pairs = {
        "normal_force": ("normal force of a segment, N", limits.normal_force),
        "speed": ("speed of a segment, mm/s", limits.speed),
        "band": ("band-pass, Hz", BAND_HZ),
    }
    for name, (purpose, default) in pairs.items():
        shown = "{}; default: {} {}".format(purpose, *default)
        add(f"--{name}", nargs=2, type=float, metavar=("LOW", "HIGH"), help=shown)
    add("--no_limits", action="store_true", help="any normal force and speed")
    numbers = {
        "longest_excursion": (limits.longest_excursion, "longest time outside the limits that is bridged, s"),
        "segment_seconds": (SEGMENT_SECONDS, "length of a segment, s"),
        "overlap": (limits.overlap, "overlap of segments, share of a segment"),
    }
    for name, (default, purpose) in numbers.items():
        add(f"--{name}", type=float, default=default, metavar="X", help=f"{purpose}; default: %(default)s")
    treated = "how reversals inside a segment are treated (keep = the paper); default: %(default)s"
    add("--turnarounds", choices=TURNAROUNDS, default=DEFAULT_TURNAROUNDS, help=treated)


def _add_splits(add):
    for name in ("validation", "test"):
        held = f"{name} surfaces: a share below 1, or a number; default: %(default)s"
        add(f"--{name}", type=float, default=0.1, metavar="N", help=held)
    add("--split_seed", type=int, default=0, metavar="N", help="seed of the split; default: %(default)s")
    for kind, example in (("surfaces", "'*-rubber'"), ("explorers", "explorer-2"), ("raters", "rater-10 rater-11")):
        held = f"{kind} kept for the split 'hard', for example {example}; default: none"
        add(f"--hold_out_{kind}", nargs="+", default=(), metavar="PATTERN", help=held)


@command("prepare_data.py", one_line=False)  # why no segment meets the limits is a list
def main(argv=None):
    """Runs the command."""
    parser = build_parser()
    args = parser.parse_args(argv)
    _check_inspect(parser, args)
    if args.inspect is not None:
        _inspect(args)
    else:
        _check_source(parser, args)
        preparation = _preparation(args) if args.prepared is not None else None
        recordings = _recordings(args)
        if preparation is not None:
            report = prepare_recordings(recordings, args.prepared, **preparation)
            _print_ratings(PreparedDataset(args.prepared, "all", "full").set_axes())
            _print_report(report, args.prepared)


def _check_inspect(parser, args):
    """Refuses options of other work beside --inspect."""
    if args.inspect is None:
        if args.draft is not None:
            parser.error("--draft belongs to --inspect.")
        return
    others = sorted({name for options in SOURCE_OPTIONS.values() for name in options} | {"prepared"})
    if unused := [f"--{name}" for name in others if getattr(args, name) is not None]:
        parser.error(f"--inspect does one thing, and stops: leave out {', '.join(unused)}.")


def _check_source(parser, args):
    """Fills the defaults of the source and refuses what does not fit it, before any work."""
    options = SOURCE_OPTIONS[args.source]
    for name in {name for others in SOURCE_OPTIONS.values() for name in others} - set(options):
        if getattr(args, name) is not None:
            owners = [source for source, others in SOURCE_OPTIONS.items() if name in others]
            own = " Files of your own: --source folder." if "folder" in owners else ""
            parser.error(f"--{name} belongs to --source {' or '.join(owners)}, not to {args.source}.{own}")
    for name, default in options.items():
        if getattr(args, name) is None:
            if default is None:
                hint = " Write one with --inspect DIR --draft layout.toml." if name == "layout" else ""
                parser.error(f"--source {args.source} needs --{name}.{hint}")
            setattr(args, name, default)
    if args.source == "recordings" and args.prepared is None:
        parser.error("--source recordings needs --prepared.")
    if args.no_limits and (args.normal_force or args.speed):
        parser.error("--no_limits contradicts --normal_force and --speed: give one or the other.")
    written = [path for path in (args.output, args.prepared) if path is not None]
    for path in written:
        check_parent(path)
    paths = [path.resolve() for path in (*written, args.recordings, args.root, args.layout) if path is not None]
    if len(set(paths)) < len(paths):
        parser.error("the files to read and to write must differ.")


def _preparation(args):
    """Keyword arguments of `prepare_recordings`, checked as far as they can be without the data."""
    asked = {name: tuple(getattr(args, name)) for name in ("normal_force", "speed") if getattr(args, name)}
    if args.no_limits:
        asked = {"normal_force": None, "speed": None}
    limits = SegmentLimits(
        longest_excursion=args.longest_excursion, seconds=args.segment_seconds, overlap=args.overlap, **asked
    )
    band = tuple(args.band) if args.band else BAND_HZ
    if not 0 < band[0] < band[1] < DEVICE_RATE / 2:
        raise ValueError(f"--band must satisfy 0 < LOW < HIGH < {DEVICE_RATE / 2:g} Hz, got {band}.")
    check_split(args.validation, args.test, args.split_seed)
    if args.source == "virtual":
        split_surfaces(args.surfaces, args.validation, args.test, args.split_seed)
        if args.seconds < limits.seconds:
            raise ValueError(f"--seconds must be at least one segment, {limits.seconds} s, got {args.seconds}.")
    same = {name: getattr(args, name) for name in ("validation", "test", "split_seed", "turnarounds", "quiet")}
    return same | {"band": band, "limits": limits, "hold_out": _hold_out(args)}


def _hold_out(args):
    """What is held out; of a virtual collection the names are known in advance, so they are checked."""
    held = {kind: tuple(getattr(args, f"hold_out_{kind}")) for kind in ("surfaces", "explorers", "raters")}
    if not any(held.values()):
        return None
    hold_out = HoldOut(**held)
    if args.source == "virtual":
        if hold_out.surfaces:
            names = [virtual.VirtualSurface(args.seed, index).name for index in range(args.surfaces)]
            hold_out.matches("surfaces", names)
        hold_out.matches("explorers", [f"explorer-{number}" for number in range(args.explorers)])
        hold_out.matches("raters", [f"rater-{number}" for number in range(args.raters)])
    return hold_out


def _inspect(args):
    if args.draft is not None:
        check_parent(args.draft)
        if args.draft.exists():
            raise ValueError(f"--draft {args.draft} exists: give another name, a layout may hold work of yours.")
    inventory = inspect_folder(args.inspect, quiet=args.quiet)
    if not inventory.groups:
        raise ValueError(f"--inspect {args.inspect}: there is no file that can be read as a table, so no draft of it.")
    layout = draft_layout(inventory)
    if args.draft is None:
        return print(f"{layout}\n--draft layout.toml writes this layout.")
    write_text(args.draft, layout)
    print(f"wrote {args.draft}: fill in every TODO, then --source folder --root {args.inspect} --layout {args.draft}")


def _recordings(args):
    """Generates or converts recordings; returns the file."""
    if args.source == "recordings":
        return args.recordings
    if args.source == "virtual":
        settings = {name: getattr(args, name) for name in SOURCE_OPTIONS["virtual"] if name != "output"}
        virtual.generate_recordings(args.output, quiet=args.quiet, **settings)
        print(f"wrote {args.output}")
    else:
        _print_report(convert_folder(args.root, args.layout, args.output, quiet=args.quiet), args.output)
    return args.output


def _print_ratings(data):
    """Prints the ratings of the first twenty surfaces."""
    table = pd.DataFrame(data.ratings.mean, data.surfaces, data.ratings.axes).dropna(how="all")
    if len(table):
        shown = table.head(20).to_string(float_format="{:+.2f}".format)
        print(f"ratings in z-scores, as `generate` takes them (first {min(len(table), 20)} of {len(table)}):\n{shown}")


def _print_report(report, written):
    """Prints a report, and the number of its notes: they scroll away."""
    text = str(report)
    notes = sum(line.startswith("note: ") for line in text.splitlines())
    print(f"{text}\nwrote {written}" + (f"; {notes} note{'s' * (notes > 1)} above: read them first" if notes else ""))
