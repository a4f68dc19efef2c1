"""The prepared data set as an HDF5 file: what `prepare_recordings` writes and `PreparedDataset` reads.

lateral/<rate>, offset/<rate>   filtered lateral force (samples,) float32 of all recordings, one after the other,
                                at the native and the working rate, and where each begins (recordings + 1,)
surfaces/name, split            split: index into SPLITS
recordings/name, surface, withheld, hard, turnaround_offset
turnarounds                     middles of all turnarounds, native samples within their recording
ratings/..., ratings_hard/...   of `SurfaceRatings`; the second of held-out raters only
windows/<subset>/...            recording and WINDOW_FIELDS, (windows,)
account/reasons, <subset>       seconds (recordings, reasons)
"""

import h5py
import numpy as np

from ..io.hdf5 import as_strings
from ..signal import WORKING_RATE, resample
from .ratings import RatingReliability
from .segments import REASONS

PREPARED_FORMAT = "tactile-prepared"
PREPARED_VERSION = 2
SUBSETS = ("filtered", "full")
#: Per window and subset; see `Windows`.
WINDOW_FIELDS = ("start", "friction_coefficient", "level", "level_apart", "speed", "turnarounds")
_WHOLE_NUMBERS = ("recording", "start", "turnarounds")
_RATING_FIELDS = ("mean", "std", "count", "raw_mean", "raw_scale")
_RELIABILITY_FIELDS = ("mean_correlation", "alpha", "raters", "pairs", "raters_per_surface")


def stored_rates(rate, band):
    """Rates (Hz) at which lateral force is stored: the native one and, if lower and wide enough, 2.5 kHz."""
    return (rate, WORKING_RATE) if 2 * band[1] < WORKING_RATE < rate else (rate,)


def samples_at(lengths, rate_in, rate_out):
    """Samples that `resample` makes of `lengths`, (recordings,) int64."""
    return -(-np.asarray(lengths, dtype=np.int64) * rate_out // rate_in)


class LateralWriter:
    """Writes filtered lateral force, recording by recording, at each of `stored_rates`.

    Args:
        file (`h5py.File`): open for writing.
        lengths (`Sequence[int]`): native samples of each recording.
        rate (`int`): native, Hz.
        band (`tuple[float, float]`): Hz.
    """

    def __init__(self, file, lengths, rate, band):
        self.rate, self._datasets, self._offsets = rate, {}, {}
        for other in stored_rates(rate, band):
            self._offsets[other] = np.concatenate([[0], np.cumsum(samples_at(lengths, rate, other))])
            file.create_dataset(f"offset/{other}", data=self._offsets[other])
            self._datasets[other] = file.create_dataset(f"lateral/{other}", (self._offsets[other][-1],), np.float32)

    def add(self, number, filtered):
        """Stores recording `number`, (samples,) at the native rate."""
        for rate, dataset in self._datasets.items():
            start, stop = self._offsets[rate][number : number + 2]
            dataset[start:stop] = resample(filtered, self.rate, rate)


def write_recordings(file, source, splits, turnarounds):
    """Names, splits and turnarounds (a list of (k,) native samples) of the recordings of a `RecordingsFile`."""
    text = h5py.string_dtype()
    file.attrs.update({key: value for key, value in source.attributes.items() if key not in ("format", "version")})
    file.create_dataset("surfaces/name", data=list(source.surfaces), dtype=text)
    file.create_dataset("surfaces/split", data=splits.surfaces)
    file.create_dataset("recordings/name", data=source.names, dtype=text)
    file.create_dataset("recordings/surface", data=splits.owners)
    file.create_dataset("recordings/withheld", data=splits.withheld)
    file.create_dataset("recordings/hard", data=splits.hard)
    counts = [len(positions) for positions in turnarounds]
    file.create_dataset("recordings/turnaround_offset", data=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64))
    file.create_dataset("turnarounds", data=np.concatenate(turnarounds).astype(np.int64))


def write_ratings(file, name, ratings):
    """Stores `SurfaceRatings` as group `name`."""
    group = file.create_group(name)
    for field in _RATING_FIELDS:
        group.create_dataset(field, data=getattr(ratings, field))
    if ratings.each is not None:
        group.create_dataset("each", data=ratings.each)
    if ratings.reliability is not None:
        group.create_dataset("axes", data=list(ratings.reliability.axes), dtype=h5py.string_dtype())
        for field in _RELIABILITY_FIELDS:
            group.create_dataset(field, data=getattr(ratings.reliability, field))


def read_ratings(group):
    """The five arrays of `SurfaceRatings` in order, its `RatingReliability` or `None`, and `each` or `None`."""
    reliability = None
    if "axes" in group:
        fields = {field: group[field][()] for field in _RELIABILITY_FIELDS}
        reliability = RatingReliability(as_strings(group["axes"]), **fields)
    each = group["each"][()] if "each" in group else None  # files of older versions lack it
    return [group[field][()] for field in _RATING_FIELDS], reliability, each


def write_windows(file, subset, columns, seconds):
    """Stores the windows of a subset, {field: (windows,)}, and its account, seconds (recordings, reasons)."""
    for name, values in columns.items():
        kind = np.int64 if name in _WHOLE_NUMBERS else np.float32
        file.create_dataset(f"windows/{subset}/{name}", data=values.astype(kind))
    file.create_dataset(f"account/{subset}", data=seconds)


def write_reasons(file):
    """Stores the reasons that the account's columns stand for."""
    file.create_dataset("account/reasons", data=list(REASONS), dtype=h5py.string_dtype())


def read_account(file):
    """ "recordings" and "reasons", names, and "seconds", {subset: (recordings, reasons)}: a dict."""
    return {
        "recordings": as_strings(file["recordings/name"]),
        "reasons": as_strings(file["account/reasons"]),
        "seconds": {subset: file[f"account/{subset}"][()] for subset in SUBSETS},
    }
