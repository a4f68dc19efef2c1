"""Numbers that say how good textures are: against a reference, and as a set."""

from .distances import frechet_tactile_distance, kernel_tactile_distance
from .embedding import FEATURE_NAMES, TactileEmbedding, tactile_features
from .reconstruction import (
    goodness_of_fit,
    level_error_db,
    log_spectral_distance_db,
    out_of_band_ratio_db,
    rmse,
    signed_band_error_db,
    snr_db,
)

__all__ = [
    "FEATURE_NAMES",
    "TactileEmbedding",
    "frechet_tactile_distance",
    "goodness_of_fit",
    "kernel_tactile_distance",
    "level_error_db",
    "log_spectral_distance_db",
    "out_of_band_ratio_db",
    "rmse",
    "signed_band_error_db",
    "snr_db",
    "tactile_features",
]
