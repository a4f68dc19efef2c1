"""Recordings, virtual surfaces, segments, ratings, and the prepared data set."""

from .biotac import BIOTAC_BAND_HZ, BIOTAC_TEST_SURFACES, convert_biotac
from .dataset import PreparedDataset
from .folder import (
    EXPORT_KINDS,
    ConversionReport,
    Layout,
    convert_folder,
    draft_layout,
    export_folder,
    inspect_folder,
    load_layout,
)
from .prepare import PreparationReport, prepare_recordings
from .ratings import (
    RatingReliability,
    SurfaceRatings,
    axis_correlation,
    from_percentile,
    from_raw,
    pool_ratings,
    rating_quantiles,
    rating_reliability,
    to_raw,
)
from .recordings import RaterScores, Recording, RecordingsFile, RecordingsWriter
from .segments import SegmentLimits
from .sens3 import convert_sens3, sens3_layout
from .splits import HoldOut, split_surfaces
from .virtual import VirtualSurface, generate_recordings

__all__ = [
    "BIOTAC_BAND_HZ",
    "BIOTAC_TEST_SURFACES",
    "EXPORT_KINDS",
    "ConversionReport",
    "HoldOut",
    "Layout",
    "PreparationReport",
    "PreparedDataset",
    "RaterScores",
    "RatingReliability",
    "Recording",
    "RecordingsFile",
    "RecordingsWriter",
    "SegmentLimits",
    "SurfaceRatings",
    "VirtualSurface",
    "axis_correlation",
    "convert_biotac",
    "convert_folder",
    "convert_sens3",
    "draft_layout",
    "export_folder",
    "from_percentile",
    "from_raw",
    "generate_recordings",
    "inspect_folder",
    "load_layout",
    "pool_ratings",
    "prepare_recordings",
    "rating_quantiles",
    "rating_reliability",
    "sens3_layout",
    "split_surfaces",
    "to_raw",
]
