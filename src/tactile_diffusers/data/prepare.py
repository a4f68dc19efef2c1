"""From `recordings.h5` to a prepared data set: filter, cut, pool ratings, split by surface (paper section 2.1)."""

import json
import os
from collections import Counter
from dataclasses import asdict, dataclass, field, replace

import numpy as np
from tqdm import tqdm

from ..io.files import clear_left_behind
from ..io.hdf5 import whole_file
from ..signal import BAND_HZ
from ..signal.masks import true_runs
from .prepared_file import PREPARED_FORMAT, PREPARED_VERSION, SUBSETS, LateralWriter, write_group
from .projection import FORCE_GAP, MOTION_GAP, SLOWEST_DIRECTION, channels, filtered_with_gaps
from .ratings import RatingReliability, no_ratings, pool_ratings
from .recordings import RecordingsFile
from .segments import REASONS, SegmentLimits, SegmentTable, find_windows
from .splits import SPLITS, assign_splits
from .turnarounds import DEFAULT_TURNAROUNDS, check_turnarounds

#: A median this many times beyond a limit looks like a wrong unit (recipe).
FAR_OFF = 5.0
#: Friction points against the motion; a larger share of the moving time with it is a mistake. Measured: 0 on virtual
#: recordings and a lab's, 0.14 on the lab's with clocks 0.3 s apart (recipe).
MOST_ALONG = 0.1
_QUANTITIES = {"normal_force": ("normal force", "N"), "speed": ("speed", "mm/s")}


@dataclass
class PreparationReport:
    """What preparation kept, and why it dropped the rest.

    Attributes:
        segments (`dict`): subset -> split -> number of segments.
        surfaces (`dict`): split -> number of surfaces.
        seconds (`dict`): subset -> reason -> seconds of recording, all of `REASONS`.
        notes (`list[str]`): limits skipped, raters left out, signs turned, recordings with gaps or suspicious forces.
        reliability (`RatingReliability` or `None`): how far the raters of the ordinary splits agree.
    """

    segments: dict
    surfaces: dict
    seconds: dict
    notes: list = field(default_factory=list)
    reliability: RatingReliability | None = None

    def __str__(self):
        def listed(counts):
            return ", ".join(f"{name} {count}" for name, count in counts.items())

        lines = [f"surfaces: {listed(self.surfaces)}"]
        for subset in SUBSETS:
            lines.append(f"{subset} segments: {listed(self.segments[subset])}")
            seconds = {reason: round(value, 1) for reason, value in self.seconds[subset].items() if value}
            lines.append(f"  seconds: {listed(seconds)}".replace("normal_force", "normal force"))
        if self.reliability is not None:
            lines.append(str(self.reliability))
        return "\n".join(lines + [f"note: {note}" for note in self.notes])


def prepare_recordings(
    recordings,
    prepared,
    limits=None,
    band=BAND_HZ,
    validation=0.1,
    test=0.1,
    split_seed=0,
    quiet=False,
    turnarounds=DEFAULT_TURNAROUNDS,
    hold_out=None,
):
    """Prepares a data set; the file appears only when it is whole.

    Two sets of windows are indexed: "filtered" meets `limits`, "full" is cut without limits of force and speed. One
    recording is in memory at a time.

    Args:
        recordings (`str` or `Path`): `recordings.h5`.
        prepared (`str` or `Path`): the file to write.
        limits (`SegmentLimits`, *optional*): defaults to the paper's.
        band: of `signal.band_pass`.
        validation, test, split_seed: of `split_surfaces`, among the surfaces that are not held out.
        quiet (`bool`): no progress bar.
        turnarounds (`str`): "keep" (the paper) or "mask"; see `treat_turnarounds`.
        hold_out (`HoldOut`, *optional*): surfaces, explorers and raters of the split "hard".

    Returns:
        `PreparationReport`.

    Raises:
        FileNotFoundError: if `recordings` does not exist.
        ValueError: if `recordings` is invalid, an argument is out of range, or no segment meets the limits.
    """
    limits = limits or SegmentLimits()
    check_turnarounds(turnarounds)
    if os.path.realpath(recordings) == os.path.realpath(prepared):
        raise ValueError(f"`prepared` is `recordings`, {recordings}, and would replace it: give another file.")
    with RecordingsFile(recordings) as source:
        rate = _common_rate(source, band)
        splits = assign_splits(source.names, source.surfaces, validation, test, split_seed, hold_out)
        ratings, notes = _pool(source, splits, hold_out)
        index = _Index(rate, limits, len(source))
        clear_left_behind(prepared)
        with whole_file(prepared) as file:
            lateral = LateralWriter(file, source.lengths, rate, band)
            bar = tqdm(source, total=len(source), desc="preparing", unit="recording", disable=quiet)
            for number, recording in enumerate(bar):
                data = channels(recording, turnarounds)
                filtered, valid = filtered_with_gaps(data.lateral, rate, band)
                lateral.add(number, filtered)
                index.add(number, recording, data, filtered, valid)
            tables = index.tables()
            wanted = {"validation": validation, "test": test}
            report = _report(tables, splits, index, notes, ratings["ratings"].reliability, wanted)
            if not any(report.segments["filtered"].values()):
                raise ValueError(
                    f"{recordings}: no segment meets the limits.\n{report}\n"
                    f"What was measured, beside the limits; widen or drop what does not fit:\n{index.measured}"
                )
            _write_index(file, source, splits, ratings, tables, index.seconds)
            file.attrs.update(
                format=PREPARED_FORMAT,
                version=PREPARED_VERSION,
                sampling_rate=rate,
                segment_samples=limits.samples(rate),
                band=band,
                turnarounds=turnarounds,
                unit=source.unit,
                limits=json.dumps(asdict(limits)),
                split_seed=split_seed,
                hold_out=json.dumps(asdict(hold_out) if hold_out else None),
                report=str(report),
            )
    return report


def _write_index(file, source, splits, ratings, tables, seconds):
    file.attrs.update({key: value for key, value in source.attributes.items() if key not in ("format", "version")})
    write_group(file, "surfaces", {"name": source.surfaces, "split": splits.surfaces})
    recordings = {name: getattr(splits, name) for name in ("owners", "withheld", "hard")}
    write_group(file, "recordings", {"name": source.names, **recordings})
    for name, pooled in ratings.items():
        write_group(file, name, asdict(pooled))
    for subset, table in tables.items():
        write_group(file, f"segments/{subset}", table.columns)
    write_group(file, "seconds", {"reasons": REASONS, **seconds})


class _Index:
    """Collects the segments, seconds by reason and notes of all recordings."""

    def __init__(self, rate, limits, recordings):
        self.rate = rate
        self.limits = dict(zip(SUBSETS, (limits, limits.without_conditions()), strict=True))
        self.seconds = {subset: np.zeros((recordings, len(REASONS))) for subset in SUBSETS}
        self.measured = Measured(limits, rate)
        self._parts = {subset: [] for subset in SUBSETS}
        self._names = {}
        self._lost, self._bridged, self._along = Counter(), np.zeros(2, dtype=int), (0.0, "")

    def add(self, number, recording, data, filtered, valid):
        for subset, limits in self.limits.items():
            windows = find_windows(data, filtered, valid, self.rate, limits, number)
            if subset == SUBSETS[0]:
                self.measured.add(data, windows.usable)
                self._lost.update(windows.lost)
                self._bridged += data.bridged
                if recording.force is not None:
                    fast = data.speed > (limits.speed or (SLOWEST_DIRECTION,))[0]
                    share = np.count_nonzero(fast & (data.lateral < 0)) / max(np.count_nonzero(fast), 1)
                    self._along = max(self._along, (share, recording.name))
            self.seconds[subset][number] = [windows.seconds[reason] for reason in REASONS]
            self._parts[subset].append(windows.columns)
            for note in (*recording.notes, *_recording_notes(data, windows)):
                # the part in brackets at the end differs between recordings
                what, place = note.rsplit(" (", 1) if note.endswith(")") else (note, "")
                self._names.setdefault(what, {}).setdefault(recording.name, place and f" ({place}")

    def tables(self):
        return {
            subset: SegmentTable(**{name: np.concatenate([part[name] for part in parts]) for name in parts[0]})
            for subset, parts in self._parts.items()
        }

    def notes(self):
        firsts = {note: next(iter(names.items())) for note, names in self._names.items()}
        notes = [f"{note}, in {len(self._names[note])} recordings, first {''.join(at)}" for note, at in firsts.items()]
        if self._bridged.any():
            gaps = f"{FORCE_GAP:g} s in the force ({self._bridged[0]} samples), {MOTION_GAP:g} s in the motion"
            notes.append(f"bridged by straight lines: gaps of up to {gaps} ({self._bridged[1]} samples)")
        if self._along[0] > MOST_ALONG:
            what = "the lateral force points with the motion in {:.0%} of the time (in {}, the worst)"
            notes.append(what.format(*self._along) + ": is `offset`, a sign or an axis wrong?")
        used, lost = self.seconds[SUBSETS[0]][:, REASONS.index("used")].sum(), sum(self._lost.values())
        if used < lost:
            cause, seconds = self._lost.most_common(1)[0]
            little = f"WARNING: only {used:.0f} of {used + lost:.0f} s within the limits of force and speed are used"
            notes.append(f"{little}. Largest cause: {cause}: {seconds:.0f} s. Mend the files, or record longer runs")
        return notes


def _common_rate(source, band):
    rates = {source.rate(name) for name in source.names}
    if len(rates) > 1:
        raise ValueError(
            f"{source.path}: recordings have rates {sorted(rates)} Hz. Resample them to one rate first: `resample` in "
            "a layout does."
        )
    rate = rates.pop()
    if not 0 < band[0] < band[1] < rate / 2:
        raise ValueError(f"`band` must satisfy 0 < low < high < {rate / 2} Hz for {source.path}, got {tuple(band)}.")
    return rate


def _pool(source, splits, hold_out):
    """{group of the file: `SurfaceRatings`}, and notes; held-out raters are pooled apart, for the hard split."""
    scores, training = source.ratings, splits.surfaces == SPLITS.index("train")
    held = hold_out is not None and hold_out.raters
    if scores is None:
        if held:
            raise ValueError(f"`hold_out.raters`: {source.path} has no ratings. Leave them out.")
        return {"ratings": no_ratings(len(source.surfaces))}, ["the source has no ratings: they are NaN"]
    unseen = hold_out.matches("raters", scores.raters) if held else np.zeros(len(scores.raters), dtype=bool)
    pooled = {}
    for name, chosen in (("ratings", ~unseen), ("ratings_hard", unseen)):
        if chosen.any():
            raters = tuple(np.array(scores.raters)[chosen].tolist())
            of_these = replace(scores, values=scores.values[chosen], raters=raters)
            pooled[name] = pool_ratings(of_these, source.surfaces, training)
    return pooled, [f"rater left out: {item}" for ratings in pooled.values() for item in ratings.left_out]


def _recording_notes(data, windows):
    notes = [f"no channel for the limits of {name}: skipped" for name in windows.skipped]
    if data.normal is None:
        notes.append("no normal force in N: the friction coefficient is NaN")
    if data.flipped:
        notes.append("the force is the surface's on the finger, or along a fixed axis: its sign was turned")
    if windows.seconds["missing (NaN)"]:
        notes.append("missing samples (NaN) excluded")
    if windows.seconds["saturated"]:
        notes.append(f"saturated samples excluded (the first is {int(np.argmax(data.saturated))})")
    return notes


def _report(tables, splits, index, notes, reliability, wanted):
    """The report; notes say which of the `wanted` splits have too few surfaces for an evaluation."""
    shown = [name for name in SPLITS if name != "hard" or splits.hard.any()]
    owners = {name: splits.owners[splits.members(name)] for name in shown}
    of_segments = {
        subset: {name: table.recording[splits.members(name)[table.recording]] for name in shown}
        for subset, table in tables.items()
    }
    segments = {subset: {name: len(rows) for name, rows in found.items()} for subset, found in of_segments.items()}
    seconds = {s: dict(zip(REASONS, map(float, total.sum(axis=0)), strict=True)) for s, total in index.seconds.items()}
    notes = notes + index.notes()
    counts = {name: len(np.unique(splits.owners[of_segments["filtered"][name]])) for name in wanted if wanted[name]}
    few = [f"{count} {name} surface{'s' * (count != 1)}" for name, count in counts.items() if count < 2]
    if few and any(segments["filtered"].values()):
        which = " and ".join(few)
        notes.append(f"{which} with segments: evaluation needs 2 of each; prepare with --test 2 --validation 2")
    surfaces = {name: len(np.unique(found)) for name, found in owners.items()}
    return PreparationReport(segments, surfaces, seconds, notes, reliability)


class Measured:
    """Collects, recording by recording, what the `SegmentLimits` are compared with; rates in Hz."""

    def __init__(self, limits, rate):
        self.limits, self.rate = limits, rate
        self._medians, self._runs, self._gaps = {name: [] for name in _QUANTITIES}, [], []

    def add(self, data, usable):
        """Adds one recording: its `Channels`, and the samples that a segment may hold, (n,) bool."""
        for name, values in (("normal_force", data.normal), ("speed", data.speed)):
            if values is not None and not np.isnan(values).all():
                self._medians[name].append(float(np.nanmedian(values)))
        runs = true_runs(usable) / self.rate
        self._runs.extend(runs[:, 1] - runs[:, 0])
        self._gaps.extend(runs[1:, 0] - runs[:-1, 1])

    def __str__(self):
        lines = [self._compare(name, float(np.median(found))) for name, found in self._medians.items() if found]
        runs = f"median {np.median(self._runs):.2g} s, longest {max(self._runs):.2g} s" if self._runs else "none"
        needed = f"a segment lasts {self.limits.seconds:.2f} s (--segment-seconds)"
        lines.append(f"  runs within the limits: {runs}; {needed}")
        if self._gaps:
            bridged = f"up to {self.limits.longest_excursion:g} s outside the limits are bridged (--longest-excursion)"
            lines.append(f"  between two runs: median {np.median(self._gaps):.2g} s; {bridged}")
        return "\n".join(lines)

    def _compare(self, name, median):
        (what, unit), bounds = _QUANTITIES[name], getattr(self.limits, name)
        if bounds is None:
            return f"  {what}: median {median:.3g} {unit}, no limits"
        far = not bounds[0] / FAR_OFF <= median <= bounds[1] * FAR_OFF
        return (
            f"  {what}: median {median:.3g} {unit}, limits {bounds[0]:g} to {bounds[1]:g} {unit}"
            f"{': is the unit right?' if far else ''} (--{name.replace('_', '-')} LOW HIGH, or --no-limits)"
        )
