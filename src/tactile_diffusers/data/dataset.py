"""`PreparedDataset`: textures, levels, friction coefficients and ratings by index."""

import json
import os

import numpy as np
import torch

from ..signal import resample
from .files import as_strings, open_whole
from .prepare import PREPARED_FORMAT, PREPARED_VERSION, SPLITS, SUBSETS


class PreparedDataset(torch.utils.data.Dataset):
    """A view of a prepared data set: one split, one subset, one sampling rate.

    At the native rate textures are read from the file by index. At another rate the whole recordings of this view are
    resampled once, before cropping, and kept in memory as float32.

    Args:
        path (`str` or `Path`): a file from `prepare_recordings`.
        split (`str`): "train", "validation", "test" or "all"; splits are by surface.
        subset (`str`): "filtered" (within the limits of force and speed) or "full".
        sampling_rate (`int`, *optional*): Hz; defaults to the native rate.
        max_samples (`int`, *optional*): keep at most so many segments, evenly spread over the view.

    Attributes:
        sampling_rate (`int`): Hz.
        segment_samples (`int`): at `sampling_rate`.
        band (`tuple[float, float]`): Hz.
        unit (`str`): "N", or "1" if uncalibrated.
        source (`str`): where the recordings come from.
        attributes (`dict`): everything that the source and the preparation noted of the file, as plain numbers, strings
            and lists ("limits" as a dict): "source", "licence", "filter_order"; a virtual one also "seed" and others.
        explorers (`int`): distinct explorers in the whole file.
        surfaces (`tuple[str, ...]`): names of all surfaces of the file; `surface_ids` index them.
        ratings_mean, ratings_scale (`np.ndarray`): (3,) typical rater's mean and scale on the 0-8 scale.
        surface_ratings, surface_ratings_std, surface_ratings_count (`np.ndarray`): (surfaces, 3) of all surfaces.
        friction_coefficients, levels, speeds (`np.ndarray`): (len,) float32 of this view; NaN = unknown.
        turnarounds, surface_ids (`np.ndarray`): (len,) int64.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: if the file is no prepared data set, an argument is unknown, or the view is empty.
    """

    def __init__(self, path, split="train", subset="filtered", sampling_rate=None, max_samples=None):
        if split not in (*SPLITS, "all"):
            raise ValueError(f"`split` must be one of {(*SPLITS, 'all')}, got {split!r}.")
        if subset not in SUBSETS:
            raise ValueError(f"`subset` must be one of {SUBSETS}, got {subset!r}.")
        if max_samples is not None and max_samples < 1:
            raise ValueError(f"`max_samples` must be at least 1 or None, got {max_samples}.")
        self.path, self.split, self.subset = str(path), split, subset
        self._file, self._process, self._buffer = None, None, None
        with open_whole(path) as file:
            self._read_index(file, max_samples)
            self._set_rate(sampling_rate)
            if self.sampling_rate != self._native_rate:
                self._resample(file)

    def _read_index(self, file, max_samples):
        attributes = file.attrs
        if attributes.get("format") != PREPARED_FORMAT or attributes.get("version") != PREPARED_VERSION:
            raise ValueError(
                f"{self.path} is no prepared data set of version {PREPARED_VERSION} "
                f"(format={attributes.get('format')!r}): write one with examples/prepare_data.py."
            )
        self._native_rate = int(attributes["sampling_rate"])
        self._native_samples = int(attributes["segment_samples"])
        self.band = tuple(float(edge) for edge in attributes["band"])
        self.unit, self.source = str(attributes["unit"]), str(attributes["source"])
        self.attributes = _plain(attributes)
        self.explorers = len({name.split("/")[1] for name in as_strings(file["recordings/name"])})
        self.surfaces = as_strings(file["surfaces/name"])
        self.surface_ratings, self.surface_ratings_std, self.surface_ratings_count = (
            file[f"ratings/{name}"][()] for name in ("mean", "std", "count")
        )
        self.ratings_mean, self.ratings_scale = file["ratings/raw_mean"][()], file["ratings/raw_scale"][()]
        self._offsets = file["recordings/offset"][()]
        windows = {name: values[()] for name, values in file[f"windows/{self.subset}"].items()}
        surface_ids = file["recordings/surface"][()][windows["recording"]]
        chosen = np.arange(len(surface_ids))
        if self.split != "all":
            chosen = np.flatnonzero(file["surfaces/split"][()][surface_ids] == SPLITS.index(self.split))
        if not len(chosen):
            raise ValueError(f"{self.path} has no {self.subset} segment in the split {self.split!r}: see its report.")
        if max_samples is not None and max_samples < len(chosen):
            chosen = chosen[np.linspace(0, len(chosen) - 1, max_samples).round().astype(np.int64)]
        self.surface_ids = surface_ids[chosen]
        self._recordings, self._starts = windows["recording"][chosen], windows["start"][chosen]
        self.friction_coefficients, self.levels = windows["friction_coefficient"][chosen], windows["level"][chosen]
        self.speeds, self.turnarounds = windows["speed"][chosen], windows["turnarounds"][chosen]

    def _set_rate(self, sampling_rate):
        rate = self._native_rate if sampling_rate is None else sampling_rate
        if int(rate) != rate or rate / 2 <= self.band[1]:
            raise ValueError(
                f"`sampling_rate` must be a whole number of Hz above {2 * self.band[1]:g}, twice the band's upper "
                f"edge, got {rate}."
            )
        self.sampling_rate = int(rate)
        self.segment_samples = int(round(self._native_samples * rate / self._native_rate))

    def _resample(self, file):
        ratio = self.sampling_rate / self._native_rate
        needed = np.unique(self._recordings)
        lengths = np.ceil((self._offsets[needed + 1] - self._offsets[needed]) * ratio - 1e-9).astype(np.int64)
        places = np.concatenate([[0], np.cumsum(lengths)])
        self._buffer = np.empty(places[-1], dtype=np.float32)
        for recording, place, end in zip(needed, places[:-1], places[1:], strict=True):
            whole = file["lateral"][self._offsets[recording] : self._offsets[recording + 1]]
            self._buffer[place:end] = resample(whole, self._native_rate, self.sampling_rate)
        self._places = places[np.searchsorted(needed, self._recordings)]
        self._places += np.round(self._starts * ratio).astype(np.int64)

    def __len__(self):
        return len(self._starts)

    def __getstate__(self):
        return {**self.__dict__, "_file": None, "_process": None}

    def _lateral(self):
        """The stored lateral force, through a handle that belongs to this process (a forked one must not be shared)."""
        if self._file is None or self._process != os.getpid():
            self._file, self._process = open_whole(self.path), os.getpid()
        return self._file["lateral"]

    def textures(self, indices):
        """Textures by index: (n, segment_samples) float32, in `unit`."""
        indices = np.atleast_1d(np.asarray(indices, dtype=np.int64))
        textures = np.empty((len(indices), self.segment_samples), dtype=np.float32)
        if self._buffer is not None:
            for row, place in enumerate(self._places[indices]):
                textures[row] = self._buffer[place : place + self.segment_samples]
            return textures
        lateral = self._lateral()
        for row, place in enumerate(self._offsets[self._recordings[indices]] + self._starts[indices]):
            textures[row] = lateral[place : place + self.segment_samples]
        return textures

    def non_overlapping(self, per_surface, seed=0):
        """Indices of segments that share no sample, drawn at random over recordings (explorers), in ascending order.

        Args:
            per_surface (`int`): at most so many segments of each surface; overlapping ones would count twice.
            seed (`int`): of the choice.

        Returns:
            `np.ndarray`: (n,) int64.
        """
        chosen, taken = [], {}
        for index in np.random.default_rng(seed).permutation(len(self)):
            rows = taken.setdefault(int(self.surface_ids[index]), [])
            place = (self._recordings[index], self._starts[index])
            free = all(r != place[0] or abs(s - place[1]) >= self._native_samples for r, s in rows)
            if free and len(rows) < per_surface:
                rows.append(place)
                chosen.append(index)
        return np.sort(np.asarray(chosen, dtype=np.int64))

    def overlap(self, first, second):
        """Whether two segments share samples."""
        apart = abs(int(self._starts[first]) - int(self._starts[second]))
        return bool(self._recordings[first] == self._recordings[second] and apart < self._native_samples)

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
            "ratings": torch.tensor(self.surface_ratings[surface]),
            "ratings_std": torch.tensor(self.surface_ratings_std[surface]),
            "ratings_count": torch.tensor(self.surface_ratings_count[surface]),
            "reference_speed": torch.tensor(self.speeds[index]),
            "surface": torch.tensor(surface),
            "index": torch.tensor(index),
        }


def _plain(attributes):
    """Attributes of an HDF5 file as a dict of plain Python values."""
    plain = {name: value.tolist() if hasattr(value, "tolist") else value for name, value in attributes.items()}
    return {**plain, "limits": json.loads(plain["limits"])}
