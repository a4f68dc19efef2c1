"""Recordings, segments, ratings, and the prepared data set.

Readers of anyone's folders are in `data.folder`, simulated recordings in `tactile_diffusers.virtual`. Names are
imported when they are first used: training reads the prepared data set, and nothing of how it was prepared.
"""

from ..lazy import importing

_PLACES = {
    ".dataset": ("PreparedDataset",),
    ".prepare": ("PreparationReport", "prepare_recordings"),
    ".ratings": (
        *("RatingReliability", "SurfaceRatings", "axis_correlation", "pool_ratings"),
        *("rating_quantiles", "rating_reliability"),
    ),
    ".recordings": ("RaterScores", "Recording", "RecordingsFile", "RecordingsWriter"),
    ".segments": ("SegmentLimits",),
    ".splits": ("HoldOut", "split_surfaces"),
}
__all__ = sorted(name for names in _PLACES.values() for name in names)
__getattr__ = importing(__name__, _PLACES)
