"""The prepared data set as an HDF5 file: what `prepare_recordings` writes and `PreparedDataset` reads.

lateral/<rate>, offset/<rate>   filtered lateral force (samples,) float32 of all recordings, one after the other,
                                at the native and the working rate, and where each begins (recordings + 1,)
surfaces, recordings            names and splits: fields of `Splits`
ratings, ratings_hard           `SurfaceRatings`; the second of held-out raters only
segments/<subset>               `SegmentTable`
seconds/reasons, <subset>       where the time went: names, and seconds (recordings, reasons)
"""

import h5py
import numpy as np

from ..io.hdf5 import as_strings
from ..signal import WORKING_RATE, resample

PREPARED_FORMAT = "tactile-prepared"
PREPARED_VERSION = 3
SUBSETS = ("filtered", "full")


def _offsets(lengths, rate_in, rate_out):
    """Where each recording begins after `resample`, and where the last one ends: (recordings + 1,) int64."""
    resampled = -(-np.asarray(lengths, dtype=np.int64) * rate_out // rate_in)
    return np.concatenate([[0], np.cumsum(resampled)])


class LateralWriter:
    """Writes filtered lateral force, recording by recording: at the native rate and, if it is lower, at 2.5 kHz.

    `lengths` are the native samples of each recording, `rate` and `band` are in Hz.
    """

    def __init__(self, file, lengths, rate, band):
        self.rate, self._stored = rate, {}
        for other in (rate, WORKING_RATE) if 2 * band[1] < WORKING_RATE < rate else (rate,):
            offsets = _offsets(lengths, rate, other)
            file.create_dataset(f"offset/{other}", data=offsets)
            self._stored[other] = offsets, file.create_dataset(f"lateral/{other}", (offsets[-1],), np.float32)

    def add(self, number, filtered):
        """Stores recording `number`, (samples,) at the native rate."""
        for rate, (offsets, dataset) in self._stored.items():
            dataset[offsets[number] : offsets[number + 1]] = resample(filtered, self.rate, rate)


class LateralReader:
    """Filtered lateral force at one rate: mapped from the file or, at a rate that it does not hold, in memory.

    `needed` are the recordings that will be read; the attribute `begin` (recordings,) is where each of all begins.
    """

    def __init__(self, file, rate, needed):
        self.path, self._mapping, self._values = file.filename, None, None
        if f"offset/{rate}" in file:
            stored = file[f"lateral/{rate}"]
            # mapped, not read through HDF5: twenty times faster, and safe in forked processes
            if stored.id.get_offset() is None:
                raise ValueError(f"{self.path}: lateral force is chunked or compressed. Prepare the data set again.")
            self._mapping = {"dtype": stored.dtype, "offset": stored.id.get_offset(), "shape": stored.shape}
            self.begin = file[f"offset/{rate}"][:-1]
            self._map()  # at once, so that index and textures are of one file even if it is replaced later
        else:
            self._resample(file, rate, np.unique(needed))

    def _map(self):
        self._values = np.memmap(self.path, mode="r", **self._mapping)

    def _resample(self, file, rate, needed):
        native = int(file.attrs["sampling_rate"])
        offsets, lateral = file[f"offset/{native}"][()], file[f"lateral/{native}"]
        places = _offsets(offsets[needed + 1] - offsets[needed], native, rate)
        self._values, self.begin = np.empty(places[-1], np.float32), np.zeros(len(offsets) - 1, np.int64)
        self.begin[needed] = places[:-1]
        for recording, begin, end in zip(needed, places[:-1], places[1:], strict=True):
            self._values[begin:end] = resample(lateral[offsets[recording] : offsets[recording + 1]], native, rate)

    def __len__(self):
        return len(self._values)

    def __getstate__(self):
        return {**self.__dict__, "_values": None} if self._mapping else self.__dict__  # a map pickles as its content

    def read(self, places, samples):
        """`samples` samples from each of `places`: (n, samples) float32."""
        if self._values is None:  # after pickling
            self._map()
        rows = np.empty((len(places), samples), dtype=np.float32)
        for row, place in enumerate(places):
            rows[row] = self._values[place : place + samples]
        if not np.isfinite(rows).all():
            raise ValueError(f"{self.path} is damaged: it holds lateral force that is not a number. Copy it again.")
        return rows


def write_group(file, name, content):
    """Stores a dict of arrays, names and further dicts as a group; `None` is left out."""
    for field, values in content.items():
        if isinstance(values, dict):
            write_group(file, f"{name}/{field}", values)
        elif values is not None:
            values = np.asarray(values)
            text = values.dtype.kind == "U"
            data, dtype = (values.tolist(), h5py.string_dtype()) if text else (values, None)
            file.create_dataset(f"{name}/{field}", data=data, dtype=dtype)


def read_group(group):
    """What `write_group` stored."""

    def value(node):
        if isinstance(node, h5py.Group):
            return read_group(node)
        return as_strings(node) if h5py.check_string_dtype(node.dtype) else node[()]

    return {field: value(node) for field, node in group.items()}
