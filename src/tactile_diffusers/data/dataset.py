"""`PreparedDataset`: textures, levels, friction coefficients and ratings by index."""

import json

import numpy as np
import torch

from ..io.hdf5 import as_strings, check_sizes, open_whole
from ..io.reading import reading
from ..signal import RATING_AXES, resample
from .prepared_file import PREPARED_FORMAT, PREPARED_VERSION, SUBSETS, read_account, read_ratings, samples_at
from .splits import SPLITS, Splits


class PreparedDataset(torch.utils.data.Dataset):
    """A view of a prepared data set: one split, one subset, one sampling rate.

    At the native rate and at 2.5 kHz textures are read from the file by index. At another rate the whole recordings of
    this view are resampled once, before cropping, and kept in memory as float32.

    Args:
        path (`str` or `Path`): a file from `prepare_recordings`.
        split (`str`): "train", "validation" or "test", by surface; "all" of these; or "hard", what `HoldOut` kept
            apart, which is no part of "all", because its ratings may be of other raters.
        subset (`str`): "filtered" (within the limits of force and speed) or "full".
        sampling_rate (`int`, *optional*): Hz; defaults to the native rate.
        max_samples (`int`, *optional*): keep at most so many segments, evenly spread over the view.
        max_surfaces (`int`, *optional*): keep at most so many surfaces, evenly spread over the view.

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
        splits (`tuple[str, ...]`): the split of each surface of the file; "hard" = held out.
        recordings (`tuple[str, ...]`): names of all recordings of the file; `recording_ids` index them.
        account (`dict`): where the time of every recording of the file went: "recordings" and "reasons" (names), and
            "seconds", for each subset (recordings, reasons); the reason "used" is what segments are cut from.
        ratings_mean, ratings_scale (`np.ndarray`): (3,) typical rater's mean and scale on the 0-8 scale.
        surface_ratings, surface_ratings_std, surface_ratings_count (`np.ndarray`): (surfaces, 3) of all surfaces; if
            raters are held out, by them in the split "hard" and by the others elsewhere.
        reliability (`RatingReliability` or `None`): how far these raters agree.
        single_ratings (`np.ndarray` or `None`): (raters, surfaces, 3) z-scores of single raters, NaN = no answer;
            `None` if nobody rated, or the file was prepared before they were kept.
        friction_coefficients, levels, speeds (`np.ndarray`): (len,) float32 of this view; NaN = unknown.
        levels_apart (`np.ndarray`): (len,) float32, levels without 60 ms around turnarounds.
        turnarounds (`np.ndarray`): (len,) int64, how many; `turnaround_positions` tells where.
        surface_ids, recording_ids, starts (`np.ndarray`): (len,) int64; starts in samples of this view's rate.

    Raises:
        FileNotFoundError: if there is no file.
        ValueError: if the file is no prepared data set, an argument is unknown, or the view is empty.
    """

    def __init__(self, path, split="train", subset="filtered", sampling_rate=None, max_samples=None, max_surfaces=None):
        if split not in (*SPLITS, "all"):
            raise ValueError(f"`split` must be one of {(*SPLITS, 'all')}, got {split!r}.")
        if subset not in SUBSETS:
            raise ValueError(f"`subset` must be one of {SUBSETS}, got {subset!r}.")
        if max_samples is not None and max_samples < 1:
            raise ValueError(f"`max_samples` must be at least 1 or None, got {max_samples}.")
        if max_surfaces is not None and max_surfaces < 1:
            raise ValueError(f"`max_surfaces` must be at least 1 or None, got {max_surfaces}.")
        self.path, self.split, self.subset = str(path), split, subset
        self._lateral = None
        with open_whole(path) as file:
            with self._reading():
                self._check_file(file)
                check_sizes(file)
            self._set_rate(sampling_rate)
            with self._reading():
                self._read_surfaces(file)
                self._read_windows(file, max_samples, max_surfaces)
                self._find_textures(file)

    def _reading(self):
        return reading(self.path, "a prepared data set", "Copy it again, or prepare the data again.")

    def _check_file(self, file):
        attributes = file.attrs
        if attributes.get("format") != PREPARED_FORMAT or attributes.get("version") != PREPARED_VERSION:
            raise ValueError(
                f"{self.path} is no prepared data set of version {PREPARED_VERSION} "
                f"(format={attributes.get('format')!r}, version={attributes.get('version')}): write one with "
                "examples/prepare_data.py."
            )
        self._native_rate = int(attributes["sampling_rate"])
        self._native_samples = int(attributes["segment_samples"])
        low, high = (float(edge) for edge in attributes["band"])
        if not (0 < low < high < self._native_rate / 2 and self._native_samples > 0):
            raise ValueError(f"its band of {low:g}-{high:g} Hz or its segments are impossible")
        self.band = (low, high)
        self.unit, self.source = str(attributes["unit"]), str(attributes["source"])
        self.attributes = _plain(attributes)
        for name in ("filter_order", "filter_passes", "turnarounds", "report"):  # what a card tells in the end
            self.attributes[name]

    def _set_rate(self, sampling_rate):
        rate = self._native_rate if sampling_rate is None else sampling_rate
        if int(rate) != rate or rate / 2 <= self.band[1]:
            raise ValueError(
                f"`sampling_rate` must be a whole number of Hz above {2 * self.band[1]:g}, twice the band's upper "
                f"edge, got {rate}."
            )
        self.sampling_rate = int(rate)
        self.segment_samples = int(round(self._native_samples * rate / self._native_rate))

    def _read_surfaces(self, file):
        self.surfaces, self.recordings = as_strings(file["surfaces/name"]), as_strings(file["recordings/name"])
        self.explorers = len({name.split("/")[1] for name in self.recordings})
        self._splits = Splits(
            file["surfaces/split"][()], *(file[f"recordings/{name}"][()] for name in ("surface", "withheld", "hard"))
        )
        self.splits = tuple(SPLITS[number] for number in self._splits.surfaces)
        self.account = read_account(file)
        group = "ratings_hard" if self.split == "hard" and "ratings_hard" in file else "ratings"
        pooled, self.reliability, self.single_ratings = read_ratings(file[group])
        self.surface_ratings, self.surface_ratings_std, self.surface_ratings_count = pooled[:3]
        self.ratings_mean, self.ratings_scale = pooled[3:]

    def _read_windows(self, file, max_samples, max_surfaces):
        windows = {name: values[()] for name, values in file[f"windows/{self.subset}"].items()}
        if any(values.shape != windows["recording"].shape or np.isinf(values).any() for values in windows.values()):
            raise ValueError("windows differ in number, or hold infinite numbers")
        chosen = np.flatnonzero(self._splits.members(self.split)[windows["recording"]])
        if not len(chosen):
            raise ValueError(f"{self.path} has no {self.subset} segment in the split {self.split!r}: see its report.")
        surfaces = self._splits.owners[windows["recording"]]
        if max_surfaces is not None and max_surfaces < len(present := np.unique(surfaces[chosen])):
            kept = present[np.linspace(0, len(present) - 1, max_surfaces).round().astype(np.int64)]
            chosen = chosen[np.isin(surfaces[chosen], kept)]
        if max_samples is not None and max_samples < len(chosen):
            chosen = chosen[np.linspace(0, len(chosen) - 1, max_samples).round().astype(np.int64)]
        windows = {name: values[chosen] for name, values in windows.items()}
        self.recording_ids, self._starts = windows["recording"], windows["start"]
        self.surface_ids = self._splits.owners[self.recording_ids]
        self.friction_coefficients, self.speeds = windows["friction_coefficient"], windows["speed"]
        self.levels, self.levels_apart, self.turnarounds = (
            windows[name] for name in ("level", "level_apart", "turnarounds")
        )
        self.starts = np.round(self._starts * (self.sampling_rate / self._native_rate)).astype(np.int64)
        self._turnaround_offset = file["recordings/turnaround_offset"][()]
        self._turnaround_positions = file["turnarounds"][()]
        self._check_shapes()

    def _check_shapes(self):
        ratings = (self.surface_ratings, self.surface_ratings_std, self.surface_ratings_count)
        if any(
            np.shape(values) != (len(self.surfaces), len(RATING_AXES)) or np.isinf(values).any() for values in ratings
        ):
            raise ValueError("ratings are not those of its surfaces")
        offset, positions = self._turnaround_offset, self._turnaround_positions
        whole = offset.dtype.kind in "iu" and positions.dtype.kind in "iu" and positions.ndim == 1
        if not whole or offset.shape != (len(self.recordings) + 1,):
            raise ValueError("turnarounds are not those of its recordings")

    def _find_textures(self, file):
        """Where each texture begins, in the file or, at a rate that it does not hold, in memory."""
        if f"offset/{self.sampling_rate}" in file:
            stored = file[f"lateral/{self.sampling_rate}"]
            # mapped, not read through HDF5: twenty times faster, and safe in forked processes
            if stored.id.get_offset() is None:
                raise ValueError(f"{self.path}: lateral force is chunked or compressed. Prepare the data set again.")
            self._mapped = {"dtype": stored.dtype, "offset": stored.id.get_offset(), "shape": stored.shape}
            self._places = file[f"offset/{self.sampling_rate}"][()][self.recording_ids] + self.starts
            self._map()  # at once, so that index and textures are of one file even if it is replaced later
            self._check_places()
            return
        native, lateral = file[f"offset/{self._native_rate}"][()], file[f"lateral/{self._native_rate}"]
        needed = np.unique(self.recording_ids)
        lengths = samples_at(native[needed + 1] - native[needed], self._native_rate, self.sampling_rate)
        places = np.concatenate([[0], np.cumsum(lengths)])
        self._mapped, self._lateral = None, np.empty(places[-1], dtype=np.float32)
        for recording, place, end in zip(needed, places[:-1], places[1:], strict=True):
            whole = lateral[native[recording] : native[recording + 1]]
            self._lateral[place:end] = resample(whole, self._native_rate, self.sampling_rate)
        self._places = places[np.searchsorted(needed, self.recording_ids)] + self.starts
        self._check_places()

    def _check_places(self):
        # resampling rounds both ends of a segment
        if self._places.min() < 0 or self._places.max() + self.segment_samples > len(self._lateral) + 1:
            raise ValueError(f"{self.path} is damaged: segments lie outside of its recordings. Prepare it again.")

    def _map(self):
        self._lateral = np.memmap(self.path, mode="r", **self._mapped)

    def __len__(self):
        return len(self._starts)

    def __getstate__(self):
        return {**self.__dict__, "_lateral": None} if self._mapped else self.__dict__  # a map pickles as its content

    def textures(self, indices):
        """Textures by index: (n, segment_samples) float32, in `unit`."""
        if self._lateral is None:  # after pickling
            self._map()
        indices = np.atleast_1d(np.asarray(indices, dtype=np.int64))
        textures = np.empty((len(indices), self.segment_samples), dtype=np.float32)
        for row, place in enumerate(self._places[indices]):
            textures[row] = self._lateral[place : place + self.segment_samples]
        if not np.isfinite(textures).all():
            raise ValueError(f"{self.path} is damaged: it holds lateral force that is no number. Copy it again.")
        return textures

    def turnaround_positions(self, index):
        """Middles of the turnarounds of one segment: (k,) int64, samples of this view's rate from its first one."""
        recording, start = self.recording_ids[index], self._starts[index]
        positions = self._turnaround_positions[slice(*self._turnaround_offset[recording : recording + 2])] - start
        inside = positions[(positions >= 0) & (positions < self._native_samples)]
        return (inside * self.sampling_rate) // self._native_rate

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
            place = (self.recording_ids[index], self._starts[index])
            free = all(r != place[0] or abs(s - place[1]) >= self._native_samples for r, s in rows)
            if free and len(rows) < per_surface:
                rows.append(place)
                chosen.append(index)
        return np.sort(np.asarray(chosen, dtype=np.int64))

    def overlap(self, first, second):
        """Whether two segments share samples."""
        apart = abs(int(self._starts[first]) - int(self._starts[second]))
        return bool(self.recording_ids[first] == self.recording_ids[second] and apart < self._native_samples)

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
    return {**plain, **{name: json.loads(plain[name]) for name in ("limits", "hold_out")}}
