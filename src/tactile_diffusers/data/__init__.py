"""Recordings, segments, ratings, and the prepared data set.

Readers of anyone's folders are in `data.folder`, simulated recordings in `tactile_diffusers.virtual`. Names are
imported when they are first used: training reads the prepared data set, and nothing of how it was prepared.
"""

import importlib

_MODULES = {
    "dataset": ("PreparedDataset",),
    "prepare": ("PreparationReport", "prepare_recordings"),
    "ratings": (
        *("RatingReliability", "SurfaceRatings", "axis_correlation", "pool_ratings"),
        *("rating_quantiles", "rating_reliability"),
    ),
    "recordings": ("RaterScores", "Recording", "RecordingsFile", "RecordingsWriter"),
    "segments": ("SegmentLimits",),
    "splits": ("HoldOut", "split_surfaces"),
}
__all__ = sorted(name for names in _MODULES.values() for name in names)


def __getattr__(name):
    for module, names in _MODULES.items():
        if name in names:
            return getattr(importlib.import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
