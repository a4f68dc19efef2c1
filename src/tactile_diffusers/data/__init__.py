"""Recordings, segments, ratings, and the prepared data set.

Readers of anyone's folders are in `data.folder`, simulated recordings in `tactile_diffusers.virtual`.
"""

from .dataset import PreparedDataset
from .prepare import PreparationReport, prepare_recordings
from .ratings import (
    RatingReliability,
    SurfaceRatings,
    axis_correlation,
    pool_ratings,
    rating_quantiles,
    rating_reliability,
)
from .recordings import RaterScores, Recording, RecordingsFile, RecordingsWriter
from .segments import SegmentLimits
from .splits import HoldOut, split_surfaces

__all__ = [
    "HoldOut",
    "PreparationReport",
    "PreparedDataset",
    "RaterScores",
    "RatingReliability",
    "Recording",
    "RecordingsFile",
    "RecordingsWriter",
    "SegmentLimits",
    "SurfaceRatings",
    "axis_correlation",
    "pool_ratings",
    "prepare_recordings",
    "rating_quantiles",
    "rating_reliability",
    "split_surfaces",
]
