"""Evaluation: metrics of single textures and of sets, baselines, a judge of ratings, and the report of a checkpoint."""

from .baselines import SLUGS, BaselineRequest, TrainingTextures, default_baselines
from .judge import Judge, response_matrix
from .metrics.copying import TrainingWaveforms, closer_share, nearest_distance
from .metrics.distances import frechet_tactile_distance, kernel_tactile_distance
from .metrics.diversity import diversity, precision_recall
from .metrics.embedding import FEATURE_NAMES, TactileEmbedding, tactile_features
from .metrics.errors import (
    goodness_of_fit,
    level_error_db,
    log_spectral_distance_db,
    out_of_band_ratio_db,
    power_difference,
    rmse,
    signed_band_error_db,
    snr_db,
)
from .metrics.reference import Reference
from .metrics.statistics import jackknife, leaf
from .truth import RatedTextures
from .virtual_truth import truth_of

__all__ = [
    "FEATURE_NAMES",
    "SLUGS",
    "BaselineRequest",
    "Judge",
    "RatedTextures",
    "Reference",
    "TactileEmbedding",
    "TrainingTextures",
    "TrainingWaveforms",
    "closer_share",
    "default_baselines",
    "diversity",
    "frechet_tactile_distance",
    "goodness_of_fit",
    "jackknife",
    "kernel_tactile_distance",
    "leaf",
    "level_error_db",
    "log_spectral_distance_db",
    "nearest_distance",
    "out_of_band_ratio_db",
    "power_difference",
    "precision_recall",
    "response_matrix",
    "rmse",
    "signed_band_error_db",
    "snr_db",
    "tactile_features",
    "truth_of",
]
