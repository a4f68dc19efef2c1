"""From `recordings.h5` to a prepared data set: filter, cut, pool ratings, split by surface (paper section 2.1)."""

import json
from collections import Counter
from dataclasses import asdict, dataclass, field

import h5py
import numpy as np
from tqdm import tqdm

from ..signal import BAND_HZ
from .files import whole_file
from .ratings import no_ratings, pool_ratings
from .recordings import RecordingsFile
from .segments import SegmentLimits, channels, filtered_with_gaps, find_windows

PREPARED_FORMAT = "tactile-prepared"
PREPARED_VERSION = 1
SPLITS = ("train", "validation", "test")
SUBSETS = ("filtered", "full")
WINDOW_FIELDS = ("start", "friction_coefficient", "level", "speed", "turnarounds")


@dataclass
class PreparationReport:
    """What preparation did.

    Attributes:
        segments (`dict`): subset -> split -> number of segments.
        surfaces (`dict`): split -> number of surfaces.
        seconds (`dict`): subset -> reason -> seconds of recording.
        notes (`list[str]`): limits skipped, raters left out, signs turned, recordings with gaps.
    """

    segments: dict
    surfaces: dict
    seconds: dict
    notes: list = field(default_factory=list)

    def __str__(self):
        lines = [f"surfaces: {_listed(self.surfaces)}"]
        for subset in SUBSETS:
            lines.append(f"{subset} segments: {_listed(self.segments[subset])}")
            lines.append(f"  seconds: {_listed({k: round(v, 1) for k, v in self.seconds[subset].items()})}")
        return "\n".join(lines + [f"note: {note}" for note in self.notes])


def _listed(counts):
    return ", ".join(f"{name} {count}" for name, count in counts.items())


def split_surfaces(surfaces, validation=0.1, test=0.1, seed=0):
    """Splits surfaces, never segments, into training, validation and test.

    Args:
        surfaces (`int`): how many.
        validation, test (`float` or `int`): a share below 1 (at least one surface if above 0), or a number of surfaces.
        seed (`int`): of the draw.

    Returns:
        `np.ndarray`: (surfaces,) int64 index into `SPLITS`.

    Raises:
        ValueError: if an argument is out of range or no surface is left for training.
    """
    counts = []
    for name, size in (("validation", validation), ("test", test)):
        if not (0 <= size < 1 or (size >= 1 and size == int(size))):
            raise ValueError(f"`{name}` must be a share below 1 or a whole number of surfaces, got {size}.")
        counts.append(int(size) if size >= 1 or size == 0 else max(1, round(size * surfaces)))
    if sum(counts) >= surfaces:
        raise ValueError(
            f"`validation` ({counts[0]}) and `test` ({counts[1]}) leave none of {surfaces} surfaces for "
            "training: lower them."
        )
    order = np.random.default_rng(seed).permutation(surfaces)
    split = np.zeros(surfaces, dtype=np.int64)
    split[order[: counts[0]]] = SPLITS.index("validation")
    split[order[counts[0] : sum(counts)]] = SPLITS.index("test")
    return split


def prepare_recordings(
    recordings,
    prepared,
    limits=None,
    band=BAND_HZ,
    order=4,
    passes=2,
    validation=0.1,
    test=0.1,
    split_seed=0,
    quiet=False,
):
    """Prepares a data set; the file appears only when it is whole.

    Two sets of windows are indexed: "filtered" meets `limits`, "full" is cut without limits of force and speed.

    Args:
        recordings (`str` or `Path`): `recordings.h5`.
        prepared (`str` or `Path`): the file to write.
        limits (`SegmentLimits`, *optional*): defaults to the paper's.
        band, order, passes: of `signal.band_pass`.
        validation, test, split_seed: of `split_surfaces`.
        quiet (`bool`): no progress bar.

    Returns:
        `PreparationReport`.

    Raises:
        FileNotFoundError: if `recordings` does not exist.
        ValueError: if `recordings` is invalid, an argument is out of range, or no segment meets the limits.
    """
    limits = limits or SegmentLimits()
    with RecordingsFile(recordings) as source:
        split = split_surfaces(len(source.surfaces), validation, test, split_seed)
        rate = _common_rate(source, band, order, passes)
        ratings, notes = _pooled(source, split)
        offsets = np.concatenate([[0], np.cumsum(source.lengths)])
        index = _Index(rate, limits)
        with whole_file(prepared) as file:
            lateral = file.create_dataset("lateral", (offsets[-1],), np.float32)
            bar = tqdm(source, total=len(source), desc="preparing", unit="recording", disable=quiet)
            for number, recording in enumerate(bar):
                data = channels(recording)
                filtered, valid = filtered_with_gaps(data.lateral, rate, band, order, passes)
                lateral[offsets[number] : offsets[number + 1]] = filtered
                index.add(number, recording.name, data, filtered, valid)
            surface_index = np.array([source.surfaces.index(name.split("/")[0]) for name in source.names])
            columns = index.columns()
            report = _report(columns, surface_index, split, index.seconds, notes + index.notes())
            if not len(columns["filtered"]["start"]):
                raise ValueError(f"{recordings}: no segment meets the limits {limits}. Widen or drop them.\n{report}")
            _write(file, source, split, ratings, columns, offsets, surface_index)
            file.attrs.update(
                format=PREPARED_FORMAT,
                version=PREPARED_VERSION,
                sampling_rate=rate,
                segment_samples=limits.samples(rate),
                band=band,
                filter_order=order,
                filter_passes=passes,
                unit=source.unit,
                limits=json.dumps(asdict(limits)),
                split_seed=split_seed,
                report=str(report),
            )
    return report


class _Index:
    """Collects the windows of all recordings, for both subsets."""

    def __init__(self, rate, limits):
        self.rate = rate
        self.limits = dict(zip(SUBSETS, (limits, limits.without_conditions()), strict=True))
        self.seconds = {subset: Counter() for subset in SUBSETS}
        self._parts = {subset: {name: [] for name in ("recording", *WINDOW_FIELDS)} for subset in SUBSETS}
        self._names = {}

    def add(self, number, name, data, filtered, valid):
        for subset, limits in self.limits.items():
            windows = find_windows(data, filtered, valid, self.rate, limits)
            self.seconds[subset].update(windows.seconds)
            self._parts[subset]["recording"].append(np.full(len(windows.start), number))
            for field_name in WINDOW_FIELDS:
                self._parts[subset][field_name].append(getattr(windows, field_name))
            for note in _recording_notes(data, windows):
                self._names.setdefault(note, {})[name] = True  # a set in order

    def columns(self):
        return {s: {name: np.concatenate(parts) for name, parts in c.items()} for s, c in self._parts.items()}

    def notes(self):
        return [f"{note}, in {len(names)} recordings, first {next(iter(names))}" for note, names in self._names.items()]


def _common_rate(source, band, order, passes):
    rates = {source.rate(name) for name in source.names}
    if len(rates) > 1:
        raise ValueError(f"{source.path}: recordings have rates {sorted(rates)} Hz. Resample them to one rate first.")
    rate = rates.pop()
    if not 0 < band[0] < band[1] < rate / 2:
        raise ValueError(f"`band` must satisfy 0 < low < high < {rate / 2} Hz for {source.path}, got {tuple(band)}.")
    if order < 1 or passes not in (1, 2):
        raise ValueError(f"`order` must be at least 1 and `passes` 1 or 2, got {order} and {passes}.")
    return rate


def _pooled(source, split):
    if source.ratings is None:
        return no_ratings(len(split)), ["the source has no ratings: they are NaN"]
    ratings = pool_ratings(source.ratings, source.surfaces, split == SPLITS.index("train"))
    return ratings, [f"rater left out: {item}" for item in ratings.left_out]


def _recording_notes(data, windows):
    notes = [f"no channel for the limits of {name}: skipped" for name in windows.skipped]
    if data.normal is None:
        notes.append("no normal force: the friction coefficient is NaN")
    if data.flipped:
        notes.append("the force is the surface's on the finger: its sign was turned")
    if windows.seconds["missing (NaN)"]:
        notes.append("missing samples (NaN) excluded")
    return notes


def _report(columns, surface_index, split, seconds, notes):
    segments = {}
    for subset in SUBSETS:
        window_split = split[surface_index[columns[subset]["recording"]]]
        segments[subset] = {name: int(np.sum(window_split == i)) for i, name in enumerate(SPLITS)}
    surfaces = {name: int(np.sum(split == i)) for i, name in enumerate(SPLITS)}
    return PreparationReport(segments, surfaces, {s: dict(c) for s, c in seconds.items()}, notes)


def _write(file, source, split, ratings, columns, offsets, surface_index):
    text = h5py.string_dtype()
    file.attrs.update({key: value for key, value in source.attributes.items() if key not in ("format", "version")})
    file.create_dataset("surfaces/name", data=list(source.surfaces), dtype=text)
    file.create_dataset("surfaces/split", data=split)
    file.create_dataset("recordings/name", data=source.names, dtype=text)
    file.create_dataset("recordings/offset", data=offsets)
    file.create_dataset("recordings/surface", data=surface_index)
    for name in ("mean", "std", "count", "raw_mean", "raw_scale"):
        file.create_dataset(f"ratings/{name}", data=getattr(ratings, name))
    for subset, fields in columns.items():
        for name, values in fields.items():
            whole = name in ("recording", "start", "turnarounds")
            file.create_dataset(f"windows/{subset}/{name}", data=values.astype(np.int64 if whole else np.float32))
