"""`PreparedDataset`: textures, levels, friction coefficients and ratings by index."""

import json

import numpy as np
import torch

from ..io.hdf5 import check_sizes, open_whole
from ..io.reading import reading
from ..signal import RATING_AXES
from .prepared_file import PREPARED_FORMAT, PREPARED_VERSION, SUBSETS, LateralReader, read_group
from .ratings import SurfaceRatings
from .segments import SegmentTable
from .splits import SPLITS, Splits


class PreparedDataset(torch.utils.data.Dataset):
    """A view of a prepared data set: one split, one subset, one sampling rate.

    At the native rate and at 2.5 kHz textures are read from the file by index. At another rate the whole recordings of
    this view are resampled once, before cropping, and kept in memory as float32.

    Args:
        path (`str` or `Path`): a file from `prepare_recordings`.
        split (`str`): "train", "validation" or "test", by surface; "all" of these; or "hard", the segments that
            `HoldOut` keeps apart. These are not part of "all", because their ratings may be of other raters.
        subset (`str`): "filtered" (within the limits of force and speed) or "full".
        sampling_rate (`int`, *optional*): Hz; defaults to the native rate.
        max_samples (`int`, *optional*): keep at most so many segments, evenly spread over the view.
        max_surfaces (`int`, *optional*): keep at most so many surfaces, evenly spread over the view.

    Attributes:
        path, split, subset, sampling_rate: the arguments.
        segment_samples (`int`): samples of a segment at `sampling_rate`.
        attributes (`dict`): what the source and the preparation stored about the file, as plain numbers, strings,
            lists and dicts: "source", "licence", "limits", "turnarounds"; virtual data also "seed".
        source (`str`): where the recordings come from.
        unit (`str`): of textures, "N", or "1" if uncalibrated.
        band (`tuple[float, float]`): edges of the band-pass, Hz.
        surfaces (`tuple[str, ...]`): names of all surfaces of the file; `surface_ids` index them.
        splits (`tuple[str, ...]`): the split of each surface of the file; "hard" = held out.
        recordings (`tuple[str, ...]`): names of all recordings of the file, "surface/explorer/trial".
        explorers (`int`): how many in the whole file.
        ratings (`SurfaceRatings`): of all surfaces of the file: mean, std and count over raters, the z-scores of single
            raters, and their reliability, on the axes of `RATING_AXES` or those of `set_axes`. If raters are held out,
            of these in the split "hard", of the others elsewhere.
        rating_axes (`tuple[str, ...]`): all axes that the raters were asked about.
        segments (`SegmentTable`): one row a segment of this view. Its columns, and what follows from them, (len,):
        recording_ids, surface_ids (`np.ndarray`): int64, of each segment.
        starts (`np.ndarray`): int64, first sample of each within its recording, at this view's rate.
        friction_coefficients, levels, speeds (`np.ndarray`): float32; levels are log RMS, speeds means in mm/s; NaN =
            unknown.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: if the file is not a prepared data set, an argument is unknown, or the view is empty.
    """

    def __init__(self, path, split="train", subset="filtered", sampling_rate=None, max_samples=None, max_surfaces=None):
        if split not in (*SPLITS, "all"):
            raise ValueError(f"`split` must be one of {(*SPLITS, 'all')}, got {split!r}.")
        if subset not in SUBSETS:
            raise ValueError(f"`subset` must be one of {SUBSETS}, got {subset!r}.")
        for name, value in (("max_samples", max_samples), ("max_surfaces", max_surfaces)):
            if value is not None and value < 1:
                raise ValueError(f"`{name}` must be at least 1 or None, got {value}.")
        self.path, self.split, self.subset = str(path), split, subset
        with open_whole(path) as file:
            with self._reading():
                self._read_attributes(file)
                check_sizes(file)
            self._set_rate(sampling_rate)
            with self._reading():
                self._read_surfaces(file)
                self._read_segments(file, max_samples, max_surfaces)
                self._lateral = LateralReader(file, self.sampling_rate, self.recording_ids)
                places = self._places(slice(None))  # resampling rounds both ends of a segment
                if places.min() < 0 or places.max() + self.segment_samples > len(self._lateral) + 1:
                    raise ValueError(
                        f"{self.path} is damaged: segments lie outside of its recordings. Prepare it again."
                    )

    def _reading(self):
        return reading(self.path, "a prepared data set", "Copy it again, or prepare the data again.")

    def _read_attributes(self, file):
        attributes = {k: v.tolist() if hasattr(v, "tolist") else v for k, v in file.attrs.items()}
        form, version = attributes.get("format"), attributes.get("version")
        if form != PREPARED_FORMAT or version != PREPARED_VERSION:
            raise ValueError(
                f"{self.path} is not a prepared data set of version {PREPARED_VERSION} (format={form!r}, "
                f"version={version}): write one with examples/prepare_data.py."
            )
        for name in ("limits", "hold_out"):
            attributes[name] = json.loads(attributes[name])
        for name in ("turnarounds", "report"):
            attributes[name]  # a missing one is refused here, not in the last line of a card
        self.attributes = attributes
        self.source, self.unit = str(attributes["source"]), str(attributes["unit"])
        self.band = low, high = tuple(map(float, attributes["band"]))
        if not (0 < low < high < int(attributes["sampling_rate"]) / 2 and int(attributes["segment_samples"]) > 0):
            raise ValueError(f"its band of {low:g}-{high:g} Hz or its segments are impossible")

    def _set_rate(self, sampling_rate):
        native = int(self.attributes["sampling_rate"])
        rate = native if sampling_rate is None else sampling_rate
        if int(rate) != rate or rate / 2 <= self.band[1]:
            raise ValueError(
                f"`sampling_rate` must be a whole number of Hz above {2 * self.band[1]:g}, twice the band's upper "
                f"edge, got {rate}."
            )
        self.sampling_rate = int(rate)
        self.segment_samples = int(round(self.attributes["segment_samples"] * rate / native))

    def _read_surfaces(self, file):
        surfaces, recordings = read_group(file["surfaces"]), read_group(file["recordings"])
        self.surfaces, self.recordings = surfaces["name"], recordings.pop("name")
        self.explorers = len({name.split("/")[1] for name in self.recordings})
        self._splits = Splits(surfaces["split"], **recordings)
        self.splits = tuple(SPLITS[number] for number in surfaces["split"])
        group = "ratings_hard" if self.split == "hard" and "ratings_hard" in file else "ratings"
        self.ratings = self._all_ratings = ratings = SurfaceRatings.from_dict(read_group(file[group]))
        self.rating_axes = ratings.axes
        for values in (ratings.mean, ratings.std, ratings.count):
            if np.shape(values) != (len(self.surfaces), len(self.rating_axes)) or np.isinf(values).any():
                raise ValueError("ratings are not those of its surfaces")
        self.set_axes(RATING_AXES)

    def set_axes(self, axes=None):
        """Chooses the axes of `ratings` and their order; `None` = all that there are. Returns the view itself."""
        axes = self.rating_axes if axes is None else tuple(axes)
        if self.ratings.axes != axes:
            self.ratings = self._all_ratings.take(axes)
        return self

    def _read_segments(self, file, max_samples, max_surfaces):
        table = SegmentTable(**read_group(file[f"segments/{self.subset}"]))
        chosen = np.flatnonzero(self._splits.members(self.split)[table.recording])
        if not len(chosen):
            raise ValueError(f"{self.path} has no {self.subset} segment in the split {self.split!r}: see its report.")
        surfaces = self._splits.owners[table.recording]
        if max_surfaces is not None:
            chosen = chosen[np.isin(surfaces[chosen], _spread(np.unique(surfaces[chosen]), max_surfaces))]
        if max_samples is not None:
            chosen = _spread(chosen, max_samples)
        self.segments = table = table.rows(chosen)
        self.recording_ids, self.surface_ids = table.recording, self._splits.owners[table.recording]
        self.friction_coefficients, self.levels, self.speeds = table.friction_coefficient, table.level, table.speed
        ratio = self.sampling_rate / int(self.attributes["sampling_rate"])
        self.starts = np.round(table.start * ratio).astype(np.int64)

    def _places(self, indices):
        return self._lateral.begin[self.recording_ids[indices]] + self.starts[indices]

    def __len__(self):
        return len(self.segments.start)

    def textures(self, indices):
        """Textures by index: (n, segment_samples) float32, in `unit`."""
        return self._lateral.read(self._places(np.atleast_1d(np.asarray(indices, np.int64))), self.segment_samples)

    def seconds_by_reason(self):
        """Where the time of every recording of the file went: a `pandas.DataFrame`, recordings by `REASONS`, s.

        Segments are cut from what is "used"; the other columns are reasons why time was dropped.
        """
        import pandas

        with open_whole(self.path) as file, self._reading():
            stored = read_group(file["seconds"])
            seconds, reasons = np.asarray(stored[self.subset]), list(stored["reasons"])
            if seconds.shape != (len(self.recordings), len(reasons)) or not np.isfinite(seconds).all():
                raise ValueError("the seconds by reason are not a number for each recording")
            return pandas.DataFrame(seconds, index=list(self.recordings), columns=reasons)

    def non_overlapping(self, per_surface, seed=0):
        """Indices of segments that share no sample, drawn at random over recordings (explorers), in ascending order.

        Args:
            per_surface (`int`): at most so many segments of each surface.
            seed (`int`): of the choice.

        Returns:
            `np.ndarray`: (n,) int64.
        """
        chosen, taken, table = [], {}, self.segments
        length = int(self.attributes["segment_samples"])
        for index in np.random.default_rng(seed).permutation(len(self)):
            rows = taken.setdefault(int(self.surface_ids[index]), [])
            recording, start = table.recording[index], table.start[index]
            free = all(other != recording or abs(place - start) >= length for other, place in rows)
            if free and len(rows) < per_surface:
                rows.append((recording, start))
                chosen.append(index)
        return np.sort(np.asarray(chosen, dtype=np.int64))

    def __getitem__(self, index):
        """One segment.

        Returns:
            `dict[str, torch.Tensor]`: "texture" (segment_samples,) in `unit`; scalars "friction_coefficient", "level"
            (log RMS) and "reference_speed" (mm/s), NaN = unknown; "ratings", "ratings_std" and "ratings_count" (3,),
            all float32; "surface" and "index" int64.
        """
        if not -len(self) <= index < len(self):
            raise IndexError(f"index {index} is outside a data set of {len(self)} segments")
        index = int(index) % len(self)
        surface = int(self.surface_ids[index])
        return {
            "texture": torch.from_numpy(self.textures(index)[0]),
            "friction_coefficient": torch.tensor(self.friction_coefficients[index]),
            "level": torch.tensor(self.levels[index]),
            "ratings": torch.tensor(self.ratings.mean[surface]),
            "ratings_std": torch.tensor(self.ratings.std[surface]),
            "ratings_count": torch.tensor(self.ratings.count[surface]),
            "reference_speed": torch.tensor(self.speeds[index]),
            "surface": torch.tensor(surface),
            "index": torch.tensor(index),
        }


def _spread(values, most):
    """At most so many of `values`, evenly spread."""
    if most >= len(values):
        return values
    return values[np.linspace(0, len(values) - 1, most).round().astype(np.int64)]


def check_fit(pipe, dataset, name="checkpoint"):
    """A ValueError if bands, rates or lengths of checkpoint and data differ; `name` is the checkpoint's in it."""
    extractor = pipe.feature_extractor
    band = tuple(float(edge) for edge in extractor.band)
    if band != tuple(dataset.band):
        raise ValueError(
            f"The {name}'s band is {band} Hz, `data` was prepared with {tuple(dataset.band)} Hz. Prepare the data "
            f"again with the {name}'s band (`--band` of examples/prepare_data.py), or train on this data."
        )
    if dataset.sampling_rate > extractor.delivery_rate:
        raise ValueError(
            f"`data` has a sampling rate of {dataset.sampling_rate} Hz, the {name} delivers only "
            f"{extractor.delivery_rate} Hz. Resample the recordings to the {name}'s rate."
        )
    seconds = pipe.lctg.config.segment_samples / extractor.sampling_rate
    # a sample of the coarser rate: of the two, or of the recordings
    rate = min(extractor.sampling_rate, dataset.attributes["sampling_rate"])
    if abs(seconds - dataset.segment_samples / dataset.sampling_rate) * rate > 1 + 1e-6:
        raise ValueError(
            f"The {name} was trained on segments of {seconds:g} s, `data` holds segments of "
            f"{dataset.segment_samples / dataset.sampling_rate:g} s. Prepare the data again with `--segment_seconds`."
        )
