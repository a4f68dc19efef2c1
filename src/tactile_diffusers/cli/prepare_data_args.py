"""Flags of the data command, and what is refused before any work."""

import argparse
from pathlib import Path

from ..data import SegmentLimits
from ..data.folder import EXPORT_KINDS
from ..data.turnarounds import DEFAULT_TURNAROUNDS, TURNAROUNDS
from ..signal import BAND_HZ, SEGMENT_SECONDS
from ..virtual.raters import RATERS
from .program import Parser, program

_REQUIRED = None
#: Flags that belong to some sources only, with their defaults; `None` = required.
SOURCE_FLAGS = {
    "virtual": {
        "surfaces": 50,
        "seconds": 30.0,
        "explorers": 2,
        "seed": 0,
        "agreement": 1.0,
        "raters": RATERS,
        "rater_moisture": 0.0,
        "axis_correlation": 0.0,
        "duration_spread": 0.0,
        "workers": 1,
        "output": _REQUIRED,
    },
    "sens3": {"root": _REQUIRED, "layout": _REQUIRED, "output": _REQUIRED},
    "folder": {"root": _REQUIRED, "layout": _REQUIRED, "output": _REQUIRED},
    "recordings": {"recordings": _REQUIRED},
}
#: Flags that stand for work of their own, and flags of sources that they need.
ALONE = {"inspect": set(), "export_folder": {"recordings"}, "calibrate": set()}
DESCRIPTION = """\
Brings recordings into one file (recordings.h5) and prepares a data set from it.

  --source virtual     virtual surfaces, explored and rated, are written to --output
  --source sens3       the folder --root, described by --layout, is converted to --output, and compared with SENS3
  --source folder      likewise, anyone's folder; the keys of a layout are explained at the top of
                       src/tactile_diffusers/data/folder/layout.py (pydoc tactile_diffusers.data.folder.layout)
  --source recordings  an existing recordings.h5

With --prepared the recordings are then filtered, cut into segments and split by surface. On their own:

  --inspect DIR        lists what is in a folder; --draft layout.toml writes a layout with TODO where it could not tell
  --export-folder DIR  writes --recordings as a plain folder with its layout
  --calibrate          recomputes the constants of the virtual percepts
"""


def build_parser():
    """The parser, with defaults told in --help."""
    parser = Parser(
        prog=program("prepare_data.py"),
        usage="%(prog)s [--source SOURCE] [flags of the source; --help lists them]",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--source", choices=tuple(SOURCE_FLAGS), default="virtual", help="default: virtual")
    parser.add_argument("--quiet", action="store_true", help="no progress bars")
    _add_files(parser.add_argument_group("files"))
    _add_virtual(parser.add_argument_group("virtual surfaces"))
    _add_segments(parser.add_argument_group("segments"))
    _add_splits(parser.add_argument_group("split by surface"))
    return parser


def _add_files(group):
    group.add_argument("--output", type=Path, help="recordings.h5 to write")
    group.add_argument("--recordings", type=Path, help="recordings.h5 to read")
    group.add_argument("--root", type=Path, help="folder of the recordings (sens3, folder)")
    group.add_argument("--layout", type=Path, help="layout.toml of the folder (sens3, folder)")
    group.add_argument("--prepared", type=Path, help="prepared data set to write")
    group.add_argument("--inspect", type=Path, metavar="DIR", help="list what is in a folder, and stop")
    group.add_argument("--draft", type=Path, metavar="LAYOUT", help="with --inspect: layout to write")
    group.add_argument("--export-folder", type=Path, metavar="DIR", help="write --recordings as a folder, and stop")
    group.add_argument("--export-kind", choices=EXPORT_KINDS, help="files of the folder; default csv")


def _add_virtual(group):
    group.add_argument("--surfaces", type=int, help="number of surfaces; default 50")
    group.add_argument("--seconds", type=float, help="mean duration of a recording; default 30")
    group.add_argument("--explorers", type=int, help="recordings per surface, other fingers from the third; default 2")
    group.add_argument("--raters", type=int, help=f"default {RATERS}")
    group.add_argument("--seed", type=int, help="of surfaces, explorations and raters; default 0")
    group.add_argument("--agreement", type=float, help="divides the raters' disagreement; default 1, the recipe")
    group.add_argument("--rater-moisture", type=float, help="spread of the raters' own moisture; default 0 (try 0.25)")
    group.add_argument("--axis-correlation", type=float, help="halo: axes correlate up to this; default 0 (up to 0.6)")
    group.add_argument("--duration-spread", type=float, help="uneven sampling: sd of the log duration; default 0")
    group.add_argument("--workers", type=int, help="processes; the result does not depend on it; default 1")
    group.add_argument("--calibrate", action="store_true", help="recompute the constants of the percepts, and stop")


def _add_segments(group):
    limits, low_high, both = SegmentLimits(), ("LOW", "HIGH"), "; default {} {}"
    numbers = {"nargs": 2, "type": float, "metavar": low_high}
    group.add_argument("--normal-force", **numbers, help="N" + both.format(*limits.normal_force))
    group.add_argument("--speed", **numbers, help="mm/s" + both.format(*limits.speed))
    group.add_argument("--no-limits", action="store_true", help="any normal force and speed")
    group.add_argument(
        "--longest-excursion",
        type=float,
        default=limits.longest_excursion,
        help="longest time outside the limits that is bridged, s; default %(default)s",
    )
    group.add_argument(
        "--turnarounds",
        choices=TURNAROUNDS,
        default=DEFAULT_TURNAROUNDS,
        help="what becomes of reversals inside a segment (keep = the paper); default %(default)s",
    )
    group.add_argument("--segment-seconds", type=float, default=SEGMENT_SECONDS, help="default %(default)s")
    group.add_argument("--overlap", type=float, default=limits.overlap, help="share of a segment; default %(default)s")
    group.add_argument("--band", **numbers, help="Hz" + both.format(*BAND_HZ))
    group.add_argument("--filter-order", type=int, default=4, help="Butterworth, per edge; default %(default)s")
    group.add_argument(
        "--filter-passes", type=int, default=2, choices=(1, 2), help="2 = zero phase; default %(default)s"
    )


def _add_splits(group):
    group.add_argument("--validation", type=float, help="share below 1, or number of surfaces; default 0.1")
    group.add_argument("--test", type=float, help="likewise; default 0.1")
    group.add_argument("--split-seed", type=int, default=0, help="default %(default)s")
    for kind, example in (("surfaces", "'*-rubber'"), ("explorers", "explorer-2"), ("raters", "rater-10 rater-11")):
        group.add_argument(
            f"--hold-out-{kind}",
            nargs="+",
            default=(),
            metavar="PATTERN",
            help=f"kept for the split 'hard', for example {example}",
        )


def check(parser, args):
    """Fills the defaults of the source and refuses what does not fit it, before any work."""
    flags = SOURCE_FLAGS[args.source]
    for name in dict.fromkeys(name for others in SOURCE_FLAGS.values() for name in others):
        if name not in flags and getattr(args, name) is not None:
            owners = [source for source, others in SOURCE_FLAGS.items() if name in others]
            own = " Files of your own: --source folder." if "folder" in owners else ""
            parser.error(f"{_flag(name)} belongs to --source {' or '.join(owners)}, not to {args.source}.{own}")
    for name, default in flags.items():
        if getattr(args, name) is None:
            if default is _REQUIRED:
                hint = " Write one with --inspect DIR --draft layout.toml." if name == "layout" else ""
                parser.error(f"--source {args.source} needs {_flag(name)}.{hint}")
            setattr(args, name, default)
    if args.source == "recordings" and args.prepared is None:
        parser.error("--source recordings needs --prepared.")
    _check_files(parser, args)
    if args.no_limits and (args.normal_force or args.speed):
        parser.error("--no-limits contradicts --normal-force and --speed: give one or the other.")


def check_export(parser, args):
    """Refuses an export without recordings."""
    if args.recordings is None:
        parser.error("--export-folder needs --recordings.")
    _must_exist(parser, args, "recordings")


def check_alone(parser, args):
    """Refuses flags of other work beside --inspect, --export-folder or --calibrate, and theirs without them."""
    for name, owner in (("draft", "inspect"), ("export_kind", "export_folder")):
        if getattr(args, name) is not None and getattr(args, owner) is None:
            parser.error(f"{_flag(name)} belongs to {_flag(owner)}.")
    given = [name for name, value in vars(args).items() if value is not None and value is not False]
    alone = next((name for name in ALONE if name in given), None)
    if alone is None:
        return
    others = {name for flags in SOURCE_FLAGS.values() for name in flags} | {"prepared", *ALONE}
    unused = ", ".join(_flag(name) for name in sorted(given) if name in others - ALONE[alone] - {alone})
    if unused:
        parser.error(f"{_flag(alone)} does one thing, and stops: leave out {unused}.")
    if args.draft is not None and not args.draft.parent.is_dir():
        parser.error(f"the folder {args.draft.parent} of {args.draft.name} does not exist: create it first.")


def _flag(name):
    return "--" + name.replace("_", "-")


def _must_exist(parser, args, name, folder=False):
    path = getattr(args, name)
    if path is not None and not (path.is_dir() if folder else path.is_file()):
        parser.error(f"{_flag(name)}: there is no {'folder' if folder else 'file'} {path}.")


def _check_files(parser, args):
    _must_exist(parser, args, "recordings")
    _must_exist(parser, args, "layout")
    _must_exist(parser, args, "root", folder=True)
    written = [path for path in (args.output, args.prepared) if path is not None]
    for path in written:
        if not path.parent.is_dir():
            parser.error(f"the folder {path.parent} of {path.name} does not exist: create it first.")
    paths = [path.resolve() for path in (*written, args.recordings, args.root, args.layout) if path is not None]
    if len(set(paths)) < len(paths):
        parser.error("the files to read and to write must differ.")
