"""Command line: make or convert recordings and prepare a data set from them."""

import argparse
import json
from pathlib import Path

from ..data import (
    BIOTAC_BAND_HZ,
    BIOTAC_TEST_SURFACES,
    SegmentLimits,
    convert_biotac,
    generate_recordings,
    prepare_recordings,
    split_surfaces,
    virtual,
)
from ..signal import BAND_HZ, DEVICE_RATE, SEGMENT_SECONDS

#: Flags that belong to one source only, with their defaults; `None` = required.
SOURCE_FLAGS = {
    "virtual": {"surfaces": 50, "seconds": 30.0, "explorers": 2, "seed": 0, "agreement": 1.0, "output": None},
    "recordings": {"recordings": None, "prepared": None},
    "biotac": {"root": None, "output": None},
}
DESCRIPTION = """\
Makes or converts recordings and prepares a data set from them.

  --source virtual     virtual surfaces, explored and rated, are written to --output
  --source recordings  an existing recordings.h5 is prepared
  --source biotac      slides of a BioTac robot finger (uncalibrated, 25 mm/s) are converted to --output

With --prepared the recordings are then filtered, cut into segments and split by surface.
"""


def build_parser():
    """The parser, with defaults told in --help."""
    parser = argparse.ArgumentParser(
        prog="prepare_data.py", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    limits, low_high = SegmentLimits(), ("LOW", "HIGH")
    parser.add_argument("--source", choices=tuple(SOURCE_FLAGS), default="virtual", help="default: virtual")
    parser.add_argument("--quiet", action="store_true", help="no progress bars")

    files = parser.add_argument_group("files")
    files.add_argument("--output", type=Path, help="recordings.h5 to write (virtual, biotac)")
    files.add_argument("--recordings", type=Path, help="recordings.h5 to prepare (recordings)")
    files.add_argument("--root", type=Path, help="biotac_slide.h5 (biotac)")
    files.add_argument("--prepared", type=Path, help="prepared data set to write")

    surfaces = parser.add_argument_group("virtual surfaces")
    surfaces.add_argument("--surfaces", type=int, help="number of surfaces; default 50")
    surfaces.add_argument("--seconds", type=float, help="duration of each recording; default 30")
    surfaces.add_argument("--explorers", type=int, help="recordings per surface; default 2")
    surfaces.add_argument("--seed", type=int, help="of surfaces, explorations and raters; default 0")
    surfaces.add_argument("--agreement", type=float, help="divides the raters' disagreement; default 1, the recipe")
    surfaces.add_argument("--calibrate", action="store_true", help="recompute the constants of the percepts, and stop")

    cut = parser.add_argument_group("segments")
    both = "; default {} {}"
    cut.add_argument(
        "--normal-force", nargs=2, type=float, metavar=low_high, help="N" + both.format(*limits.normal_force)
    )
    cut.add_argument(
        "--speed", nargs=2, type=float, metavar=low_high, help="mm/s" + both.format(*limits.speed) + " (biotac: any)"
    )
    cut.add_argument("--no-limits", action="store_true", help="any normal force and speed")
    cut.add_argument("--longest-excursion", type=float, default=limits.longest_excursion, help="s; default %(default)s")
    cut.add_argument("--segment-seconds", type=float, default=SEGMENT_SECONDS, help="default %(default)s")
    cut.add_argument("--overlap", type=float, default=limits.overlap, help="share of a segment; default %(default)s")
    cut.add_argument(
        "--band",
        nargs=2,
        type=float,
        metavar=low_high,
        help="Hz" + both.format(*BAND_HZ) + " (biotac: {} {})".format(*BIOTAC_BAND_HZ),
    )
    cut.add_argument("--filter-order", type=int, default=4, help="Butterworth order per edge; default %(default)s")
    cut.add_argument("--filter-passes", type=int, default=2, choices=(1, 2), help="2 = zero phase; default %(default)s")

    split = parser.add_argument_group("split by surface")
    split.add_argument("--validation", type=float, help="share below 1, or number of surfaces; default 0.1")
    split.add_argument("--test", type=float, help=f"likewise; default 0.1 (biotac: {BIOTAC_TEST_SURFACES})")
    split.add_argument("--split-seed", type=int, default=0, help="default %(default)s")
    return parser


def _fill_and_check(parser, args):
    """Fills the defaults of the source and refuses what does not fit it, before any work."""
    flags = SOURCE_FLAGS[args.source]
    for source, others in SOURCE_FLAGS.items():
        for name in others:
            if name not in flags and name != "prepared" and getattr(args, name) is not None:
                parser.error(f"--{name} belongs to --source {source}, not to {args.source}.")
    for name, default in flags.items():
        if getattr(args, name) is None:
            if default is None:
                parser.error(f"--source {args.source} needs --{name}.")
            setattr(args, name, default)
    for name in ("recordings", "root"):
        path = getattr(args, name)
        if path is not None and not path.is_file():
            parser.error(f"--{name}: there is no file {path}.")
    written = [path for path in (args.output, args.prepared) if path is not None]
    for path in written:
        if not path.parent.is_dir():
            parser.error(f"the folder {path.parent} of {path.name} does not exist: create it first.")
    paths = [path.resolve() for path in (*written, args.recordings, args.root) if path is not None]
    if len(set(paths)) < len(paths):
        parser.error("the files to read and to write must differ.")
    if args.no_limits and (args.normal_force or args.speed):
        parser.error("--no-limits contradicts --normal-force and --speed: give one or the other.")


def _preparation(args):
    """Keyword arguments of `prepare_recordings`, checked as far as they can be without the data."""
    default, biotac = SegmentLimits(), args.source == "biotac"
    force, speed = default.normal_force, None if biotac else default.speed
    if args.no_limits:
        force = speed = None
    limits = SegmentLimits(
        normal_force=tuple(args.normal_force) if args.normal_force else force,
        speed=tuple(args.speed) if args.speed else speed,
        longest_excursion=args.longest_excursion,
        seconds=args.segment_seconds,
        overlap=args.overlap,
    )
    band = tuple(args.band) if args.band else BIOTAC_BAND_HZ if biotac else BAND_HZ
    if not 0 < band[0] < band[1] < DEVICE_RATE / 2:
        raise ValueError(f"--band must satisfy 0 < LOW < HIGH < {DEVICE_RATE / 2:g} Hz, got {band}.")
    test = args.test if args.test is not None else BIOTAC_TEST_SURFACES if biotac else 0.1
    validation = 0.1 if args.validation is None else args.validation
    if args.source == "virtual":
        split_surfaces(args.surfaces, validation, test, args.split_seed)
        if args.seconds < limits.seconds:
            raise ValueError(f"--seconds must be at least one segment, {limits.seconds} s, got {args.seconds}.")
    return dict(
        limits=limits,
        band=band,
        order=args.filter_order,
        passes=args.filter_passes,
        validation=validation,
        test=test,
        split_seed=args.split_seed,
        quiet=args.quiet,
    )


def _calibrate():
    path = Path(virtual.__file__).parent / virtual.CALIBRATION_FILE
    path.write_text(json.dumps(virtual.calibrate(), indent=2) + "\n")
    print(f"wrote {path}")


def _run(args, preparation):
    recordings = args.recordings
    if args.source == "virtual":
        recordings = args.output
        generate_recordings(
            recordings, args.surfaces, args.seconds, args.explorers, args.seed, args.agreement, args.quiet
        )
    elif args.source == "biotac":
        recordings = args.output
        convert_biotac(args.root, recordings, args.quiet)
        print("BioTac: sensor counts, not newtons; no normal force; 25 mm/s, below the paper's limits. Checks only.")
    if args.output is not None:
        print(f"wrote {recordings}")
    if preparation is not None:
        print(prepare_recordings(recordings, args.prepared, **preparation))
        print(f"wrote {args.prepared}")


def main(arguments=None):
    """Entry point; exits with a message, not a traceback, on bad input.

    Args:
        arguments (`list[str]`, *optional*): defaults to the command line.
    """
    parser = build_parser()
    args = parser.parse_args(arguments)
    if args.calibrate:
        return _calibrate()
    _fill_and_check(parser, args)
    try:
        _run(args, _preparation(args) if args.prepared is not None else None)
    except (ValueError, OSError) as error:
        parser.exit(2, f"{parser.prog}: error: {error}\n")


if __name__ == "__main__":
    main()
