"""Command line: make or convert recordings and prepare a data set from them."""

import json
from pathlib import Path

from .. import virtual
from ..data import HoldOut, SegmentLimits, prepare_recordings, split_surfaces
from ..data.folder import convert_folder, draft_layout, export_folder, inspect_folder
from ..data.sens3 import convert_sens3
from ..io.files import write_text
from ..signal import BAND_HZ, DEVICE_RATE
from ..virtual import generate_recordings
from .prepare_data_args import SOURCE_FLAGS, build_parser, check, check_alone, check_export


def _preparation(args):
    """Keyword arguments of `prepare_recordings`, checked as far as they can be without the data."""
    default = SegmentLimits()
    force, speed = default.normal_force, default.speed
    if args.no_limits:
        force = speed = None
    limits = SegmentLimits(
        normal_force=tuple(args.normal_force) if args.normal_force else force,
        speed=tuple(args.speed) if args.speed else speed,
        longest_excursion=args.longest_excursion,
        seconds=args.segment_seconds,
        overlap=args.overlap,
    )
    band = tuple(args.band) if args.band else BAND_HZ
    if not 0 < band[0] < band[1] < DEVICE_RATE / 2:
        raise ValueError(f"--band must satisfy 0 < LOW < HIGH < {DEVICE_RATE / 2:g} Hz, got {band}.")
    test = args.test if args.test is not None else 0.1
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
        turnarounds=args.turnarounds,
        hold_out=_hold_out(args),
        quiet=args.quiet,
    )


def _hold_out(args):
    """What is held out; of a virtual collection the names are known before it is made, so they are checked."""
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


def _calibrate():
    path = Path(virtual.__file__).parent / virtual.CALIBRATION_FILE
    write_text(path, json.dumps(virtual.calibrate(), indent=2) + "\n")
    print(f"wrote {path}")


def _inspect(args):
    if args.draft is not None and args.draft.exists():
        raise ValueError(f"--draft {args.draft} exists: give another name, a layout may hold work of yours.")
    inventory = inspect_folder(args.inspect, quiet=args.quiet)
    print(inventory)
    if not inventory.groups:
        raise ValueError(f"--inspect {args.inspect}: there is no file that can be read as a table, so no draft of it.")
    if args.draft is None:
        return print("\n--draft layout.toml writes a layout of this folder.")
    write_text(args.draft, draft_layout(inventory))
    print(f"\nwrote {args.draft}: fill in every TODO, then --source folder --root {args.inspect} --layout {args.draft}")


def _export(args):
    export_folder(args.recordings, args.export_folder, args.export_kind or "csv", quiet=args.quiet)
    print(f"wrote {args.export_folder}")


def _recordings(args):
    """Makes or converts recordings; returns the file."""
    if args.source == "virtual":
        settings = {name: getattr(args, name) for name in SOURCE_FLAGS["virtual"] if name != "output"}
        generate_recordings(args.output, quiet=args.quiet, **settings)
    elif args.source in ("sens3", "folder"):
        convert = convert_sens3 if args.source == "sens3" else convert_folder
        _told(convert(args.root, args.layout, args.output, quiet=args.quiet), args.output)
        return args.output
    else:
        return args.recordings
    print(f"wrote {args.output}")
    return args.output


def _told(report, written):
    """Prints a report, and how many of its lines are to be read: they scroll away."""
    text = str(report)
    notes = sum(line.startswith("note: ") for line in text.splitlines())
    print(f"{text}\nwrote {written}" + (f"; {notes} note{'s' * (notes > 1)} above: read them first" if notes else ""))


def _run(parser, args):
    check_alone(parser, args)
    if args.calibrate:
        return _calibrate()
    if args.inspect is not None:
        return _inspect(args)
    if args.export_folder is not None:
        check_export(parser, args)
        return _export(args)
    check(parser, args)
    preparation = _preparation(args) if args.prepared is not None else None
    recordings = _recordings(args)
    if preparation is not None:
        _told(prepare_recordings(recordings, args.prepared, **preparation), args.prepared)


def main(arguments=None):
    """Entry point; exits with a message, not a traceback, on bad input.

    Args:
        arguments (`list[str]`, *optional*): defaults to the command line.
    """
    parser = build_parser()
    args = parser.parse_args(arguments)
    try:
        _run(parser, args)
    except (ValueError, OSError) as error:
        parser.exit(2, f"{parser.prog}: error: {error}\n")


if __name__ == "__main__":
    main()
