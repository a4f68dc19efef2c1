"""What turnarounds of the finger do to the level and the nine bands of a segment."""

import numpy as np

from ...signal import band_edges, band_levels_db
from ..segments import channels, filtered_with_gaps
from .surfaces import DB_PER_LEVEL

#: So many recordings, evenly spread, are filtered again as they are and with turnarounds replaced.
RECORDINGS = 30
#: So many segments with, and as many without turnarounds are compared in each.
SEGMENTS = 4
#: Treatments that are compared, and what they are called.
TREATMENTS = {"keep": "force as it is (keep)", "mask": "force around turnarounds replaced (mask)"}


def describe_turnarounds(data, source):
    """Share of segments with turnarounds, and their effect.

    Args:
        data (`PreparedDataset`): every split, the filtered subset, the native rate.
        source (`RecordingsFile`): open; what `data` was prepared from.

    Returns:
        `dict`: the "treatment" of the data; the "share" of segments that hold a turnaround; by how much their level is
        above that without 60 ms around it, "median_db" and "p90_db" (None without any); and as "effects" of treatments
        the nine bands of segments with turnarounds against others of the same recording.
    """
    turning = data.turnarounds > 0
    raised = DB_PER_LEVEL * (data.levels - data.levels_apart)[turning]
    return {
        "treatment": data.attributes["turnarounds"],
        "share": float(turning.mean()),
        "median_db": np.median(raised) if len(raised) else None,
        "p90_db": np.quantile(raised, 0.9) if len(raised) else None,
        "effects": _effects(data, source, turning),
    }


def _effects(data, source, turning):
    """Bands with minus bands without turnarounds, for each treatment; empty if no recording has both."""
    changes, owners = {treatment: [] for treatment in TREATMENTS}, []
    for number in _recordings_with_both(data, turning):
        mine = data.recording_ids == number
        groups = [_some(np.flatnonzero(mine & kind)) for kind in (turning, ~turning)]
        recording = source.read(data.recordings[number])
        for treatment in TREATMENTS:
            lateral = channels(recording, treatment).lateral
            order, passes = data.attributes["filter_order"], data.attributes["filter_passes"]
            filtered, _ = filtered_with_gaps(lateral, recording.rate, data.band, order, passes)
            bands = [_mean_bands(data, filtered, group) for group in groups]
            changes[treatment].append(bands[0] - bands[1])
        owners.append(recording.surface)
    return {treatment: _over_surfaces(np.stack(rows), owners) for treatment, rows in changes.items() if rows}


def _recordings_with_both(data, turning):
    both = np.intersect1d(data.recording_ids[turning], data.recording_ids[~turning])
    return both[np.unique(np.linspace(0, len(both) - 1, RECORDINGS).astype(int))] if len(both) else both


def _some(indices):
    return indices[np.unique(np.linspace(0, len(indices) - 1, SEGMENTS).astype(int))]


def _mean_bands(data, filtered, indices):
    textures = np.stack([filtered[start : start + data.segment_samples] for start in data.starts[indices]])
    return band_levels_db(textures, data.sampling_rate, band_edges(band=data.band)).mean(axis=0)


def _over_surfaces(changes, owners):
    """Mean change and half of its 95 % interval, (bands,) each; surfaces are the independent units."""
    means = np.stack([changes[np.equal(owners, owner)].mean(axis=0) for owner in sorted(set(owners))])
    count = len(means)
    half = 1.96 * means.std(axis=0, ddof=1) / np.sqrt(count) if count > 1 else np.full(means.shape[1], np.nan)
    return {"surfaces": count, "bands_db": means.mean(axis=0), "half_interval_db": half}
