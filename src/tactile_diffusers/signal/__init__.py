"""Filters, resampling, spectra and the constants of the field: the ground floor."""

from .constants import (
    BAND_HZ,
    DEVICE_RATE,
    RATING_AXES,
    REFERENCE_FORCE,
    SEGMENT_SAMPLES,
    SEGMENT_SECONDS,
    WORKING_RATE,
)
from .filters import band_pass
from .rating_scales import coverage_distance
from .resampling import resample
from .spectra import band_edges, band_levels_db, level, nine_band_error_db, power_spectral_density, rms

__all__ = [
    "BAND_HZ",
    "DEVICE_RATE",
    "RATING_AXES",
    "REFERENCE_FORCE",
    "SEGMENT_SAMPLES",
    "SEGMENT_SECONDS",
    "WORKING_RATE",
    "band_edges",
    "band_levels_db",
    "band_pass",
    "coverage_distance",
    "level",
    "nine_band_error_db",
    "power_spectral_density",
    "resample",
    "rms",
]
