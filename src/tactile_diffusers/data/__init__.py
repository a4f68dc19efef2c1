"""Recordings, virtual surfaces, segments, ratings, and the prepared data set."""

from .biotac import BIOTAC_BAND_HZ, BIOTAC_TEST_SURFACES, convert_biotac
from .dataset import PreparedDataset
from .prepare import PreparationReport, prepare_recordings, split_surfaces
from .ratings import SurfaceRatings, from_raw, pool_ratings, to_raw
from .recordings import RaterScores, Recording, RecordingsFile, RecordingsWriter
from .segments import SegmentLimits
from .virtual import VirtualSurface, generate_recordings

__all__ = [
    "BIOTAC_BAND_HZ",
    "BIOTAC_TEST_SURFACES",
    "PreparationReport",
    "PreparedDataset",
    "RaterScores",
    "Recording",
    "RecordingsFile",
    "RecordingsWriter",
    "SegmentLimits",
    "SurfaceRatings",
    "VirtualSurface",
    "convert_biotac",
    "from_raw",
    "generate_recordings",
    "pool_ratings",
    "prepare_recordings",
    "split_surfaces",
    "to_raw",
]
